"""What moves how: motion models of followed things, and what happens in a clip."""
