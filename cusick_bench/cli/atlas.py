"""`cusick-bench atlas`: drapes over the base model's parameters, from which diagnoses are made."""

import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.progress import Progress, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from cusick_bench.cli.common import console, output, print_json, user_errors
from cusick_bench.diagnosis.atlas import Design, build, read
from cusick_bench.diagnosis.emulator import fit
from cusick_bench.diagnosis.power import detectable, needed
from cusick_bench.diagnosis.store import SHIPPED, Calibration, load, save
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.effects import registered

app = typer.Typer(help="Drapes over the base model's parameters, from which diagnoses are made.")
_PLAN = Design()


@app.callback()
def _root() -> None:
    """Drapes over the base model's parameters, from which diagnoses are made."""


@app.command("build")
@user_errors
def build_atlas(
    out: Annotated[Path, typer.Option(help="Folder of its points; a build that was stopped goes on there.")],
    points: Annotated[int, typer.Option(min=60, help="Fabrics.")] = _PLAN.points,
    effect_points: Annotated[int, typer.Option(min=0, help="Of these, with every effect.")] = _PLAN.effect_points,
    fine_points: Annotated[int, typer.Option(min=0, help="Of these, on a finer mesh too.")] = _PLAN.fine_points,
    one_mesh_points: Annotated[
        int, typer.Option(min=0, help="Of these, with all samples on one mesh too.")
    ] = _PLAN.one_mesh_points,
    samples: Annotated[int, typer.Option(min=2, help="Samples of each fabric.")] = _PLAN.samples,
    vertices: Annotated[int, typer.Option(min=100, help="Mesh size.")] = _PLAN.vertices,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 2,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on standard output.")] = False,
) -> None:
    """Drapes fabrics over the base model's range, with and without every effect (about an hour on two cores)."""
    design = Design(points, effect_points, fine_points, one_mesh_points, samples, vertices)
    columns = (*Progress.get_default_columns()[:-1], TimeElapsedColumn(), "left", TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("draping", total=None)
        build(
            out,
            design,
            workers=workers,
            progress=lambda done, total: progress.update(task, completed=done, total=total),
        )
    if as_json:
        print_json({"path": out, "points": points, "tasks": len(design.tasks())})
    else:
        output.print(f"{out}: {len(design.tasks())} sets of drapes; next: cusick-bench atlas fit {out}")


@app.command("fit")
@user_errors
def fit_atlas(
    folder: Annotated[Path, typer.Argument(help="Folder that `build` filled, also in part.", metavar="FOLDER")],
    out: Annotated[Path, typer.Option(help="File; by default the one that diagnoses use.")] = SHIPPED,
    inflation: Annotated[float, typer.Option(min=0.1, help="Of noise, from calibration cases.")] = 1.0,
    tempering: Annotated[float, typer.Option(min=0.01, help="Power of evidences, from calibration cases.")] = 1.0,
    cases: Annotated[int, typer.Option(min=0, help="How many calibration cases that rests on.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on standard output.")] = False,
) -> None:
    """Fits smooth functions to the points and writes them as one small file."""
    design, points = read(folder)
    save(out, fit(design, points), Calibration(inflation, tempering, cases))
    counts = {name: len(found) for name, found in points.items()}
    if as_json:
        print_json({"path": out, "points": counts})
    else:
        output.print(f"{out}: {counts.get('base', 0)} fabrics, {len(counts) - 2} effects")


@app.command("power")
@user_errors
def power(
    atlas: Annotated[Path, typer.Option(help="Fitted atlas.")] = SHIPPED,
    out: Annotated[Path | None, typer.Option(help="JSON file of them, as `withheld generate` takes.")] = None,
    samples: Annotated[int, typer.Option(min=2, help="Samples of a fabric, on both sides, each captured twice.")] = 12,
    check: Annotated[bool, typer.Option(help="Also measure the shift that each effect needs (a minute).")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on standard output.")] = False,
) -> None:
    """Detectable severity of every effect: found in 80 % of fabrics, at 5 % false alarms over all causes together."""
    emulator, _ = load(atlas)
    found = dict(detectable(emulator, samples=samples))
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(out, json.dumps(found, indent=1).encode())
    shift = needed(emulator, np.random.default_rng(0)) if check else {}
    if as_json:
        print_json({"detectable": found, "needed": shift, "samples": samples})
        return
    table = Table("effect", "detectable", "unit", "of typical", *(["needs |d|"] if check else []))
    for name, one in registered().items():
        p = one.severity
        value = found.get(name)
        cells = ("not found", "", "") if value is None else (f"{value:.3g}", p.unit, f"{value / p.typical:.1f}")
        table.add_row(name, *cells, *([f"{shift[name]:.1f}" if name in shift else ""] if check else []))
    output.print(table)
