"""Cells on worker processes; if a worker dies, only its own cell can be lost."""

import logging
import multiprocessing
import queue
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cusick_bench.runner.cell import SIMULATORS_KEPT, run_cell
from cusick_bench.runner.environment import cores
from cusick_bench.runner.errors import CellIsRunning
from cusick_bench.runner.executors.turns import Turns
from cusick_bench.runner.grid import Cell
from cusick_bench.runner.processes import process_pool
from cusick_bench.runner.progress import Watcher
from cusick_bench.runner.source import Source, load_planned
from cusick_bench.runner.store import Store
from cusick_bench.runner.warm_up import WarmUp
from cusick_bench.sim.setup import Simulators

POLL_SECONDS = 0.2  # between looks at the workers' messages
SUBMITTED_AHEAD = 4  # cells submitted at a time for each worker: workers never wait, and memory stays constant
MOST_SUBMITTED = 1000  # cells submitted at a time to an executor with an unknown number of workers


@dataclass(eq=False)
class _Worker:
    """Objects that a worker process reuses from cell to cell; no cell's numbers depend on them.

    Attributes:
        messages: Where it tells how far its cell is; None where nobody listens.
        simulators: Meshes and linear solvers that are analysed already.
        warm_up: Kernels that are compiled already.
        one: Held while a cell runs: an executor's threads share simulators, and the state of torch and NLopt.
    """

    messages: Any = None
    simulators: Simulators = field(default_factory=lambda: Simulators(most=SIMULATORS_KEPT))
    warm_up: WarmUp = field(default_factory=WarmUp)
    one: threading.Lock = field(default_factory=threading.Lock)

    def run(self, source: Source, cell: Cell, out: Path) -> dict[str, Any]:
        """Runs one cell."""
        last, said = 0.0, ""

        def report(fraction: float, loss: float, message: str) -> None:
            nonlocal last, said
            if self.messages is not None and (message != said or time.monotonic() - last > POLL_SECONDS):
                last, said = time.monotonic(), message
                self.messages.put((cell, fraction, loss, message))

        with self.one:
            dataset, store = load_planned(source, cell.dataset_hash), Store(out)
            if not store.is_done(cell.key):
                self.warm_up.before(dataset, cell)
            return run_cell(dataset, cell, store, report, self.simulators)


# This process as a worker. An executor passes tasks to a function of a module, which has to find the worker somewhere.
_worker = _Worker()


def _start_worker(messages: Any) -> None:
    messages.cancel_join_thread()  # or a worker would not end before all is read, and nobody reads after the last cell
    _worker.messages = messages
    logging.getLogger("cusick_bench.datasets").setLevel(logging.ERROR)  # who planned the cells was told all of it


def work(source: Source, cell: Cell, out: Path) -> dict[str, Any]:
    """Runs one cell in this process, which is a worker.

    Args:
        source: Where the data come from.
        cell: What to run.
        out: Results folder.

    Returns:
        The cell's result.
    """
    return _worker.run(source, cell, out)


@dataclass(frozen=True)
class Processes:
    """A pool of processes on this machine; cells under way when a worker died are run once more, each alone.

    Attributes:
        workers: Number of processes.
        death: What is recorded of a cell whose worker died twice.
    """

    workers: int
    death: str = "Worker process died, probably killed out of memory; reduce --workers"

    def run(self, source: Source, cells: Sequence[Cell], store: Store, watcher: Watcher) -> list[Cell]:
        """Runs cells.

        Args:
            source: Where the data come from.
            cells: What to run.
            store: Where results lie.
            watcher: Told of the grid's progress.

        Returns:
            Cells whose own process died twice.
        """
        died: list[Cell] = []
        for lost in self._lost(source, cells, store, watcher, ahead=SUBMITTED_AHEAD * self.workers):
            for alone in Processes(1)._lost(source, lost, store, watcher, ahead=1):
                died += alone
        return died

    def _lost(
        self, source: Source, cells: Sequence[Cell], store: Store, watcher: Watcher, *, ahead: int
    ) -> Iterator[list[Cell]]:
        """Runs cells; each time a worker dies, those under way, at most `ahead`, before a new pool runs the others."""
        left = list(cells)
        while left:
            messages = multiprocessing.get_context("spawn").Queue()
            workers, turns = min(self.workers, len(left)), Turns(left, watcher)
            threads = max(1, cores() // workers)
            with process_pool(workers, threads=threads, initializer=_start_worker, initargs=(messages,)) as pool:
                lost = Borrowed(pool, messages, ahead).until_broken(source, turns, store, watcher)
            left = turns.rest()
            if lost:
                yield lost


@dataclass(frozen=True)
class Borrowed:
    """Any executor of `concurrent.futures` whose workers see the results folder.

    Attributes:
        pool: The executor.
        messages: Queue in which workers tell how far they are, None where they cannot.
        ahead: Cells that are submitted at a time.
        death: What is recorded of a cell whose worker died.
    """

    pool: Executor
    messages: Any = None
    ahead: int = MOST_SUBMITTED
    death: str = "Worker process died, probably killed out of memory; give the executor fewer workers"

    def run(self, source: Source, cells: Sequence[Cell], store: Store, watcher: Watcher) -> list[Cell]:
        """Runs cells.

        Args:
            source: Where the data come from.
            cells: What to run.
            store: Where results lie.
            watcher: Told of the grid's progress.

        Returns:
            Cells lost with a worker that died, and with the executor that it broke.
        """
        turns = Turns(cells, watcher)
        return [*self.until_broken(source, turns, store, watcher), *turns.rest()]

    def until_broken(self, source: Source, turns: Turns, store: Store, watcher: Watcher) -> list[Cell]:
        """Runs cells until there are none left, or a worker dies, of which executors break.

        Args:
            source: Where the data come from.
            turns: What to run; what was not begun stays in it.
            store: Where results lie.
            watcher: Told of the grid's progress.

        Returns:
            Cells under way when the worker died.
        """
        lost: list[Cell] = []
        ended: queue.SimpleQueue[tuple[Cell, Future[dict[str, Any]]]] = queue.SimpleQueue()
        under_way = 0
        while True:
            while not lost and under_way < self.ahead and (cell := turns.due()) is not None:
                try:
                    future = self.pool.submit(work, source, cell, store.out)
                except BrokenExecutor:
                    lost.append(cell)
                    break
                under_way += 1
                future.add_done_callback(lambda done, cell=cell: ended.put((cell, done)))
            if not under_way and (lost or not turns):
                return lost
            try:
                cell, future = ended.get(timeout=POLL_SECONDS)
            except queue.Empty:
                _pass_on(self.messages, watcher)
                continue
            _pass_on(self.messages, watcher)
            under_way -= 1
            try:
                result = future.result()
            except BrokenExecutor:
                lost.append(cell)
            except CellIsRunning:
                turns.put_off(cell)
            else:
                watcher.end(cell, result["status"], result["failure"])


def _pass_on(messages: Any, watcher: Watcher) -> None:
    while messages is not None:
        try:
            watcher.update(*messages.get_nowait())
        except queue.Empty:
            return
