"""`vision campaign`: from a folder of clips to a law of restitution, whatever happens."""
