"""`vision campaign`: measure a folder of clips and fit laws of restitution."""
