"""Effects of how the cloth lies on its plate, and of its cut."""
