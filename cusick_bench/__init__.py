"""cusick-bench: identify cloth stiffness from the Cusick drape test, and compare the methods that do it."""

__version__ = "0.1.0"
