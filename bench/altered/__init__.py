"""Clips as another camera or file might have held them, or with a part of them lost or hidden."""
