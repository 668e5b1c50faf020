"""Runs of one cell that a signal ends at a chosen evaluation: a function that worker processes can import."""

import os
import signal
from pathlib import Path

import numba
import torch

from cusick_bench.runner import Cell, Source, Store, load_once, run_cell


def run_until_killed(source: Source, cell: Cell, out: Path, evaluation: int) -> None:
    """Runs a cell, and kills this very process with SIGKILL once so many evaluations were made or replayed."""
    numba.set_num_threads(1)
    torch.set_num_threads(1)
    evaluations = 0

    def report(fraction: float, loss: float, message: str) -> None:
        nonlocal evaluations
        evaluations += message == ""
        if evaluations == evaluation:
            os.kill(os.getpid(), signal.SIGKILL)

    run_cell(load_once(source), cell, Store(out), report)
