"""Errors of the report."""

from cusick_bench.sim.errors import CusickError


class ReportError(CusickError, ValueError):
    """A report cannot be written as asked."""
