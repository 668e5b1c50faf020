"""A solver and an effect for cusick-bench, each registered by an entry point in `pyproject.toml`."""
