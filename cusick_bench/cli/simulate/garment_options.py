"""Options of the garment commands: cut, size, motion, draws."""

from __future__ import annotations

import math
from enum import StrEnum
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from cusick_bench.cli.options import MOST_SAMPLES, MOST_VERTICES, cloth_option, membrane_option, simulation_option

if TYPE_CHECKING:
    from cusick_bench.garment import WaistMotion
    from cusick_bench.garment.skirt import SkirtSize
    from cusick_bench.garment.wearing import Wearing

_skirt_option = partial(typer.Option, rich_help_panel="Skirt")
motion_option = partial(typer.Option, rich_help_panel="Motion")


class KindName(StrEnum):
    """Kinds of skirts."""

    circular = "circular"
    a_line = "a-line"


class MotionName(StrEnum):
    """Motions of the waist."""

    sway = "sway"
    turn = "turn"


Heterogeneity = Annotated[
    float, cloth_option(max=3, help="Standard deviation of log stiffness between elements, where the fit has none.")
]
Stretch = Annotated[
    float | None,
    membrane_option(help="Membrane stiffness along warp and weft [N/m], of a cloth given by numbers; by default 300."),
]
Shear = Annotated[
    float | None,
    membrane_option(help="Shear stiffness [N/m], of a cloth given by numbers; by default 60."),
]
Kind = Annotated[KindName, _skirt_option(help="Cut of the skirt.")]
WaistRadius = Annotated[float, _skirt_option("--waist", max=1, help="Radius of the waist [m].")]
Length = Annotated[float, _skirt_option(max=2, help="Length from waist to hem [m].")]
HemRadius = Annotated[
    float | None, _skirt_option("--hem", max=3, help="Radius of the A-line skirt's hem [m], by default 0.22.")
]
HipRadius = Annotated[float, _skirt_option("--hip", max=2, help="Radius of the hips [m]; 0 for no body in the skirt.")]
Motion = Annotated[MotionName | None, motion_option(help="How the waist moves, by default sway.")]
Amplitude = Annotated[
    float | None, motion_option(help="Amplitude of the motion: by default 0.08 m of sway, or a turn of 90 deg.")
]
Period = Annotated[float | None, motion_option(max=600, help="Period of the motion [s], 0.2 or more, by default 1.2.")]
Duration = Annotated[
    float | None, motion_option(max=600, help="How long the waist moves [s], 0.1 or more, by default 2.4.")
]
SkirtVertices = Annotated[
    int,
    simulation_option("--vertices", min=1, max=MOST_VERTICES, help="Vertices of the skirt's mesh, 150 or more."),
]
Draws = Annotated[
    int, simulation_option(max=MOST_SAMPLES, help="Skirts of a cloth, each of its own draw of its stiffness.")
]
LayingHeight = Annotated[
    float, simulation_option(help="Standard deviation of the heights in which each skirt is put on [m].")
]


def waist_motion(
    moves: bool, motion: MotionName | None, amplitude: float | None, period: float | None, seconds: float | None
) -> WaistMotion | None:
    """The motion that the options ask for; None is the usual value of each.

    Args:
        moves: Whether the waist is moved at all.
        motion: Kind of the motion.
        amplitude: Its amplitude [m or deg].
        period: Its period [s].
        seconds: How long it lasts [s].

    Returns:
        The motion, None of a waist that is not moved.

    Raises:
        GarmentError: A value out of range, or something is asked of a motion that there is not.
    """
    from cusick_bench.garment import GarmentError, WaistMotion

    if not moves:
        asked = {"--motion": motion, "--amplitude": amplitude, "--period": period, "--duration": seconds}
        for name, value in asked.items():
            if value is not None:
                raise GarmentError(f"{name} is about a waist that moves; leave it out, or give --dynamic")
        return None
    times = {name: value for name, value in (("period", period), ("seconds", seconds)) if value is not None}
    if motion is not MotionName.turn:
        return WaistMotion(sway=0.08 if amplitude is None else amplitude, **times)
    return WaistMotion(turn=math.radians(90.0 if amplitude is None else amplitude), **times)


def skirt_size(kind: KindName, waist: float, length: float, hem: float | None) -> SkirtSize:
    """The measures that the options ask for.

    Args:
        kind: Cut of the skirt.
        waist: Radius of the waist [m].
        length: Length from waist to hem [m].
        hem: Radius of the hem of an A-line skirt [m]; None for the usual one.

    Returns:
        The measures.

    Raises:
        GarmentError: A value out of range, or a hem is asked of a skirt that has none of its own.
    """
    from cusick_bench.garment import GarmentError, SkirtSize

    if hem is None:
        return SkirtSize(waist, length)
    if kind is KindName.circular:
        raise GarmentError(
            "--hem is about an A-line skirt, and a circular one is waist + length wide; leave it out, or give "
            "--kind a-line"
        )
    return SkirtSize(waist, length, hem)


def wearing_of(
    kind: KindName, size: SkirtSize, hip: float, motion: WaistMotion | None, *, vertices: int, draws: int,
    laying_height: float, seed: int,
) -> Wearing:  # fmt: skip
    """How a cloth is worn, by the options.

    Args:
        kind: Cut of the skirt.
        size: Its measures.
        hip: Radius of the hips [m], 0 for no body.
        motion: How the waist moves, or None.
        vertices: Size of the mesh.
        draws: Skirts of a cloth.
        laying_height: Standard deviation of the heights in which each skirt is put on [m].
        seed: Seed of pattern, draws and heights.

    Returns:
        The wearing.

    Raises:
        GarmentError: A value out of range.
    """
    from cusick_bench.garment import Body
    from cusick_bench.garment.wearing import Wearing

    body = None if hip == 0 else Body(waist=size.waist, hip=hip)
    return Wearing(kind.value, size, vertices, body, motion, draws, laying_height, seed)
