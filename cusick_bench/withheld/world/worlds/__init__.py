"""The worlds, one a file: each has a `WORLD`."""
