"""Campaigns that are filmed, measured and then explained."""
