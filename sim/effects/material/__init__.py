"""Effects of the cloth itself."""
