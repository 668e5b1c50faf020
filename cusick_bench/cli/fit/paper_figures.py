"""`cusick-bench paper figure-6`, `figure-7`, `figure-8`: the paper's figures of a results folder on given data."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cusick_bench.cli.common import interruptible, output, print_json, tell, tell_damaged, user_errors
from cusick_bench.cli.completion import complete_solver
from cusick_bench.cli.options import Json, RunFolder, RunsData, RunsFabricsCsv, fit_option, output_option
from cusick_bench.cli.progress import Bar, progress_bar
from cusick_bench.cli.written_paths import folder_made
from cusick_bench.report.figures import CLASSIFIED_DRAWS, SHOWN_SAMPLES
from cusick_bench.runner.labels import unspaced
from cusick_bench.runner.store import write_json

if TYPE_CHECKING:
    from cusick_bench.datasets import DrapeDataset
    from cusick_bench.leaderboard import Cells
    from cusick_bench.report.figures.side_by_side import Strip


Out = Annotated[Path, output_option(help="Folder for the figure and its numbers.")]
Solvers = Annotated[
    list[str] | None,
    fit_option(
        "--solver",
        help="Solver to show; repeatable; by default no oracles, and in figure 6 no nulls.",
        autocompletion=complete_solver,
    ),
]


def register(app: typer.Typer) -> None:
    """Adds the figures to the commands of `cusick-bench paper`."""
    for name, command in (("figure-6", figure_6), ("figure-7", figure_7), ("figure-8", figure_8)):
        app.command(name)(command)


@user_errors
def figure_6(
    run: RunFolder,
    out: Out,
    data: RunsData = None,
    fabrics_csv: RunsFabricsCsv = None,
    solver: Solvers = None,
    as_json: Json = False,
) -> None:
    """Figure 6, training samples and their fits side by side: silhouettes, and the drapes from the side."""
    from cusick_bench.report.figures.side_by_side import fitted

    cells, dataset = _load(run, data, fabrics_csv)
    with _drawing(out, _cloths(cells) + 1) as bar:
        strips = fitted(cells, dataset, _asked(solver), progress=bar.begin)
        path = _sheet(strips, out, "figure-6.png", "training sample and fits (orange: real outline)", bar)
    document = {"strips": [strip.document() for strip in strips]}
    _finish(document, [path], out / "figure-6.json", as_json)


@user_errors
def figure_7(
    run: RunFolder,
    out: Out,
    data: RunsData = None,
    fabrics_csv: RunsFabricsCsv = None,
    solver: Solvers = None,
    samples: Annotated[int, typer.Option(min=1, help="Most held-out samples of a cloth.")] = SHOWN_SAMPLES,
    as_json: Json = False,
) -> None:
    """Figure 7, held-out samples beside the best draw of each solver, which is chosen by looking at the sample."""
    from cusick_bench.files.plain_names import plain_names
    from cusick_bench.report.figures.side_by_side import held_out

    cells, dataset = _load(run, data, fabrics_csv)
    with _drawing(out, 2 * _cloths(cells)) as bar:
        strips = held_out(cells, dataset, _asked(solver), samples=samples, progress=bar.begin)
        title = "held-out samples and the best draw for each, chosen by an oracle (orange: real outline)"
        names = plain_names(dataset.cloths)
        paths = [
            _sheet([strip for strip in strips if strip.cloth == cloth], out, f"figure-7-{names[cloth]}.png", title, bar)
            for cloth in dict.fromkeys(strip.cloth for strip in strips)
        ]
    document = {"chosen_by": "held-out image", "strips": [strip.document() for strip in strips]}
    _finish(document, paths, out / "figure-7.json", as_json)


@user_errors
def figure_8(
    run: RunFolder,
    out: Out,
    data: RunsData = None,
    fabrics_csv: RunsFabricsCsv = None,
    solver: Solvers = None,
    draws: Annotated[int, typer.Option(min=1, help="Most draws of a cell to classify.")] = CLASSIFIED_DRAWS,
    as_json: Json = False,
) -> None:
    """Figure 8, radius over angle of real samples and draws, and to which cloth a classifier assigns each draw."""
    from cusick_bench.report.figures.predictions import entrants
    from cusick_bench.report.figures.radius_angle import radius_angle, save_confusion, save_radius_angle

    cells, dataset = _load(run, data, fabrics_csv)
    solver = _asked(solver)
    shown = len(entrants(cells, solver, kinds=("solver", "null")))
    with _drawing(out, _cloths(cells) * (1 + shown)) as bar:
        study = radius_angle(cells, dataset, solver, draws=draws, progress=bar.begin)
        paths = [out / "figure-8.png", out / "figure-8-confusion.png"]
        save_radius_angle(study, paths[0])
        save_confusion(study, paths[1])
    for group in (study.real, *study.drawn):
        share = 100 * group.confusion.accuracy
        count = f"{group.confusion.counts.sum()} drapes, each cloth counting alike"
        text = f"{share:5.1f} % are taken for their own cloth ({count}): {group.label}"
        if not as_json:
            output.print(text)
    _finish(study.document(), paths, out / "figure-8.json", as_json)


def _load(run: Path, data: str | None, fabrics_csv: Path | None) -> tuple[Cells, DrapeDataset]:
    from cusick_bench.leaderboard import load_cells
    from cusick_bench.leaderboard.cells.source import load_data_of

    cells = load_cells(run)
    tell_damaged(cells)
    return cells, load_data_of(cells, data, fabrics_csv)


def _asked(solvers: list[str] | None) -> list[str] | None:
    """Solvers as the table of cells names them."""
    return None if solvers is None else [unspaced(text) for text in solvers]


def _cloths(cells: Cells) -> int:
    return len(set(cells.table["cloth"]))


@contextmanager
def _drawing(out: Path, steps: int) -> Iterator[Bar]:
    """Progress of a figure, in steps that are announced when they begin."""
    kept = interruptible(f"pictures that were ready are in {out}")
    with folder_made(out), progress_bar("reading data", steps) as bar, kept:
        yield bar


def _sheet(strips: list[Strip], out: Path, name: str, title: str, bar: Bar) -> Path:
    from cusick_bench.report.figures.side_by_side import save_strips

    bar.begin(f"drawing {name}")
    save_strips(strips, out / name, title)
    return out / name


def _finish(document: dict[str, Any], paths: list[Path], numbers: Path, as_json: bool) -> None:
    """Writes the numbers beside the pictures."""
    write_json(numbers, document)
    files = [*paths, numbers]
    for path in files:
        tell(f"wrote {path}")
    if as_json:
        print_json(document | {"files": files})
