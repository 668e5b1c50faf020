"""`cusick-bench identify`: from a laboratory's photographs or silhouettes to one page."""

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Column, Table

from cusick_bench.cli.common import command_line, interruptible, output, print_json, tell, user_errors
from cusick_bench.cli.completion import complete_solver
from cusick_bench.cli.fit.grid_progress import GridProgress
from cusick_bench.cli.options import (
    Atlas,
    Budget,
    CameraHeight,
    CaptureFaces,
    ClothDiameter,
    Cloths,
    Force,
    ImageSize,
    Json,
    PlateDiameter,
    PrintedRuler,
    Seed,
    SimulatedSamples,
    Steps,
    Vertices,
    Weight,
    Weights,
    Workers,
    fit_option,
    output_option,
)
from cusick_bench.cli.progress import progress_bar
from cusick_bench.diagnosis.options import SHIPPED
from cusick_bench.identify.errors import IdentifyError
from cusick_bench.identify.options import Options
from cusick_bench.photographs.preparation.setting_text import SettingText

if TYPE_CHECKING:
    from cusick_bench.identify.document import IdentifyDocument

app = typer.Typer()

_MICRO = 1e6


@app.command("identify")
@user_errors
def identify_command(
    folder: Annotated[
        str,
        typer.Argument(
            help="Folder of photographs (docs/drape-meter.md says how to name them), folder of a data set, or name of "
            "one.",
            metavar="FOLDER",
        ),
    ],
    out: Annotated[
        Path, output_option(help="Folder of identify.html, identify.json and all parts; what is finished is kept.")
    ] = Path("runs/identify"),
    cloth: Cloths = None,
    force: Force = False,
    weight: Weight = None,
    weights: Weights = None,
    cloth_diameter: ClothDiameter = SettingText.cloth_diameter,
    plate_diameter: PlateDiameter = SettingText.plate_diameter,
    captures: CaptureFaces = SettingText.captures,
    camera_height: CameraHeight = None,
    printed_ruler: PrintedRuler = SettingText.printed_ruler,
    image_size: ImageSize = 512,
    solver: Annotated[
        list[str] | None,
        fit_option(
            "--solver",
            help=f"Solver with a posterior, NAME or NAME,option=value; by default {Options.solver}.",
            autocompletion=complete_solver,
        ),
    ] = None,
    budget: Budget = Options.budget,
    vertices: Vertices = Options.vertices,
    steps: Steps = Options.steps,
    samples: SimulatedSamples = Options.samples,
    atlas: Atlas = SHIPPED,
    seed: Seed = Options.seed,
    workers: Workers = 1,
    as_json: Json = False,
) -> None:
    """Identify the fabrics of a laboratory: drape coefficient, stiffness with an interval, diagnosis, on one page.

    Photographs are prepared first. Repeating the command makes again only what has changed. Exit status 1 if a
    photograph was not sure enough to be used, or a fit failed.
    """
    from cusick_bench.identify.identify import begin

    if solver is not None and len(solver) > 1:
        raise IdentifyError(f"identify fits with one solver, got {len(solver)}: {', '.join(solver)}; use `run` instead")
    options = Options(
        tuple(cloth or ()), (solver or [Options.solver])[0], vertices, steps, budget, samples, seed, force
    )
    text = SettingText(
        tuple(weight or ()), weights, cloth_diameter, plate_diameter, captures, camera_height, printed_ruler
    )
    kept = partial(interruptible, f"what is finished is kept in {out}", go_on=True)
    with progress_bar("finding outlines") as bar, kept():
        work = begin(
            folder, out, options, text, image_size, atlas=atlas,
            photographs=lambda count: bar.show(0, count), prepared=lambda name: bar.advance(),
        )  # fmt: skip
    with progress_bar("measuring drapes", len(work.dataset.cloths)) as bar, kept():
        measured = work.measure(lambda name: bar.advance())
    with GridProgress() as grid, kept():
        fits = work.fit(grid, workers, sys.argv)
    with progress_bar("diagnosing", 1) as bar, kept():
        diagnoses = work.diagnose(bar.tell)
    with kept():
        document = work.write(measured, fits, diagnoses, command_line())
    if as_json:
        print_json(document.content() | {"path": work.workspace.document, "page": work.workspace.page})
    else:
        _print(document)
        output.print(f"page: {work.workspace.page}", soft_wrap=True)
    if document.faults:
        raise typer.Exit(1)


def _print(document: "IdentifyDocument") -> None:
    """A line for each fabric, then what is missing and what to do next."""
    table = Table(Column("fabric", no_wrap=True), "samples", "DC [%]", "folds", "warp", "weft", "bias", "diagnosis")
    table.caption = "DC: drape coefficient, ± sd between faces of samples; warp, weft, bias: bending stiffness [µN m]"
    for fabric in document.fabrics:
        drapes, fit = fabric.drapes, fabric.fit
        names = ("warp", "weft", "bias")
        table.add_row(
            fabric.fabric,
            str(drapes.samples),
            _spread(drapes.drape_coefficient, 100.0),
            _spread(drapes.folds),
            *(["-"] * 3 if fit is None else [_stiffness(fit.stiffness[name]) for name in names]),
            fabric.diagnosis.verdict if fabric.diagnosis else "-",
        )
    output.print(table)
    for fabric in document.fabrics:
        if fabric.fit_missing:
            output.print(f"{fabric.fabric}: no stiffness: {fabric.fit_missing}", soft_wrap=True)
        if fabric.diagnosis_missing:
            output.print(f"{fabric.fabric}: no diagnosis: {fabric.diagnosis_missing}", soft_wrap=True)
        for step in fabric.next:
            output.print(f"{fabric.fabric}: next: {step}", soft_wrap=True)
    for one in document.preparation.refused if document.preparation else ():
        tell(f"not used: {one.path} (confidence {one.confidence:.2f}): {'; '.join(one.why)}")
    for step in document.next:
        output.print(f"laboratory: next: {step}", soft_wrap=True)


def _spread(one: object, factor: float = 1.0) -> str:
    from cusick_bench.identify.document import Spread

    if not isinstance(one, Spread):
        return "-"
    return f"{factor * one.value:.1f}" + ("" if one.sd is None else f" ± {factor * one.sd:.1f}")


def _stiffness(one: object) -> str:
    from cusick_bench.identify.document import Stiffness
    from cusick_bench.leaderboard import significant

    assert isinstance(one, Stiffness)
    bounds = "" if one.ci90 is None else f" [{significant(_MICRO * one.ci90[0])}, {significant(_MICRO * one.ci90[1])}]"
    return significant(_MICRO * one.value) + bounds
