"""The runner: a grid of solver x cloth x seed, metered, resumable, on one process or many."""

from cusick_bench.runner.cell import build_problem, load_prediction, run_cell
from cusick_bench.runner.errors import RunnerError
from cusick_bench.runner.execute import run
from cusick_bench.runner.grid import Cell, ProblemSettings, labelled, plan, record_key, require_space, shard
from cusick_bench.runner.progress import Unwatched, Watcher
from cusick_bench.runner.source import Source, load_once
from cusick_bench.runner.store import Store

__all__ = [
    "Cell",
    "ProblemSettings",
    "RunnerError",
    "Source",
    "Store",
    "Unwatched",
    "Watcher",
    "build_problem",
    "labelled",
    "load_once",
    "load_prediction",
    "plan",
    "record_key",
    "require_space",
    "run",
    "run_cell",
    "shard",
]
