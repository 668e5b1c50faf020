"""Errors of photographs: what is wrong with which picture, and what to do."""

from cusick_bench.datasets.errors import DataError


class BadPhotograph(DataError):
    """A photograph cannot be read, or does not show what it should."""
