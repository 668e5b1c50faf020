"""Runs the cells that a command has planned, and reads back exactly these."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from cusick_bench.cli.common import fail, interruptible
from cusick_bench.cli.fit.grid_progress import GridProgress, cells_kept
from cusick_bench.leaderboard import LeaderboardError

if TYPE_CHECKING:
    from cusick_bench.leaderboard import Cells
    from cusick_bench.runner import Cell, Source


def run_planned(source: Source, planned: Sequence[Cell], out: Path, *, workers: int, force: bool) -> Cells:
    """Runs what is not finished yet, with progress.

    Args:
        source: Where the data are.
        planned: The cells.
        out: Results folder, however many others lie in it.
        workers: Number of processes.
        force: Use silhouettes that no cloth on its plate can show.

    Returns:
        The planned cells.

    Raises:
        typer.Exit: Every one of them failed; the exit status is 1, as where some have.
        LeaderboardError: Those that finished are damaged.
    """
    from cusick_bench.leaderboard import load_cells
    from cusick_bench.runner import run

    progress = GridProgress()
    with interruptible(partial(cells_kept, progress, out), go_on=True):
        with progress:
            results = run(source, list(planned), out, workers=workers, watcher=progress, command=sys.argv, force=force)
        if all(result["status"] == "failed" for result in results):
            fail(f"every cell failed; see cells/*/result.json in {out}, and repeat the command to try them again")
            raise typer.Exit(1)
        cells = load_cells(out)
    keys = {cell.key for cell in planned}
    kept = cells.table.loc[[folder.name in keys for folder in cells.table["folder"]]].reset_index(drop=True)
    if kept.empty:
        raise LeaderboardError(f"no cell of this command in {out} can be read; repeat the command to go on")
    return replace(cells, table=kept, skipped=tuple(s for s in cells.skipped if s.folder.name in keys))
