"""`cusick-bench leaderboard`: solvers of a results folder, ranked beside the floor and the rows without physics."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cusick_bench.cli.common import output, print_json, tell, user_errors
from cusick_bench.cli.options import By, Json, RunFolder, Seed, output_option
from cusick_bench.cli.progress import progress_bar
from cusick_bench.leaderboard import LeaderboardError
from cusick_bench.sim.errors import CusickError

if TYPE_CHECKING:
    from cusick_bench.datasets import DrapeDataset
    from cusick_bench.leaderboard import Cells, Leaderboard, StiffnessRow


FORMS = (".csv", ".parquet", ".md", ".tex", ".html")

STIFFNESS_FORMS = (".csv", ".md", ".tex", ".html")

app = typer.Typer()


class StatisticName(StrEnum):
    """How cells are averaged."""

    mean = "mean"
    iqm = "iqm"


@app.command()
@user_errors
def leaderboard(
    folder: RunFolder,
    out: Annotated[
        list[Path] | None,
        output_option(help="File for the table: .csv or .parquet (every number), .md, .tex or .html; repeatable."),
    ] = None,
    every_cell: Annotated[
        list[Path] | None,
        output_option(
            "--cells", help="File for every number of every finished cell: .csv or .parquet (pyarrow); repeatable."
        ),
    ] = None,
    stiffness: Annotated[
        list[Path] | None,
        output_option(help="File for the stiffness found, by solver and cloth: .csv, .md, .tex or .html; repeatable."),
    ] = None,
    by: By = "test_mse",
    statistic: Annotated[StatisticName, typer.Option(help="Average over cells.")] = StatisticName.mean,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Rank the solvers of a results folder, and list the stiffness that they found."""
    from cusick_bench.files.table_file import TABLE_FORMS, require_pyarrow, table_bytes
    from cusick_bench.leaderboard import (
        cell_table,
        leaderboards,
        load_cells,
        record,
        stiffness_records,
        stiffness_rows,
        stiffness_table,
        terminal,
        text_table,
    )

    for paths, forms in ((out, FORMS), (stiffness, STIFFNESS_FORMS), (every_cell, TABLE_FORMS)):
        for path in paths or []:
            if path.suffix not in forms:
                raise LeaderboardError(f"cannot write {path}: its name must end in one of {', '.join(forms)}")
            if path.suffix == ".parquet":
                require_pyarrow(str(path), instead="write .csv")
    with progress_bar("reading cells") as bar:
        cells = load_cells(folder, progress=bar.show)
    with progress_bar("ranking"):
        boards = leaderboards(cells, by=by, statistic=statistic.value, seed=seed)
    found = stiffness_rows(cells, seed=seed)
    for path in out or []:
        _write(path, _form(boards, path))
    if every_cell:
        numbers = cell_table(cells, _data_of_split(cells))
        for path in every_cell:
            _write(path, table_bytes(numbers, path))
    for path in stiffness or []:
        _write(path, _stiffness_form(found, path.suffix).encode())
    if as_json:
        skipped = [
            {"path": cell.folder, "status": cell.status, "reason": cell.reason, "solver": cell.solver}
            | {"cloth": cell.cloth, "seed": cell.seed}
            for cell in cells.skipped
        ]
        rows = [record(board, row) for board in boards for row in board.rows]
        notes = [note for board in boards for note in board.notes]
        print_json({"rows": rows, "stiffness": stiffness_records(found), "skipped": skipped, "notes": notes})
        return
    for board in boards:
        output.print(terminal(board, output.width))
        for note in text_table(board).notes:
            output.print(note, style="dim")
    if found:
        table = stiffness_table(found)
        output.print(terminal(table, output.width))
        for note in table.notes:
            output.print(note, style="dim")


def _data_of_split(cells: Cells) -> DrapeDataset | None:
    """Data that tell which samples the cells leave out in turn; None where none are, or, said so, without the data."""
    from cusick_bench.datasets.splits import LEAVE_ONE_OUT
    from cusick_bench.leaderboard.cells.source import load_data_of

    if LEAVE_ONE_OUT not in set(cells.table["protocol"]):
        return None
    try:
        dataset = load_data_of(cells)
    except (CusickError, OSError) as error:
        tell(f"which samples were left out cannot be told: {error}")
        return None
    if dataset.content_hash not in set(cells.table["dataset_hash"]):
        tell(f"which samples were left out cannot be told: {dataset.name} is not what the run used")
    return dataset


def _write(path: Path, content: bytes) -> None:
    from cusick_bench.runner.store import write_atomically

    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, content)
    tell(f"wrote {path}")


def _stiffness_form(rows: list[StiffnessRow], suffix: str) -> str:
    from cusick_bench.leaderboard import html_table, latex, markdown, stiffness_rows_csv, stiffness_table

    if suffix == ".csv":
        return stiffness_rows_csv(rows)
    return {".md": markdown, ".tex": latex, ".html": html_table}[suffix](stiffness_table(rows))


def _form(boards: list[Leaderboard], path: Path) -> bytes:
    from cusick_bench.files.table_file import TABLE_FORMS, table_bytes
    from cusick_bench.leaderboard import board_table, html_table, latex, markdown

    if path.suffix in TABLE_FORMS:
        return table_bytes(board_table(boards), path)
    form = {".md": markdown, ".tex": latex, ".html": html_table}[path.suffix]
    return "\n".join(form(board) for board in boards).encode()
