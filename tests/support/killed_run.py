"""Runs of one cell that end at a chosen evaluation: functions that worker processes can import."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

import numba
import torch

from cusick_bench.runner import Cell, Source, Store, load_once, run_cell
from cusick_bench.runner import cell as cells


@contextmanager
def ended_at(evaluation: int, end: Callable[[], object]) -> Iterator[None]:
    """Calls `end` once a cell has made or replayed so many evaluations, whatever its solver says meanwhile."""
    solve, made = cells.solve_cell, 0

    def count(_: object) -> None:
        nonlocal made
        made += 1
        if made == evaluation:
            end()

    def counted(problem, *rest):
        problem.meter.observers.append(count)
        return solve(problem, *rest)

    with patch.object(cells, "solve_cell", counted):
        yield


def run_until_killed(source: Source, cell: Cell, out: Path, evaluation: int) -> None:
    """Runs a cell, and kills this very process with SIGKILL once so many evaluations were made or replayed."""
    numba.set_num_threads(1)
    torch.set_num_threads(1)
    with ended_at(evaluation, lambda: os.kill(os.getpid(), signal.SIGKILL)):
        run_cell(load_once(source), cell, Store(out), lambda *_: None)
