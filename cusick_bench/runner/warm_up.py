"""Kernels are compiled before a meter starts: what a cell is charged for is the search, never the compiler.

Before a process runs a solver in a new kind of problem, the solver answers a tiny one of that kind: the same law,
mode, space, loss, renderer and effects on a mesh of some hundred vertices, with a budget of a few drapes, and of more
where its first model comes later. It compiles just those kernels, with just those signatures, that the cell will call
(or reads them from disk, where an earlier process has left them: see `sim.kernel_cache`), and imports what the solver
imports late.
"""

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numba.core import config, event

from cusick_bench.datasets import DrapeDataset
from cusick_bench.files.folder_lock import locked
from cusick_bench.problem import Budget
from cusick_bench.runner.cell_problem import build_problem
from cusick_bench.runner.grid import Cell, record_key
from cusick_bench.sim.errors import raise_stop
from cusick_bench.solvers.registry import make_solver

VERTICES, STEPS = 97, 3  # of the tiny problem
DRAPES = 16.0  # forward-equivalents of its budget: a search for the level, and some gradients
MODELLED = 3.0  # those after a longer design: two points that a model chooses, and the answer
PATIENCE = 1.0  # [s] of compiling after which somebody is told

_log = logging.getLogger(__name__)


@dataclass(eq=False)
class WarmUp:
    """Record of what a process has compiled; no cell's numbers depend on it.

    Attributes:
        kinds: Kinds of problems that are warm, each with its solver: hashes.
    """

    kinds: set[str] = field(default_factory=set)

    def before(self, dataset: DrapeDataset, cell: Cell) -> None:
        """Compiles what a cell will call, unless a cell of its kind has run before.

        Args:
            dataset: The data set.
            cell: What is about to be run.
        """
        solver = make_solver(cell.solver)
        if solver.kind != "solver":
            return
        tiny = _tiny(cell, max(DRAPES, solver.drapes_of_design + MODELLED))
        kind = record_key({"solver": cell.solver, "settings": tiny.settings.record()})
        if kind in self.kinds:
            return
        self.kinds.add(kind)
        configuration: Any = config
        with _alone(Path(configuration.CACHE_DIR), kind), event.install_listener("numba:compile", _Teller()):
            try:
                problem = build_problem(dataset, tiny)
                solver.solve(problem, np.random.default_rng(0))
                if solver.takes_gradients and not problem.meter.gradient:  # the budget ended before the first one
                    build_problem(dataset, tiny).evaluate_and_gradient(np.zeros(problem.dimension))
            except (Exception, SystemExit) as error:  # the cell itself will say what is wrong with it
                raise_stop(error)
                _log.debug("the warm-up of %s stopped: %s", cell.solver, error)


@contextmanager
def _alone(folder: Path, kind: str) -> Iterator[None]:
    """Compiles while the other processes wait, which then read the kernels from disk; the first of a kind says so."""
    compiled = folder / f"warm-{kind}"
    if compiled.exists():
        yield
        return
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder):
        yield
        compiled.touch()


def _tiny(cell: Cell, drapes: float) -> Cell:
    """The cheapest cell that calls the same kernels."""
    drape = replace(cell.settings.drape, steps=min(STEPS, cell.settings.drape.steps))
    settings = replace(
        cell.settings, vertices=min(VERTICES, cell.settings.vertices), drape=drape, budget=Budget(drapes)
    )
    return replace(cell, seed=0, settings=settings)


class _Teller(event.Listener):
    """Says once that kernels are compiled, where that takes long."""

    def __init__(self) -> None:
        self._begin: float | None = None
        self._told = False

    def on_start(self, event: event.Event) -> None:
        """A kernel is being compiled."""
        self._begin = time.monotonic() if self._begin is None else self._begin
        if not self._told and time.monotonic() - self._begin > PATIENCE:
            self._told = True
            _log.warning("compiling kernels, once; they are kept for the next time, and no budget pays for it")

    def on_end(self, event: event.Event) -> None:
        """A kernel is compiled."""
