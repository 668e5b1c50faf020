"""Cells on worker processes; a worker that dies costs no cell but its own."""

import multiprocessing
import queue
import time
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cusick_bench.runner.cell import SIMULATORS_KEPT, run_cell
from cusick_bench.runner.environment import cores
from cusick_bench.runner.grid import Cell
from cusick_bench.runner.processes import process_pool
from cusick_bench.runner.progress import Watcher
from cusick_bench.runner.source import Source, load_once
from cusick_bench.runner.store import Store
from cusick_bench.runner.warm_up import WarmUp
from cusick_bench.sim.setup import Simulators

POLL_SECONDS = 0.2  # between looks at the workers' messages


@dataclass(eq=False)
class _Worker:
    """What a worker process keeps from cell to cell; no cell's numbers depend on it.

    Attributes:
        messages: Where it tells how far its cell is; None where nobody listens.
        simulators: Meshes and linear solvers that are analysed already.
        warm_up: Kernels that are compiled already.
    """

    messages: Any = None
    simulators: Simulators = field(default_factory=lambda: Simulators(most=SIMULATORS_KEPT))
    warm_up: WarmUp = field(default_factory=WarmUp)

    def run(self, source: Source, cell: Cell, out: Path) -> dict[str, Any]:
        """Runs one cell."""
        last = 0.0

        def report(fraction: float, loss: float, message: str) -> None:
            nonlocal last
            if self.messages is not None and time.monotonic() - last > POLL_SECONDS:
                last = time.monotonic()
                self.messages.put((cell, fraction, loss, message))

        dataset, store = load_once(source), Store(out)
        if not store.is_done(cell.key):
            self.warm_up.before(dataset, cell)
        return run_cell(dataset, cell, store, report, self.simulators)


# This process as a worker. An executor passes tasks to a function of a module, which has to find the worker somewhere.
_worker = _Worker()


def _start_worker(messages: Any) -> None:
    _worker.messages = messages


def _work(source: Source, cell: Cell, out: Path) -> dict[str, Any]:
    return _worker.run(source, cell, out)


def run_on_processes(source: Source, cells: Sequence[Cell], store: Store, watcher: Watcher, workers: int) -> list[Cell]:
    """Runs cells on a pool of processes, and those lost with a dead worker once more, each alone.

    Args:
        source: Where the data come from.
        cells: What to run.
        store: Where results lie.
        watcher: Called to tell how the grid gets on.
        workers: Processes.

    Returns:
        Cells whose own process died twice.
    """
    lost = _run_on_a_pool(source, cells, store, watcher, workers)
    return [cell for cell in lost if _run_on_a_pool(source, [cell], store, watcher, 1)]


def _run_on_a_pool(source: Source, cells: Sequence[Cell], store: Store, watcher: Watcher, workers: int) -> list[Cell]:
    messages = multiprocessing.get_context("spawn").Queue()
    workers = min(workers, len(cells))
    threads = max(1, cores() // workers)
    with process_pool(workers, threads=threads, initializer=_start_worker, initargs=(messages,)) as pool:
        return run_on_executor(pool, source, cells, store, watcher, messages)


def run_on_executor(
    pool: Executor, source: Source, cells: Sequence[Cell], store: Store, watcher: Watcher, messages: Any = None
) -> list[Cell]:
    """Runs cells on any executor whose workers see the results folder.

    Args:
        pool: The executor.
        source: Where the data come from.
        cells: What to run.
        store: Where results lie.
        watcher: Called to tell how the grid gets on.
        messages: Queue in which workers tell how far they are, None where they cannot.

    Returns:
        Cells lost with a worker that died.
    """
    lost: list[Cell] = []
    futures: dict[Future[dict[str, Any]], Cell] = {pool.submit(_work, source, cell, store.out): cell for cell in cells}
    while futures:
        finished, _ = wait(futures, timeout=POLL_SECONDS, return_when=FIRST_COMPLETED)
        _pass_on(messages, watcher)
        for future in finished:
            cell = futures.pop(future)
            try:
                result = future.result()
            except BrokenProcessPool:
                lost.append(cell)
            else:
                watcher.end(cell, result["status"], result["failure"])
    return lost


def _pass_on(messages: Any, watcher: Watcher) -> None:
    while messages is not None:
        try:
            watcher.update(*messages.get_nowait())
        except queue.Empty:
            return
