"""Effects of the plate, of the cloth's position on it, and of its cut."""
