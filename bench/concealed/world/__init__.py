"""The world in which physics is concealed."""
