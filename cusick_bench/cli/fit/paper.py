"""`cusick-bench paper`: the paper's tables, made by one command each, beside its published figures."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cusick_bench.cli.common import interruptible, output, print_json, tell, user_errors
from cusick_bench.cli.completion import complete_solver
from cusick_bench.cli.fit import paper_figures
from cusick_bench.cli.fit.planned_cells import run_planned
from cusick_bench.cli.options import (
    LAW,
    MOST_DRAWS,
    Data,
    DropMode,
    FabricsCsv,
    FirstSeed,
    FittedCloths,
    Force,
    Json,
    Law,
    LawName,
    Membrane,
    MembraneName,
    Mode,
    Seeds,
    Steps,
    Vertices,
    Workers,
    fit_option,
    membrane_asked,
    output_option,
    simulation_option,
)
from cusick_bench.cli.options import Budget as DrapesBudget
from cusick_bench.cli.progress import Bar, progress_bar
from cusick_bench.files.json_text import json_text
from cusick_bench.problem import Budget
from cusick_bench.runner import RunnerError
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.constants import VERTICES_OF_PAPER

if TYPE_CHECKING:
    from cusick_bench.leaderboard import Cells
    from cusick_bench.leaderboard.paper import PaperTable
    from cusick_bench.runner import ProblemSettings, Source


app = typer.Typer(help="The paper's tables and figures on given data.", no_args_is_help=True, add_completion=False)
paper_figures.register(app)

Out = Annotated[Path, output_option(help="Folder for cells and tables; finished cells in it are kept.")]
Solver = Annotated[
    list[str] | None,
    fit_option(
        help="Solver: NAME, NAME,option=value or NAME@space; repeatable; by default all of the table.",
        autocompletion=complete_solver,
    ),
]
Draws = Annotated[
    int,
    fit_option(
        min=1, max=MOST_DRAWS, help="Draws of each solver that learns a distribution, and of the random-phase row."
    ),
]
SecondLaw = Annotated[
    LawName | None,
    simulation_option(help="Law by which everything is run once more, for rows of its own (paper: as in the paper)."),
]
Seconds = Annotated[
    float | None,
    fit_option(help="Also run with this wall time a cell as the only limit [s]."),
]


@dataclass(frozen=True)
class _Grid:
    """Settings of a table's cells."""

    name: str
    source: Source
    cloths: list[str] | None
    solvers: list[str] | None
    settings: list[ProblemSettings]
    draws: int
    seeds: range
    workers: int
    out: Path
    force: bool


@app.command("table-1")
@user_errors
def table_1(
    out: Out,
    data: Data = "cusick",
    fabrics_csv: FabricsCsv = None,
    cloth: FittedCloths = None,
    force: Force = False,
    solver: Solver = None,
    vertices: Vertices = VERTICES_OF_PAPER,
    draws: Draws = 1000,
    seeds: Seeds = 1,
    seed: FirstSeed = 0,
    budget: DrapesBudget = 500,
    mode: DropMode = Mode.drop,
    steps: Steps = 100,
    law: Law = LAW,
    membrane: Membrane = None,
    second_law: SecondLaw = None,
    workers: Workers = 1,
    as_json: Json = False,
) -> None:
    """Table 1, prediction of unseen samples: HOMO, HETER, BDP and `bdp-field`, beside null rows and oracles.

    The table table-1-variability compares how much draws and samples vary. Repeating the command goes on where it was
    stopped. Exit status 1 if a cell failed.
    """
    from cusick_bench.leaderboard import leaderboards
    from cusick_bench.leaderboard.paper import make_table
    from cusick_bench.leaderboard.text import provenance
    from cusick_bench.report.figures.fold_variability import fold_variability
    from cusick_bench.runner import Source, load_once

    settings = _settings(vertices, mode, steps, Budget(budget), membrane, law, second_law)
    source = Source(data, None if fabrics_csv is None else str(fabrics_csv))
    grid = _Grid("table-1", source, cloth, solver, settings, draws, range(seed, seed + seeds), workers, out, force)
    cells, left_out = _run(grid)
    with _setting(out, len(set(cells.table["cloth"]))) as bar:
        (board,) = leaderboards(cells, by="test_mse")
        table = make_table("table-1", cells, board, notes=left_out)
        _write(table, out, {})
        spread = fold_variability(cells, load_once(source), done=bar.advance)
        _write_variability(spread, provenance(board), out)
    _finish([table], cells, as_json, spread)


@app.command("table-2")
@user_errors
def table_2(
    out: Out,
    data: Data = "cusick",
    fabrics_csv: FabricsCsv = None,
    cloth: FittedCloths = None,
    force: Force = False,
    solver: Solver = None,
    vertices: Vertices = VERTICES_OF_PAPER,
    draws: Draws = 1,
    seeds: Seeds = 1,
    seed: FirstSeed = 0,
    budget: DrapesBudget = 500,
    seconds: Seconds = None,
    mode: DropMode = Mode.drop,
    steps: Steps = 100,
    law: Law = LAW,
    membrane: Membrane = None,
    second_law: SecondLaw = None,
    workers: Workers = 1,
    as_json: Json = False,
) -> None:
    """Table 2, fits of the training silhouette at equal cost: BDP against REMBO, HeSBO, NLopt and later methods.

    Cost is the number of drapes (a gradient counts as two); losses at equal wall time are listed as well. With
    --seconds all methods are also run with wall time as the limit. Anytime curves are written to anytime.png and
    anytime.json. Repeating the command goes on where it was stopped. Exit status 1 if a cell failed.
    """
    from cusick_bench.leaderboard import leaderboards
    from cusick_bench.leaderboard.anytime import loss_at_equal_time
    from cusick_bench.leaderboard.paper import make_table
    from cusick_bench.runner import Source

    source = Source(data, None if fabrics_csv is None else str(fabrics_csv))
    budgets = {"": Budget(budget)} | ({} if seconds is None else {"-seconds": Budget(None, seconds)})
    tables, everything = [], []
    for suffix, limit in budgets.items():
        settings = _settings(vertices, mode, steps, limit, membrane, law, second_law)
        cells, left_out = _run(
            _Grid("table-2", source, cloth, solver, settings, draws, range(seed, seed + seeds), workers, out, force)
        )
        everything.append(cells)
        with _setting(out):
            (board,) = leaderboards(cells, by="train_mse")
            shortest, equal = loss_at_equal_time(cells.table)
            note = f"Equal time is {shortest:.1f} s a cell, when the fastest method had ended." if equal else ""
            notes = [f"Budget: {_limit(limit)}.", *left_out, *([note] if note else [])]
            table = make_table("table-2", cells, board, at_equal_time=equal, notes=notes)
            _write(table, out, _anytime(cells, f"{board.dataset}: {_limit(limit)}", out, suffix), suffix)
        tables.append(table)
    _finish(tables, replace(everything[0], skipped=tuple(s for cells in everything for s in cells.skipped)), as_json)


@contextmanager
def _setting(out: Path, steps: int | None = None) -> Iterator[Bar]:
    """While a table is set, which may take its time."""
    with progress_bar("setting the table", steps) as bar, interruptible(f"all cells are kept in {out}", go_on=True):
        yield bar


def _limit(budget: Budget) -> str:
    if budget.seconds is not None:
        return f"{budget.seconds:g} s of wall time a cell"
    return f"{budget.forward_equivalents:g} drapes a cell"


def _settings(
    vertices: int, mode: Mode, steps: int, budget: Budget, membrane: MembraneName | None, *laws: LawName | None
) -> list[ProblemSettings]:
    """Settings of the cells for each law; the membrane is for law plate only."""
    from cusick_bench.runner import ProblemSettings
    from cusick_bench.sim.engine.settings import DrapeSettings

    found = []
    for law in dict.fromkeys(law for law in laws if law is not None):
        clamp = None if law is LawName.plate else "whole"  # as in the paper's own program; law plate has an exact one
        asked = membrane_asked(membrane) if law is LawName.plate or LawName.plate not in laws else None
        drape = DrapeSettings(law=law.value, mode=mode.value, steps=steps, clamp=clamp, membrane=asked)
        found.append(ProblemSettings(vertices=vertices, drape=drape, budget=budget))
    return found


def _run(grid: _Grid) -> tuple[Cells, list[str]]:
    """Runs what is not finished yet, and reads exactly these cells, however many others lie beside them."""
    from cusick_bench.leaderboard.paper import SOLVERS, methods
    from cusick_bench.runner import Cell, load_once, plan, require_space

    chosen, missing = methods(grid.solvers or SOLVERS[grid.name], grid.draws)
    if missing and grid.solvers:
        raise RunnerError(f"no solver is registered for {', '.join(missing)}: {_refusal(missing[0])}")
    notes = [f"Left out, since not registered: {', '.join(missing)}."] if missing else []
    dataset, planned = load_once(grid.source), list[Cell]()
    for space in dict.fromkeys(method.space for method in chosen):
        solvers = [method.solver for method in chosen if method.space == space]
        if space is not None:
            require_space(solvers, space)
        for number, settings in enumerate(grid.settings):
            asked = [name for name in solvers if number == 0 or _simulates(name)]
            if asked:
                planned += plan(
                    dataset,
                    solvers=asked,
                    cloths=grid.cloths,
                    seeds=list(grid.seeds),
                    settings=replace(settings, space=space or settings.space),
                )
    planned = list({cell.key: cell for cell in planned}.values())
    return run_planned(grid.source, planned, grid.out, workers=grid.workers, force=grid.force), notes


def _refusal(name: str) -> str:
    """Why a method that is asked for cannot be used."""
    from cusick_bench.solvers.base import SolverError
    from cusick_bench.solvers.registry import solver_class

    try:
        solver_class(name.partition("@")[0].partition(",")[0].strip())
    except SolverError as error:
        return str(error)
    return "see `cusick-bench solvers`"


def _simulates(solver: str) -> bool:
    """Whether a law makes any difference to a method, as it does not to baselines and oracles."""
    from cusick_bench.solvers.registry import make_solver

    return make_solver(solver).kind == "solver"


def _anytime(cells: Cells, title: str, out: Path, suffix: str) -> dict[str, Any]:
    from cusick_bench.leaderboard.anytime import COSTS, curves, documents
    from cusick_bench.report.figures.anytime import save_anytime  # matplotlib is slow to import

    panels = {cost: curves(cells.table, cost) for cost in COSTS}
    if not panels["forward_equivalents"]:
        return {}
    path = out / f"anytime{suffix}.png"
    save_anytime(path, title, panels)
    tell(f"wrote {path}")
    return {f"anytime{suffix}.json": documents(cells.table)}


def _write(table: PaperTable, out: Path, documents: dict[str, Any], suffix: str = "") -> None:
    import pandas as pd

    from cusick_bench.files.csv_text import csv_text
    from cusick_bench.leaderboard import latex, markdown
    from cusick_bench.leaderboard.paper import records, set_table

    text, lines = set_table(table), records(table)
    name = f"{table.name}{suffix}"
    files = {f"{name}.md": markdown(text), f"{name}.tex": latex(text)}
    files[f"{name}.csv"] = csv_text(pd.DataFrame(lines))
    files[f"{name}.json"] = json_text({"table": name, "title": table.title, "rows": lines, "notes": list(table.notes)})
    _save(files | {file: json_text(document) for file, document in documents.items()}, out)


def _write_variability(rows: list[dict[str, Any]], notes: list[str], out: Path) -> None:
    import pandas as pd

    from cusick_bench.files.csv_text import csv_text
    from cusick_bench.leaderboard import latex, markdown
    from cusick_bench.report.figures.fold_variability import variability_table

    if not rows:
        tell("no variability: it takes 3 held-out samples of a cloth")
        return
    text, name = variability_table(rows, notes), "table-1-variability"
    files = {f"{name}.md": markdown(text), f"{name}.tex": latex(text)}
    files[f"{name}.csv"] = csv_text(pd.DataFrame(rows))
    files[f"{name}.json"] = json_text({"table": name, "rows": rows, "notes": list(text.notes)})
    _save(files, out)


def _save(files: dict[str, str], out: Path) -> None:
    for file, content in files.items():
        write_atomically(out / file, content.encode())
        tell(f"wrote {out / file}")


def _finish(tables: list[PaperTable], cells: Cells, as_json: bool, spread: list[dict[str, Any]] | None = None) -> None:
    """Prints the tables, and the variability of draws where it was asked for."""
    from cusick_bench.leaderboard import terminal
    from cusick_bench.leaderboard.paper import records, set_table
    from cusick_bench.report.figures.fold_variability import variability_table

    if as_json:
        document = {"tables": [{"name": t.name, "rows": records(t), "notes": list(t.notes)} for t in tables]}
        print_json(document | ({} if spread is None else {"variability": spread}))
    else:
        for text in [*map(set_table, tables), *([variability_table(spread)] if spread else [])]:
            output.print(terminal(text, output.width))
            for note in text.notes:
                output.print(note, style="dim", soft_wrap=True)
    if cells.skipped:
        raise typer.Exit(1)
