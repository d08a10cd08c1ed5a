"""Real recordings, made by others, with physics that their plain model leaves out."""
