"""`cusick-bench garment`: skirts from a digitised cloth."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.table import Table

from cusick_bench.cli.common import interruptible, output, plain, print_json, user_errors
from cusick_bench.cli.options import (
    BENDING,
    DENSITY,
    MOST_SAMPLES,
    Json,
    LawName,
    Seed,
    Shear,
    Stretch,
    Vertices,
    bending_stiffnesses,
    checked_density,
    cloth_option,
    output_option,
    simulation_option,
)
from cusick_bench.cli.progress import progress_bar
from cusick_bench.garment import Body, GarmentError, WaistMotion
from cusick_bench.runner.store import disk_errors, write_json

if TYPE_CHECKING:
    from cusick_bench.garment import Cloth, Skirt


app = typer.Typer(help="Skirts from a digitised cloth.", no_args_is_help=True)

_skirt_option = partial(typer.Option, rich_help_panel="Skirt")
_motion_option = partial(typer.Option, rich_help_panel="Motion")
_LAYING_LENGTH = 0.08  # [m] correlation length of the height in which a skirt is put on


@app.callback()
def _root() -> None:
    """Skirts from a digitised cloth."""


class Kind(StrEnum):
    """Kinds of skirts."""

    circular = "circular"
    a_line = "a-line"


class Motion(StrEnum):
    """Motions of the waist."""

    sway = "sway"
    turn = "turn"


@app.command()
@user_errors
def skirt(
    result: Annotated[
        Path | None,
        cloth_option(
            "--from", help="Cell of a run (RUN/cells/KEY) whose cloth to wear, instead of --density and --bending."
        ),
    ] = None,
    density: Annotated[float | None, DENSITY] = None,
    bending: Annotated[str | None, BENDING] = None,
    stretch: Stretch = 300.0,
    shear: Shear = 60.0,
    heterogeneity: Annotated[
        float,
        cloth_option(max=3, help="Standard deviation of log stiffness between elements, where the fit has none."),
    ] = 0.1,
    name: Annotated[str | None, cloth_option(help="Name of the cloth; a colour in it is used.")] = None,
    kind: Annotated[Kind, _skirt_option(help="Cut of the skirt.")] = Kind.circular,
    dynamic: Annotated[bool, _motion_option("--dynamic/--static", help="Move the waist once the skirt hangs.")] = False,
    motion: Annotated[Motion, _motion_option(help="How the waist moves.")] = Motion.sway,
    amplitude: Annotated[
        float | None,
        _motion_option(help="Amplitude of the motion: by default 0.08 m of sway, or a turn of 90 deg."),
    ] = None,
    period: Annotated[float, _motion_option(max=600, help="Period of the motion [s].")] = 1.2,
    duration: Annotated[float, _motion_option(max=600, help="How long the waist moves [s].")] = 2.4,
    draws: Annotated[int, simulation_option(max=MOST_SAMPLES, help="Skirts, each of its own draw of the cloth.")] = 4,
    laying_height: Annotated[
        float,
        simulation_option(help="Standard deviation of the heights in which each skirt is put on [m]."),
    ] = 0.01,
    vertices: Vertices = 2500,
    law: Annotated[
        LawName | None,
        simulation_option(
            help="Material law; that of the result by default, and paper for tables of law plate.", show_default=False
        ),
    ] = None,
    waist: Annotated[float, _skirt_option(max=1, help="Radius of the waist [m].")] = 0.11,
    length: Annotated[float, _skirt_option(max=2, help="Length from waist to hem [m].")] = 0.35,
    hem: Annotated[float, _skirt_option(max=3, help="Radius of the A-line skirt's hem [m].")] = 0.22,
    hip: Annotated[float, _skirt_option(max=2, help="Radius of the hips [m]; 0 for no body in the skirt.")] = 0.13,
    seed: Seed = 0,
    out: Annotated[Path | None, output_option(help="Folder for meshes, silhouettes, pictures and summary.")] = None,
    as_json: Json = False,
) -> None:
    """Hangs skirts of a digitised cloth on a waist, moves them if asked, and measures how they hang and differ."""
    from cusick_bench.garment import KINDS, Fitting, SkirtSize, hang, spread, walk
    from cusick_bench.garment.measurement import measure
    from cusick_bench.garment.output import write_motion, write_rest

    clock = time.perf_counter()
    if draws < 1:
        raise GarmentError(f"the number of draws must be at least 1, got {draws}")
    cloth = _cloth(result, density, bending, stretch, shear, heterogeneity, name)
    _check_law(law, cloth)
    size = SkirtSize(waist=waist, length=length, hem=hem)
    body = None if hip == 0 else Body(waist=waist, hip=hip)
    moving = _motion(motion, amplitude, period, duration)
    pattern = KINDS[kind.value](size, vertices, seed=seed)
    fitting = Fitting.of(
        pattern, cloth.draw(pattern.mesh, draws, np.random.default_rng([seed, 3])), law=cloth.law, body=body
    )
    if out is not None:
        with disk_errors(out):
            out.mkdir(parents=True, exist_ok=True)
    with progress_bar("hanging the skirts (at most so many steps)") as bar:
        rest, resting = hang(fitting, _laid(pattern, laying_height, draws, seed), progress=bar.show)
    measures = [measure(pattern, x) for x in rest.positions]
    each = [{"draw": i, **asdict(m), "at_rest": bool(resting[i])} for i, m in enumerate(measures)]
    document: dict[str, Any] = {
        "kind": kind.value, "cloth": cloth.name, "stiffness_from": cloth.source, "law": cloth.law,
        "areal_density_kg_m2": cloth.density, "vertices": pattern.mesh.vertices, "faces": len(pattern.mesh.faces),
        "size": asdict(size), "hip_m": hip, "seed": seed, "converged": bool(resting.all()),
        "spread": spread(rest.positions, measures), "draws": each,
    }  # fmt: skip
    frames = None
    if dynamic:
        with progress_bar("moving the waist") as bar:
            frames = walk(fitting, rest, moving, progress=bar.show)
        document["motion"] = _moved(pattern, moving, *frames)
    document["seconds"] = time.perf_counter() - clock
    if out is not None:
        with disk_errors(out), progress_bar("drawing"), interruptible(f"what was ready is in {out}"):
            write_rest(out, pattern, rest.positions, cloth.name, body)
            if frames is not None:
                write_motion(out, pattern, *frames, moving, cloth.name, body)
            write_json(out / "summary.json", plain(document))
        document["out"] = out
    if as_json:
        print_json(document)
    else:
        _print(document)


def _cloth(
    result: Path | None, density: float | None, bending: str | None, stretch: float, shear: float, deviation: float,
    name: str | None,
) -> Cloth:  # fmt: skip
    """The cloth of a result, or of numbers."""
    from cusick_bench.garment import cloth_of_cell, cloth_of_numbers

    if (result is None) == (density is None and bending is None):
        raise GarmentError("give either --from RESULT, or --density and --bending")
    if result is not None:
        cloth = cloth_of_cell(result, spread=deviation)
    elif density is None or bending is None:
        raise GarmentError("a cloth given by numbers needs both --density and --bending")
    else:
        cloth = cloth_of_numbers(
            density=checked_density(density),
            bending=bending_stiffnesses(bending),
            stretch=stretch,
            shear=shear,
            spread=deviation,
        )
    return cloth if name is None else replace(cloth, name=name)


def _check_law(law: LawName | None, cloth: Cloth) -> None:
    if law is LawName.plate:
        raise GarmentError(
            "law plate needs cloth of one piece, clamped in a circle, and a skirt has seams and hangs on a waist; "
            "leave out --law: skirts hang by law paper, which reads the same tables"
        )
    if law is not None and law.value != cloth.law:
        raise GarmentError(f"the cloth's tables are for law {cloth.law}, got --law {law.value}; leave it out")


def _motion(motion: Motion, amplitude: float | None, period: float, seconds: float) -> WaistMotion:
    if motion is Motion.sway:
        return WaistMotion(sway=0.08 if amplitude is None else amplitude, period=period, seconds=seconds)
    return WaistMotion(turn=np.radians(90.0 if amplitude is None else amplitude), period=period, seconds=seconds)


def _laid(pattern: Skirt, laying: float, draws: int, seed: int) -> np.ndarray:
    """How each skirt is put on: its own undulation decides where its folds form."""
    from cusick_bench.sim.cloth.shape import smooth_field

    fields = [smooth_field(laying, _LAYING_LENGTH, np.random.default_rng([seed, draw, 4])) for draw in range(draws)]
    return np.stack([pattern.laid(field) for field in fields])


def _moved(pattern: Skirt, motion: WaistMotion, times: np.ndarray, frames: np.ndarray) -> dict[str, Any]:
    """Numbers of the motion: how far the hem spreads and how far it trails behind the waist."""
    shifts = np.stack([motion.pose(time)[1] for time in times])
    hem = frames[:, :, pattern.hem] - shifts[:, None, None]
    radius = np.hypot(hem[..., 0], hem[..., 1]).mean(-1)  # (frames, draws)
    trail = np.hypot(*np.moveaxis(hem[..., :2].mean(-2) - hem[:1, ..., :2].mean(-2), -1, 0))
    return {
        **asdict(motion), "frames": len(times), "hem_radius_rest_m": float(radius[0].mean()),
        "hem_radius_max_m": float(radius.max(0).mean()), "hem_radius_max_sd_m": _sd(radius.max(0)),
        "hem_trail_max_m": float(trail.max(0).mean()), "hem_trail_max_sd_m": _sd(trail.max(0)),
    }  # fmt: skip


def _sd(values: np.ndarray) -> float:
    return float(values.std(ddof=1)) if len(values) > 1 else float("nan")


def _print(document: dict[str, Any]) -> None:
    table = Table(title=f"{document['kind']} skirt of {document['cloth']}, {document['vertices']} vertices")
    columns = {
        "hem_radius_m": "hem radius [m]", "hem_depth_m": "hem depth [m]", "folds": "folds",
        "projected_area_m2": "area [m2]", "drape_coefficient": "drape coefficient",
    }  # fmt: skip
    for title in ("draw", *columns.values(), "at rest"):
        table.add_column(title, justify="right")
    for draw in document["draws"]:
        cells = [f"{draw[key]:.4g}" for key in columns]
        table.add_row(str(draw["draw"]), *cells, "yes" if draw["at_rest"] else "no")
    if len(document["draws"]) > 1:
        table.add_section()
        for title in ("mean", "sd"):
            table.add_row(title, *(f"{document['spread'][title][key]:.3g}" for key in columns), "")
    output.print(table)
    if len(document["draws"]) > 1:
        output.print(f"vertices differ by {1e3 * document['spread']['vertex_sd_rms_m']:.1f} mm (rms sd between draws)")
    if "motion" in document:
        motion = document["motion"]
        output.print(
            f"in motion the hem spreads from {motion['hem_radius_rest_m']:.3f} to {motion['hem_radius_max_m']:.3f} m "
            f"and trails the waist by up to {motion['hem_trail_max_m']:.3f} m"
        )
