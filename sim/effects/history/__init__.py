"""Effects that depend on what happened to the cloth before the picture."""
