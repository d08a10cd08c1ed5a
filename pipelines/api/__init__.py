"""What a notebook calls: the same work as the commands, results as objects that show themselves."""
