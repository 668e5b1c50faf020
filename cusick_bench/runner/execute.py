"""Runs a grid, in this process or in a pool; one failed cell, or a worker that dies, never stops the others."""

import multiprocessing
import os
import queue
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache
from pathlib import Path
from typing import Any

import torch

from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.runner.cell import run_cell
from cusick_bench.runner.environment import cores, environment
from cusick_bench.runner.errors import RunnerError
from cusick_bench.runner.grid import Cell
from cusick_bench.runner.progress import Unwatched, Watcher
from cusick_bench.runner.store import Store, read_json, write_json

# A worker that dies (killed for memory, say) takes its pool along: unfinished cells are tried so often.
ATTEMPTS = 2
POLL_SECONDS = 0.2  # between looks at the workers' messages


@lru_cache(maxsize=1)
def _loaded(source: tuple[tuple[str, Any], ...]) -> DrapeDataset:
    """A worker's data set: loaded once, not sent along with every cell."""
    return load(**dict(source))


def _limit_threads(threads: int) -> None:
    """Keeps the workers of a pool from fighting for the same cores."""
    import numba

    torch.set_num_threads(threads)
    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))


def _work(source: tuple[tuple[str, Any], ...], cell: Cell, out: Path, messages: Any) -> dict[str, Any]:
    """Runs one cell in a worker process."""
    last = 0.0

    def report(fraction: float, loss: float, message: str) -> None:
        nonlocal last
        if time.monotonic() - last > POLL_SECONDS:
            last = time.monotonic()
            messages.put((cell, fraction, loss, message))

    return run_cell(_loaded(source), cell, Store(out), report)


def run(
    source: dict[str, Any],
    cells: Sequence[Cell],
    out: Path,
    *,
    workers: int = 1,
    executor: Executor | None = None,
    watcher: Watcher | None = None,
    command: Sequence[str] = (),
) -> list[dict[str, Any]]:
    """Runs the cells that are not finished yet.

    Args:
        source: Arguments of `cusick_bench.datasets.load`; values that can be hashed.
        cells: From `plan`.
        out: Results folder.
        workers: Processes; 1 runs everything here, with all threads.
        executor: Something else to run on, instead of a pool of `workers` processes. Its workers must see `out`.
        watcher: Told how the grid gets on.
        command: Command line, for the record.

    Returns:
        Results in the order of the cells.

    Raises:
        RunnerError: `out` cannot be written; finished cells are kept.
    """
    if workers < 1:
        raise RunnerError(f"--workers must be >= 1, got {workers}")
    store, watcher = Store(out), watcher or Unwatched()
    store.prepare()
    frozen = tuple(sorted(source.items()))
    _record_run(store, _loaded(frozen), cells, command)
    waiting = [cell for cell in cells if not store.is_done(cell.key)]
    watcher.begin(len(cells), len(cells) - len(waiting))
    if waiting and workers == 1 and executor is None:
        _run_here(_loaded(frozen), waiting, store, watcher)
    elif waiting:
        _run_on_pools(frozen, waiting, store, watcher, workers, executor)
    return [store.result(cell.key) for cell in cells]


def _run_here(dataset: DrapeDataset, cells: list[Cell], store: Store, watcher: Watcher) -> None:
    for cell in cells:

        def report(fraction: float, loss: float, message: str, cell: Cell = cell) -> None:
            watcher.update(cell, fraction, loss, message)

        watcher.update(cell, 0.0, float("inf"), "starting")
        result = run_cell(dataset, cell, store, report)
        watcher.end(cell, result["status"], result["failure"])


def _run_on_pools(
    source: tuple[tuple[str, Any], ...],
    cells: list[Cell],
    store: Store,
    watcher: Watcher,
    workers: int,
    executor: Executor | None,
) -> None:
    """Pools in turn: a broken one is replaced, with one worker so that the culprit is the only one to die."""
    waiting = list(cells)
    for attempt in range(ATTEMPTS):
        count = workers if attempt == 0 else 1
        pools: list[list[Cell]] = [waiting] if attempt == 0 else [[cell] for cell in waiting]
        waiting = []
        for batch in pools:
            pool = executor or _process_pool(count)
            try:
                waiting += _run_on(pool, source, batch, store, watcher)
            finally:
                if executor is None:
                    pool.shutdown(wait=False, cancel_futures=True)
        if not waiting:
            return
    for cell in waiting:
        failure = f"its process died {ATTEMPTS} times (killed for want of memory?)"
        folder = store.folder(cell.key)
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / "result.json", cell.record() | _died(failure))
        watcher.end(cell, "failed", failure)


def _died(failure: str) -> dict[str, Any]:
    return {"status": "failed", "failure": failure, "traceback": "", "metrics": {}, "spent": {}}


def _process_pool(workers: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_limit_threads,
        initargs=(max(1, cores() // workers),),
    )


def _run_on(
    pool: Executor,
    source: tuple[tuple[str, Any], ...],
    cells: list[Cell],
    store: Store,
    watcher: Watcher,
) -> list[Cell]:
    """Runs cells on a pool and returns those that were lost with a worker that died."""
    lost: list[Cell] = []
    with multiprocessing.get_context("spawn").Manager() as manager:
        messages = manager.Queue()
        futures: dict[Future, Cell] = {pool.submit(_work, source, cell, store.out, messages): cell for cell in cells}
        while futures:
            finished, _ = wait(futures, timeout=POLL_SECONDS, return_when=FIRST_COMPLETED)
            _drain(messages, watcher.update)
            for future in finished:
                cell = futures.pop(future)
                try:
                    result = future.result()
                except BrokenProcessPool:
                    lost.append(cell)
                else:
                    watcher.end(cell, result["status"], result["failure"])
    return lost


def _drain(messages: Any, update: Callable[[Cell, float, float, str], None]) -> None:
    while True:
        try:
            update(*messages.get_nowait())
        except queue.Empty:
            return


def _record_run(store: Store, dataset: DrapeDataset, cells: Sequence[Cell], command: Sequence[str]) -> None:
    """Writes run.json; earlier runs into the same folder stay on record in its history."""
    path = store.out / "run.json"
    history = []
    if path.exists():
        earlier = read_json(path)
        history = [*earlier.pop("history", []), earlier]
    record = {
        "command": list(command),
        "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "process": os.getpid(),
        "dataset": dataset.name,
        "dataset_hash": dataset.content_hash,
        "cells": [cell.key for cell in cells],
        **environment(),
        "history": history,
    }
    write_json(path, record)
