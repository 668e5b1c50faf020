"""Errors of running a grid."""

from cusick_bench.sim.errors import CusickError


class RunnerError(CusickError):
    """The grid cannot run or go on (output folder, disk, executor, shard); finished cells are kept."""


class CellIsRunning(RunnerError):
    """Another process is running the cell."""
