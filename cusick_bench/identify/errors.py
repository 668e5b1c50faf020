"""Errors of an identification."""

from cusick_bench.sim.errors import CusickError


class IdentifyError(CusickError, ValueError):
    """A folder cannot be identified as asked: neither photographs nor a data set, or options that do not suit it."""
