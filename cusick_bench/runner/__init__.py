"""The runner: a grid of solver x cloth x seed, metered, resumable, on one process or many."""

from typing import TYPE_CHECKING

from cusick_bench.lazy import lazy_names

if TYPE_CHECKING:
    from cusick_bench.runner.cell import run_cell
    from cusick_bench.runner.cell_files import load_prediction
    from cusick_bench.runner.cell_problem import build_problem
    from cusick_bench.runner.errors import RunnerError
    from cusick_bench.runner.execute import run
    from cusick_bench.runner.executors.executor import CellExecutor
    from cusick_bench.runner.executors.submitted import Submitted
    from cusick_bench.runner.grid import Cell, ProblemSettings, plan, record_key, require_space, shard
    from cusick_bench.runner.labels import labelled
    from cusick_bench.runner.progress import Unwatched, Watcher
    from cusick_bench.runner.results import Results
    from cusick_bench.runner.source import Source, load_once
    from cusick_bench.runner.store import Store

__all__ = [
    "Cell",
    "CellExecutor",
    "ProblemSettings",
    "Results",
    "RunnerError",
    "Source",
    "Store",
    "Submitted",
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

__getattr__ = lazy_names(
    __name__,
    {
        "Cell": "grid",
        "CellExecutor": "executors.executor",
        "ProblemSettings": "grid",
        "Results": "results",
        "RunnerError": "errors",
        "Source": "source",
        "Store": "store",
        "Submitted": "executors.submitted",
        "Unwatched": "progress",
        "Watcher": "progress",
        "build_problem": "cell_problem",
        "labelled": "labels",
        "load_once": "source",
        "load_prediction": "cell_files",
        "plan": "grid",
        "record_key": "grid",
        "require_space": "grid",
        "run": "execute",
        "run_cell": "cell",
        "shard": "grid",
    },
)
