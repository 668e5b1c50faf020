"""Errors of exports."""

from cusick_bench.sim.errors import CusickError


class ExportError(CusickError, ValueError):
    """Something cannot be written for another program as asked."""
