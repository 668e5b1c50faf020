"""Effects of the cloth touching itself."""
