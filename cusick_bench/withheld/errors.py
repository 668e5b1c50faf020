"""Errors of withheld cases."""

from cusick_bench.sim.errors import CusickError


class WithheldError(CusickError, ValueError):
    """Withheld cases cannot be made, answered or scored as asked."""
