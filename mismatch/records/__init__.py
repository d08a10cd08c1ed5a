"""What was recorded: campaigns, trials, their noise, and what is odd in them."""
