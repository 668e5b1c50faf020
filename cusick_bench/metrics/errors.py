"""Errors of the metrics."""

from cusick_bench.sim.errors import CusickError


class MetricError(CusickError, ValueError):
    """Two drapes cannot be compared: sizes differ, or a value is not finite or out of range."""
