"""What a campaign says as a whole: laws of restitution, precision, outliers, agreement, ranges."""
