"""Runs a grid, in this process, in a pool, or on an executor; one failed cell never stops the others."""

import logging
import os
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.impossible import require_possible, require_readable
from cusick_bench.datasets.splits import left_out_sample
from cusick_bench.files.folder_lock import locked
from cusick_bench.runner.cell import SIMULATORS_KEPT, run_cell
from cusick_bench.runner.environment import code_state, environment
from cusick_bench.runner.errors import CellIsRunning, RunnerError
from cusick_bench.runner.executors.executor import CellExecutor
from cusick_bench.runner.executors.pool import Borrowed, Processes
from cusick_bench.runner.executors.turns import Turns
from cusick_bench.runner.grid import Cell
from cusick_bench.runner.progress import Unwatched, Watcher
from cusick_bench.runner.results import Results
from cusick_bench.runner.source import Source, load_once, load_planned
from cusick_bench.runner.store import RESULT_FILE, Store, disk_errors, read_json, write_json
from cusick_bench.runner.warm_up import WarmUp
from cusick_bench.sim.setup import Simulators

_log = logging.getLogger(__name__)


def run(
    source: Source,
    cells: Sequence[Cell],
    out: Path,
    *,
    workers: int = 1,
    executor: Executor | CellExecutor | None = None,
    watcher: Watcher | None = None,
    command: Sequence[str] = (),
    force: bool = False,
    grid: Sequence[Cell] = (),
) -> Results:
    """Runs the cells that are not finished yet; those that another process is running come last, and are waited for.

    Args:
        source: Where the data come from.
        cells: From `plan`.
        out: Results folder.
        workers: Processes; 1 runs everything here, with all threads.
        executor: Something else to run on, instead of a pool of `workers` processes: `Submitted`, or any executor of
            `concurrent.futures`. Its workers must see `out`.
        watcher: Told of the grid's progress.
        command: Command line, for the record.
        force: Whether to use silhouettes that no cloth on the plate can show; the record says so.
        grid: Cells of the whole grid, where `cells` are a part of it; the record names them, so that it is known what
            the other parts have to bring.

    Returns:
        Results in the order of the cells, each read from its file when it is asked for; with `left_out`, the number of
        the sample, where samples are left out in turn.

    Raises:
        DataError: A silhouette of the cells that cannot be read, or without `force` one that no cloth on the plate can
            show; or the data have changed since the cells were planned.
        RunnerError: `out` cannot be written; finished cells are kept.
    """
    if workers < 1:
        raise RunnerError(f"workers must be >= 1, got {workers}")
    store, watcher = Store(out), watcher or Unwatched()
    dataset = load_once(source)
    for planned in sorted({cell.dataset_hash for cell in cells}):
        dataset = load_planned(source, planned)
    rows = {row for cell in cells for row in (*cell.train, *cell.test)}
    forced = require_possible(dataset, rows, force=force)
    require_readable(dataset, rows)
    store.prepare()
    with disk_errors(out), locked(out):
        _record_run(store, source, dataset, cells, grid or cells, command, forced)
    waiting = [cell for cell in cells if not store.is_done(cell.key)]
    watcher.begin(cells, waiting)
    _log.debug("%d cells, %d of them finished before; %d workers", len(cells), len(cells) - len(waiting), workers)
    for cell in waiting:
        _log.debug("cell %s: %s on %s, seed %d, %s", cell.key, cell.solver, cell.cloth, cell.seed, cell.settings)
    chosen = _executor(executor, workers)
    if chosen is None:
        _run_here(dataset, waiting, store, watcher)
    else:
        for cell in chosen.run(source, waiting, store, watcher):
            _record_death(cell, chosen.death, store, watcher)
    samples = {cell.key: left_out_sample(dataset.table, cell.protocol, cell.test) for cell in cells}
    return Results(store, cells, {key: sample for key, sample in samples.items() if sample is not None})


def _executor(given: Executor | CellExecutor | None, workers: int) -> CellExecutor | None:
    """Executor of the cells; None for this process itself."""
    if isinstance(given, Executor):
        return Borrowed(given)
    return Processes(workers) if given is None and workers > 1 else given


def _run_here(dataset: DrapeDataset, cells: Sequence[Cell], store: Store, watcher: Watcher) -> None:
    simulators, warm_up = Simulators(most=SIMULATORS_KEPT), WarmUp()
    turns = Turns(cells, watcher)
    for cell in turns:

        def report(fraction: float, loss: float, message: str, cell: Cell = cell) -> None:
            watcher.update(cell, fraction, loss, message)

        report(0.0, float("inf"), "starting")
        warm_up.before(dataset, cell)
        try:
            result = run_cell(dataset, cell, store, report, simulators)
        except CellIsRunning:
            turns.put_off(cell)
            continue
        watcher.end(cell, result["status"], result["failure"])


def _record_death(cell: Cell, failure: str, store: Store, watcher: Watcher) -> None:
    """A cell whose process was killed cannot say so itself; one that had finished before keeps its result."""
    if store.is_done(cell.key):
        watcher.end(cell, "done", "")
        return
    outcome = {"status": "failed", "failure": failure, "traceback": "", "metrics": {}, "spent": {}}
    folder = store.folder(cell.key)
    with disk_errors(store.out):
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / RESULT_FILE, cell.record() | outcome | {"code": code_state()})
    watcher.end(cell, "failed", failure)


def _record_run(
    store: Store,
    source: Source,
    dataset: DrapeDataset,
    cells: Sequence[Cell],
    grid: Sequence[Cell],
    command: Sequence[str],
    forced: Sequence[str],
) -> None:
    """Writes run.json; earlier runs into the same folder stay on record in its history."""
    path = store.out / "run.json"
    history = []
    if path.exists():
        try:
            earlier = read_json(path)
            asked = {cell.key for cell in cells}
            history = [_short(one, asked) for one in [*_history(earlier.pop("history", []), path), earlier]]
        except RunnerError as error:
            _log.warning("%s; the history of commands begins anew", error)
    record = {
        "command": list(command),
        "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "process": os.getpid(),
        "dataset": dataset.name,
        "dataset_hash": dataset.content_hash,
        "source": source.places(store.out),
        "cells": [cell.key for cell in cells],
        **({"grid": [cell.key for cell in grid]} if len(grid) > len(cells) else {}),
        "numerics": {part: number for cell in cells for part, number in cell.numerics},
        **environment(),
        "forced": list(forced),
        "history": history,
    }
    write_json(path, record)


def _short(earlier: Any, asked: set[str]) -> Any:
    """An earlier record without what only the last one is asked for: its grid, and cells that all are asked for again.

    In a grid of thousands of cells these are nearly all of it, and a hundred shards would make a file beyond what is
    read.
    """
    if not isinstance(earlier, dict):
        return earlier
    cells = earlier.get("cells")
    again = isinstance(cells, list) and all(isinstance(key, str) and key in asked for key in cells)
    left_out = {"grid", "cells"} if again else {"grid"}
    return {name: value for name, value in earlier.items() if name not in left_out}


def _history(history: Any, path: Path) -> list[Any]:
    """Records of earlier commands, where they are any."""
    if not isinstance(history, list):
        raise RunnerError(f"{path} is damaged (its history is no list)")
    return history
