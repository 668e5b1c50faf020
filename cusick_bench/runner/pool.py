"""Worker processes: cells run in pools, and a worker that dies costs no cell but its own."""

import multiprocessing
import queue
import time
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numba
import torch

from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.runner.cell import run_cell
from cusick_bench.runner.environment import cores
from cusick_bench.runner.grid import Cell
from cusick_bench.runner.progress import Watcher
from cusick_bench.runner.store import Store

POLL_SECONDS = 0.2  # between looks at the workers' messages

# In a worker: where its messages go.
_messages: Any = None


@dataclass(frozen=True)
class Source:
    """Where a data set comes from: what workers are sent instead of the data.

    Attributes:
        data: Name or folder.
        fabrics_csv: Table of areal densities, None for the one beside the data.
    """

    data: str
    fabrics_csv: str | None = None


@lru_cache(maxsize=1)
def load_once(source: Source) -> DrapeDataset:
    """The data set of a source, loaded once a process."""
    return load(source.data, fabrics_csv=source.fabrics_csv)


def _start_worker(threads: int, messages: Any) -> None:
    """Keeps the workers from fighting for the same cores, and tells this one where its messages go."""
    global _messages
    _messages = messages
    torch.set_num_threads(threads)
    numba.set_num_threads(min(threads, numba.get_num_threads()))


def _work(source: Source, cell: Cell, out: Path) -> dict[str, Any]:
    """Runs one cell in a worker."""
    last = 0.0

    def report(fraction: float, loss: float, message: str) -> None:
        nonlocal last
        if _messages is not None and time.monotonic() - last > POLL_SECONDS:
            last = time.monotonic()
            _messages.put((cell, fraction, loss, message))

    return run_cell(load_once(source), cell, Store(out), report)


def _process_pool(workers: int, messages: Any) -> Executor:
    return ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_start_worker,
        initargs=(max(1, cores() // workers), messages),
    )


def run_on_processes(source: Source, cells: Sequence[Cell], store: Store, watcher: Watcher, workers: int) -> list[Cell]:
    """Runs cells on a pool of processes, and those lost with a dead worker once more, each alone.

    Returns:
        Cells whose own process died twice.
    """
    lost = _run_on_a_pool(source, cells, store, watcher, workers)
    return [cell for cell in lost if _run_on_a_pool(source, [cell], store, watcher, 1)]


def _run_on_a_pool(source: Source, cells: Sequence[Cell], store: Store, watcher: Watcher, workers: int) -> list[Cell]:
    messages = multiprocessing.get_context("spawn").Queue()
    pool = _process_pool(min(workers, len(cells)), messages)
    try:
        return run_on_executor(pool, source, cells, store, watcher, messages)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def run_on_executor(
    pool: Executor, source: Source, cells: Sequence[Cell], store: Store, watcher: Watcher, messages: Any = None
) -> list[Cell]:
    """Runs cells on any executor whose workers see the results folder.

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
