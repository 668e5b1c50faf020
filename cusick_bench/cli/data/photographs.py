"""`cusick-bench data prepare`, `board`, `photographs`, `photograph-errors`: from pictures of a drape meter to data."""

from __future__ import annotations

from enum import StrEnum
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Column, Table

from cusick_bench.cli.common import interruptible, output, print_json, tell, user_errors
from cusick_bench.cli.options import (
    LARGEST_SEED,
    CameraHeight,
    CaptureFaces,
    ClothDiameter,
    ImageSize,
    Json,
    PlateDiameter,
    PrintedRuler,
    Weight,
    Weights,
    output_option,
    running_option,
)
from cusick_bench.cli.progress import progress_bar
from cusick_bench.photographs.preparation.setting_text import SettingText

if TYPE_CHECKING:
    from cusick_bench.photographs.accuracy import Measured
    from cusick_bench.photographs.preparation.prepare import Preparation

_MOST_PHOTOGRAPHS = 100_000


class Paper(StrEnum):
    """Sizes of paper."""

    a4 = "a4"
    letter = "letter"


Photographs = Annotated[
    Path, typer.Argument(help="Folder of photographs; docs/drape-meter.md says how to name them.", metavar="PHOTOS")
]


@user_errors
def prepare(
    photographs: Photographs,
    out: Annotated[Path, output_option(help="New folder for the data set.")],
    weight: Weight = None,
    weights: Weights = None,
    cloth_diameter: ClothDiameter = SettingText.cloth_diameter,
    plate_diameter: PlateDiameter = SettingText.plate_diameter,
    captures: CaptureFaces = SettingText.captures,
    camera_height: CameraHeight = None,
    printed_ruler: PrintedRuler = SettingText.printed_ruler,
    image_size: ImageSize = 512,
    template: Annotated[
        bool, output_option("--template", help="Only write a table for the weights, weights.csv in OUT, to fill in.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Make a data set from photographs: calibrate the camera, find every cloth's outline, draw silhouettes.

    Outlines of low confidence are drawn in OUT/check and listed, but not written as silhouettes. Exit status 1 if there
    are any, or if a photograph cannot be read.
    """
    from dataclasses import replace

    from cusick_bench.photographs.errors import BadPhotograph
    from cusick_bench.photographs.preparation.pictures import find_pictures
    from cusick_bench.photographs.preparation.prepare import prepare as prepare_folder
    from cusick_bench.photographs.preparation.setting_text import setting_of
    from cusick_bench.photographs.preparation.weights import TABLE
    from cusick_bench.photographs.preparation.weights import template as table_text

    found = find_pictures(photographs)
    fabrics = sorted({picture.fabric for picture in found.drapes})
    if template:
        if (out / TABLE).exists():
            raise BadPhotograph("exists", where=out / TABLE, remedy="fill that one in, or move it away")
        out.mkdir(parents=True, exist_ok=True)
        (out / TABLE).write_text(table_text(fabrics), encoding="utf-8")
        print_json({"table": out / TABLE}) if as_json else output.print(f"fill in {out / TABLE}, give it as --weights")
        return
    if weights is None and not (photographs / TABLE).is_file() and (out / TABLE).is_file():
        weights = out / TABLE  # where --template has put it
    text = SettingText(
        tuple(weight or ()), weights, cloth_diameter, plate_diameter, captures, camera_height, printed_ruler
    )
    setting = setting_of(text, photographs, fabrics)
    with progress_bar("finding outlines", len(found.drapes)) as bar, interruptible(f"nothing was written to {out}"):
        prepared = prepare_folder(
            photographs, out, replace(setting, image_size=image_size), done=lambda name: bar.advance()
        )
    if as_json:
        print_json(prepared.document())
    else:
        _report(prepared)
    if prepared.unweighed:
        names = ", ".join(map(str, prepared.unweighed))
        tell(f"no weight is known of fabric {names}: add it to {out / 'fabrics.csv'}; a fit needs it")
    if not prepared.view.knows_height:
        tell(
            "the camera's height is not known, so perspective stays in the silhouettes: give --camera-height, or add "
            "two or more pictures of the board held at angles"
        )
    if not prepared.view.knows_lens:
        tell(
            "the lens is not known from the bare plate, and its distortion stays in the silhouettes: if straight lines "
            "look bent in your pictures, add board-plane.jpg, and board-1.jpg, ... held at angles"
        )
    if prepared.doubtful:
        raise typer.Exit(1)


def _report(prepared: Preparation) -> None:
    view, spread = prepared.view, prepared.view.uncertainty
    height = f"{view.eye[2]:.3f} ± {spread.height_m:.3f} m high" if view.knows_height else "of unknown height"
    output.print(
        f"camera from {view.source}: {view.scale:.0f} px/m ± {100 * spread.scale:.2f} %, middle ± "
        f"{1e3 * spread.centre_m:.2f} mm, tilted {degrees(view.tilt):.1f} ± {degrees(spread.tilt_rad):.1f} degrees, "
        f"{height}"
    )
    written = len(prepared.pictures) - len(prepared.doubtful)
    output.print(
        f"{written} of {len(prepared.pictures)} silhouettes in {prepared.out}; look at {prepared.out / 'check'}"
    )
    if prepared.doubtful:
        table = Table("not written", "confidence", Column("why", overflow="fold"))
        for one in prepared.doubtful:
            table.add_row(str(one.picture.path), f"{one.confidence:.2f}", "; ".join(one.doubts))
        output.print(table)


@user_errors
def board(
    out: Annotated[Path, output_option(help="PDF file to write.")],
    paper: Annotated[Paper, output_option(help="Size of the paper.")] = Paper.a4,
    plate_diameter: PlateDiameter = "180 mm",
    as_json: Json = False,
) -> None:
    """Make the printable board (PDF, true scale) that calibrates a camera over the plate, with a ruler to check it."""
    from cusick_bench.photographs.board import LEAST_DISC, MOST_DISC
    from cusick_bench.photographs.errors import BadPhotograph
    from cusick_bench.photographs.preparation.quantities import LENGTHS, quantity
    from cusick_bench.photographs.sheet import write_sheet

    diameter = quantity(plate_diameter, LENGTHS, "--plate-diameter", "180 mm")
    if not LEAST_DISC <= diameter <= MOST_DISC:
        raise BadPhotograph(
            f"--plate-diameter must be from {1e3 * LEAST_DISC:g} to {1e3 * MOST_DISC:g} mm, so that the disc has "
            f"enough corners of the board and fits the sheet, got {plate_diameter}",
            remedy="keep 180 mm and photograph the bare plate as well, which then gives the middle",
        )
    if out.suffix.lower() != ".pdf":
        raise BadPhotograph(f"--out must end in .pdf, got {out.name}", remedy="name it board.pdf")
    out.parent.mkdir(parents=True, exist_ok=True)
    write_sheet(out, paper.value, diameter / 2)
    if as_json:
        print_json({"out": out, "paper": paper.value})
    else:
        output.print(f"{out}: print at 100 %, and check the ruler")


@user_errors
def photographs(
    out: Annotated[Path, output_option(help="New folder for the photographs.")],
    drapes: Annotated[int, typer.Option(min=1, max=1000, help="Photographs of drapes.")] = 4,
    laboratory: Annotated[
        int, typer.Option(min=0, max=LARGEST_SEED, help="Number of the laboratory: camera, light, ground.")
    ] = 0,
    as_json: Json = False,
) -> None:
    """Draw photographs of simulated drapes, with light, shadow, patterns and lens, to test `data prepare`."""
    from cusick_bench.photographs.errors import BadPhotograph
    from cusick_bench.photographs.studio.folder import write_photographs
    from cusick_bench.photographs.studio.scene import make_laboratory

    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise BadPhotograph("is not empty", where=out, remedy="give a new folder, or remove it")
    made = make_laboratory(laboratory)
    with progress_bar("drawing") as bar, interruptible(f"the pictures that were ready are in {out}"):
        write_photographs(made, out, drapes, done=lambda name: bar.advance())
    if as_json:
        print_json({"out": out, "drapes": drapes, "laboratory": laboratory, "calibration": made.calibration})
    else:
        output.print(f"{drapes} drapes, calibrated by {made.calibration}, in {out}; truth.json holds the true outlines")


@user_errors
def photograph_errors(
    count: Annotated[int, typer.Option("--photographs", min=1, max=_MOST_PHOTOGRAPHS, help="Photographs.")] = 200,
    laboratory: Annotated[
        int,
        typer.Option(
            min=0, max=LARGEST_SEED, help="Number of the first laboratory; those below 1000 were used for tuning."
        ),
    ] = 1000,
    troubles: Annotated[
        bool, typer.Option("--troubles", help="Spoil every photograph: hands, glare, cloth like the ground, and so on.")
    ] = False,
    minimum_share: Annotated[
        float,
        running_option(
            min=0, max=1, help="Least share of outlines within .5 mm; with --troubles, of wrong ones recognised."
        ),
    ] = 0.95,
    as_json: Json = False,
) -> None:
    """Measure errors of outlines in synthetic photographs, and whether low confidence reveals them.

    Exit status 1 if --minimum-share is not reached.
    """
    from dataclasses import asdict

    from cusick_bench.photographs.accuracy import LEVEL_DEG, accuracy, document, measure

    measured: list[Measured] = []
    with progress_bar("photographs", count) as bar:
        for one in measure(count, laboratory, troubles=troubles):
            measured.append(one)
            bar.advance()
    found = accuracy(measured)
    if as_json:
        print_json({"laboratory": laboratory, "troubles": troubles, **asdict(found), "rows": document(measured)})
    else:
        table = Table("laboratory", "shot", "calibration", "trouble", "rms mm", "largest mm", "confidence")
        for one in sorted(measured, key=lambda one: -one.rms_mm)[:20]:
            numbers = (f"{one.rms_mm:.2f}", f"{one.largest_mm:.1f}", f"{one.confidence:.2f}")
            table.add_row(str(one.laboratory), str(one.shot), one.calibration, one.trouble, *numbers)
        output.print(table)
        output.print(
            f"{100 * found.within:.1f} % of {found.photographs} photographs within .5 mm, "
            f"{100 * found.level_within:.1f} % of the {found.level} whose camera is at most "
            f"{LEVEL_DEG:.0f} degrees beside the axis "
            f"(median {found.median_mm:.2f}, 95 % below {found.most_mm:.2f} mm); {100 * found.accepted:.1f} % "
            f"accepted, of these {100 * found.accepted_within:.1f} % within .5 mm; {100 * found.recognised:.1f} % of "
            f"{found.wrong} wrong ones recognised"
        )
    reached = found.recognised if troubles else found.within
    if reached < minimum_share:
        raise typer.Exit(1)
