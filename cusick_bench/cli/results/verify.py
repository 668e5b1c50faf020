"""`cusick-bench verify`: cells repeated from what they stored; exit status 1 if one has another result."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from cusick_bench.cli.common import interruptible, output, print_json, tell, user_errors
from cusick_bench.cli.completion import complete_solver
from cusick_bench.cli.options import MOST_DRAWS, Cloths, Json, RunsData, RunsFabricsCsv, Seed, fit_option
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.written_paths import folder_made
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.leaderboard.verification.comparison import METRIC, METRIC_SAME, PIXEL, REDRAWN, SHAPE, STATED
from cusick_bench.runner.labels import unspaced
from cusick_bench.runner.store import CELL_FILE

if TYPE_CHECKING:
    from cusick_bench.leaderboard.cells.loading import Cells
    from cusick_bench.leaderboard.verification.verify import Verification


_KEPT_EVERY = 60.0  # [s] after which what was found is written, for a kill loses what was not
_STYLES = {"verified": "green", "rescored": "yellow", "differs": "bold red", "unreadable": "bold red"}

app = typer.Typer()


@app.command("verify")
@user_errors
def verify_command(
    target: Annotated[
        Path, typer.Argument(help="Folder of `run --out`, or of one of its cells (RUN/cells/KEY).", metavar="RUN")
    ],
    solver: Annotated[
        list[str] | None, fit_option(help="Solver; repeatable; by default all.", autocompletion=complete_solver)
    ] = None,
    cloth: Cloths = None,
    data: RunsData = None,
    fabrics_csv: RunsFabricsCsv = None,
    committed: Annotated[
        Path | None, typer.Option("--against", help="Table of `submit` whose lines of this run are compared as well.")
    ] = None,
    draws: Annotated[
        int, typer.Option(min=0, max=MOST_DRAWS, help="Draws of each cell's posterior to drape again.")
    ] = REDRAWN,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Drape the stored parameters of finished cells again and score them again: *reported* becomes *verified*.

    The outcome is kept in RUN/verified.json, from which `submit` marks rows. Exit status 1 if a cell's scores cannot
    be reproduced.
    """
    from cusick_bench.leaderboard.cells.loading import load_cells
    from cusick_bench.leaderboard.cells.source import data_set_of, load_data_of, only_of
    from cusick_bench.leaderboard.verification.verify import VERIFIED, keep, unreadable, verify_cell
    from cusick_bench.sim.setup import Simulators

    if (target / CELL_FILE).is_file():
        target = Path(os.path.abspath(target))  # a relative path, such as `.`, need not name the run's folder
        run = target.parent.parent
    else:
        run = target
    cells = load_cells(run, changed=True)
    own = data_set_of(cells, data)  # cells of others cannot be judged by it, and keep what is known of them
    judged = only_of(cells, own)
    table, damaged = judged.table, [cell for cell in judged.skipped if cell.status == "damaged"]
    if others := sorted(set(cells.table["dataset"]) - {own}):
        tell(f"cells on {own} are verified; for {', '.join(others)} give their data with --data")
    if run != target:
        table = table.loc[[folder.name == target.name for folder in table["folder"]]]
        damaged = [cell for cell in damaged if cell.folder.name == target.name]
    for name, wanted in (("solver", [unspaced(text) for text in solver or []]), ("cloth", cloth)):
        there = set(table[name]) | {getattr(cell, name) for cell in damaged} - {""}
        if unknown := sorted(set(wanted or []) - there):
            known = ", ".join(sorted(there))
            raise LeaderboardError(f"{run} holds no {name} {', '.join(unknown)}; it holds {known}")
        table = table.loc[table[name].isin(wanted)] if wanted else table
        damaged = [cell for cell in damaged if not wanted or getattr(cell, name) in wanted]
    if table.empty and not damaged:
        raise LeaderboardError(f"{target} is not finished; repeat its `cusick-bench run` command to go on")
    dataset = load_data_of(judged if table.empty else replace(judged, table=table), data, fabrics_csv)
    of_these = [state == dataset.content_hash for state in table["dataset_hash"]]
    if any(of_these) and not all(of_these):
        tell(f"{of_these.count(False)} cells on other data of that name are left aside; give theirs with --data")
        table = table.loc[of_these]
    verifications, simulators = [unreadable(cell) for cell in damaged], Simulators()
    kept = interruptible(lambda: _kept(len(verifications), len(table) + len(damaged), run / VERIFIED))
    with kept, folder_made(run), progress_bar("cells", len(table)) as bar:
        due = monotonic() + _KEPT_EVERY
        try:
            for folder, name, where in zip(table["folder"], table["solver"], table["cloth"], strict=True):
                bar.begin(f"{name} on {where}")
                verifications.append(verify_cell(folder, dataset, redrawn=draws, seed=seed, simulators=simulators))
                if monotonic() >= due:
                    keep(run, verifications)
                    due = monotonic() + _KEPT_EVERY
        finally:
            if verifications:
                keep(run, verifications)
    wrong = _altered(committed, cells) if committed else {}
    _show(run, verifications, wrong, as_json)
    if wrong or any(verification.status in ("differs", "unreadable") for verification in verifications):
        raise typer.Exit(1)


def _kept(done: int, every: int, path: Path) -> str:
    """What an interruption leaves behind, in words."""
    if not done:
        return f"no cell of {every} was looked at to its end, and nothing was written"
    cells = f"{done} cell{'s' * (done != 1)} of {every}"
    return f"{cells} were looked at, and {path} says what was found; --solver and --cloth choose the others"


def _altered(path: Path, cells: Cells) -> dict[str, list[str]]:
    """Lines of a committed table that do not say what the run says, by solver.

    Raises:
        LeaderboardError: No line of it is of this run.
    """
    from cusick_bench.leaderboard.verification.submit import altered, read_rows, rows_of

    rows = {row["row"]: row for row in rows_of(cells, "any")}
    lines = [line for line in read_rows(path).to_dict("records") if line["row"] in rows]  # of any track
    if not lines:
        raise LeaderboardError(f"no line of {path} is of {cells.folder}; give the run that it was submitted from")
    found: dict[str, list[str]] = {}
    for line in lines:
        made = rows[line["row"]]
        found.setdefault(made["solver"], []).extend(altered({str(name): text for name, text in line.items()}, made))
    return {solver: wrong for solver, wrong in found.items() if wrong}


def _show(run: Path, verifications: list[Verification], wrong: dict[str, list[str]], as_json: bool) -> None:
    rows = _rows(verifications)
    if as_json:
        found = [verification.record() for verification in verifications]
        print_json({"run": run, "rows": rows, "altered": wrong, "cells": found})
        return
    table = Table("status", "solver", "cloth", "seed", "what does not hold, by how much (tolerance)")
    for found in verifications:
        worst = [f"{c.name} {c.difference:.2g} ({c.tolerance:.2g}): {c.detail}" for c in found.broken[:3]]
        more = [f"and {len(found.broken) - 3} more"] if len(found.broken) > 3 else []
        reasons = "\n".join([*worst, *more, *(found.notes if found.status == "unreadable" else ())])
        table.add_row(
            found.status, found.solver, found.cloth, str(found.seed), reasons, style=_STYLES.get(found.status, "")
        )
    output.print(table)
    for note in sorted({note for found in verifications if found.status != "unreadable" for note in found.notes}):
        output.print(note, style="dim")
    output.print(
        f"Tolerances: {1e3 * SHAPE:g} mm of a vertex, {PIXEL:g} of a pixel, {100 * METRIC:g} % of a metric "
        f"({100 * METRIC_SAME:g} % where the stored draws themselves are scored), {100 * STATED:g} % of a stiffness.",
        style="dim",
    )
    for row in rows:
        output.print(f"{row['solver']}: {row['status']}, {row['verified']} of {row['cells']} cells")
    for solver, numbers in wrong.items():
        output.print(f"{solver}'s line in the table was altered: {'; '.join(numbers)}", style="bold red")


def _rows(verifications: list[Verification]) -> list[dict[str, str | int]]:
    """A line a solver: verified where all of its cells are."""
    rows = []
    for solver in sorted({found.solver for found in verifications}):
        own = [found for found in verifications if found.solver == solver]
        verified = sum(found.status == "verified" for found in own)
        status = "verified" if verified == len(own) else "reported"
        rows.append({"solver": solver, "status": status, "verified": verified, "cells": len(own)})
    return rows
