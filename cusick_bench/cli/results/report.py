"""`cusick-bench report`: one self-contained HTML page of a results folder, with pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from cusick_bench.cli.common import interruptible, print_json, tell, user_errors
from cusick_bench.cli.options import By, Json, RunFolder, RunsData, Seed, output_option
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.written_paths import folder_made
from cusick_bench.datasets import DataError
from cusick_bench.report import ReportError
from cusick_bench.runner.store import RESULT_FILE, read_json
from cusick_bench.sim.errors import CusickError

if TYPE_CHECKING:
    from cusick_bench.datasets import DrapeDataset
    from cusick_bench.datasets.files.protocol import Protocol
    from cusick_bench.leaderboard import Cells
    from cusick_bench.report.run.page import Unseen


app = typer.Typer()


@app.command()
@user_errors
def report(
    folder: RunFolder,
    out: Annotated[Path | None, output_option(help="Page to write; by default RUN/report.html.")] = None,
    pictures: Annotated[Path | None, output_option(help="Folder for one side-by-side PNG a cell.")] = None,
    data: RunsData = None,
    compare: Annotated[
        Path | None, typer.Option(help="Results folder of another run, to compare this one with.", metavar="OTHER")
    ] = None,
    by: By = "test_mse",
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Write an HTML page with the leaderboard and pictures of every fit, with drapes that can be turned in 3D."""
    from cusick_bench.leaderboard import leaderboards, load_cells, variants
    from cusick_bench.leaderboard.cells.source import data_set_of, only_of
    from cusick_bench.report import write_report

    out = out or folder / "report.html"
    if out.suffix not in (".html", ".htm"):
        raise ReportError(f"cannot write {out}: its name must end in .html")
    if out.is_dir():
        raise ReportError(f"cannot write {out}: it is a folder; choose another --out")
    with progress_bar("reading cells") as bar:
        everything = load_cells(folder, progress=bar.show)
    shown = data_set_of(everything, data)
    cells = only_of(everything, shown)
    if others := sorted(set(everything.table["dataset"]) - {shown}):
        tell(f"the page is of {shown}; for {', '.join(others)} give their data with --data, and another --out")
    boards = leaderboards(cells, by=by, seed=seed)
    with progress_bar("reading cells to compare with") as bar:
        other = None if compare is None else load_cells(compare, progress=bar.show)
    if other is not None and shown in set(other.table["dataset"]):
        other = only_of(other, shown)
    kept = "no page was written" + (f"; pictures that were ready are in {pictures}" if pictures else "")
    fits = sum(len(set(group["cloth"])) for _, group in variants(cells.table))
    room = (folder_made(out.parent), folder_made(pictures))
    with progress_bar("reading data", fits) as bar, interruptible(kept), room[0], room[1]:
        unseen, protocol = _of_data(cells, data)
        files = write_report(
            cells,
            boards,
            out,
            unseen=unseen,
            protocol=protocol,
            pictures=pictures,
            compared=other,
            seed=seed,
            progress=lambda message: bar.begin(f"drawing {message}"),
        )
    for path in files:
        tell(f"wrote {path}")
    if as_json:
        print_json({"report": out, "bytes": out.stat().st_size, "files": files, "cells": len(cells.table)})


def _of_data(cells: Cells, data: str | None) -> tuple[Unseen, Protocol]:
    """Radii of each split's unseen samples, and the data's protocol.

    Where the data have changed there are no radii; where they are others, of other sizes, neither is their protocol
    used, but the release's, with a warning.
    """
    from cusick_bench.datasets.files.protocol import RELEASE
    from cusick_bench.leaderboard.cells.source import load_data_of

    try:
        dataset = load_data_of(cells, data)
        own = cells.table.loc[cells.table["dataset_hash"] == dataset.content_hash]
        if own.empty and (data is not None or not _alike(cells, dataset)):
            raise DataError(f"{dataset.name} is not what the run used", remedy="give the run's data with --data")
        if own.empty:
            tell(f"no band of unseen samples: {dataset.name} has changed since the run")
        splits = set(zip(own["dataset_hash"], own["cloth"], own["test"], strict=True))
        unseen = {(state, cloth, rows): _radii(dataset, rows) for state, cloth, rows in splits if rows}
        return unseen, dataset.protocol
    except (CusickError, OSError) as error:
        if data is not None:
            raise
        tell(f"no band of unseen samples, and sizes are taken as the public release's: {error}")
        return {}, RELEASE


def _alike(cells: Cells, dataset: DrapeDataset) -> bool:
    """Whether all cells are of this data set, and of its sizes and camera, in whatever state it was."""
    sizes = dataset.protocol.unlike_release()
    return set(cells.table["dataset"]) == {dataset.name} and all(
        read_json(folder / RESULT_FILE).get("nominal", {}) == sizes for folder in cells.table["folder"]
    )


def _radii(dataset: DrapeDataset, rows: tuple[int, ...]) -> np.ndarray:
    return np.stack([dataset.sample(row).profile.radii for row in rows])
