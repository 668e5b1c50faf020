"""What the runner itself costs: a grid of trivial cells, whose time goes into keys, files and records.

A cell is `null:disc` on the first shipped cloth, on a small mesh, with nothing held out, so that scoring is one
comparison. That comparison is the cell's own work; what is left is the runner's.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cusick_bench.runner import Cell, ProblemSettings, Source, Unwatched, load_once, plan, run
from cusick_bench.sim.memory import most_memory

VERTICES = 97
WARM = 20  # cells before memory is looked at: libraries are loaded with the first


@dataclass(frozen=True)
class Overhead:
    """Cost of a grid of trivial cells.

    Attributes:
        cells: Number of cells.
        wall_ms: Wall time of a cell [ms], the first ones left out.
        processor_ms: Processor time of a cell, of this process [ms].
        again_ms: Processor time of a cell that is finished already [ms].
        memory_early_mib: Most memory when the first cells were finished [MiB].
        memory_mib: Most memory at the end [MiB].
    """

    cells: int
    wall_ms: float
    processor_ms: float
    again_ms: float
    memory_early_mib: float
    memory_mib: float

    @property
    def memory_a_cell_kib(self) -> float:
        """Memory that a further cell takes [KiB]."""
        return 1024 * (self.memory_mib - self.memory_early_mib) / max(1, self.cells - WARM)


def runner_overhead(cells: int, out: Path, *, progress: Callable[[int], None] | None = None) -> Overhead:
    """Runs trivial cells, one after the other in this process.

    Args:
        cells: How many, more than 20.
        out: Results folder, which should be empty.
        progress: Called with the number of finished cells.

    Returns:
        What they took.
    """
    source = Source("synthetic")
    data = load_once(source)
    settings = ProblemSettings(vertices=VERTICES)
    seeds = list(range(cells))
    planned = plan(data, solvers=["null:disc"], cloths=data.cloths[:1], seeds=seeds, settings=settings)
    trivial = [replace(cell, test=()) for cell in planned]
    watcher = _Clock(progress)
    run(source, trivial, out, watcher=watcher)
    ended = _now()
    run(source, trivial, out)
    again = _now()
    counted = cells - WARM
    return Overhead(
        cells=cells,
        wall_ms=1e3 * (ended["wall"] - watcher.early["wall"]) / counted,
        processor_ms=1e3 * (ended["processor"] - watcher.early["processor"]) / counted,
        again_ms=1e3 * (again["processor"] - ended["processor"]) / cells,
        memory_early_mib=watcher.early["memory"],
        memory_mib=ended["memory"],
    )


def _now() -> dict[str, float]:
    return {"wall": time.perf_counter(), "processor": time.process_time(), "memory": most_memory() / 2**20}


class _Clock(Unwatched):
    """Looks at the clocks when the first cells are finished."""

    def __init__(self, progress: Callable[[int], None] | None) -> None:
        self.early: dict[str, Any] = {}
        self._progress = progress
        self._ended = 0

    def end(self, cell: Cell, status: str, failure: str) -> None:
        """Counts a cell.

        Args:
            cell: Not used.
            status: Not used.
            failure: Why it failed, "" where it did not.

        Raises:
            RuntimeError: It failed, so that the others mean nothing.
        """
        if failure:
            raise RuntimeError(failure)
        self._ended += 1
        if self._ended == WARM:
            self.early = _now()
        if self._progress is not None:
            self._progress(self._ended)
