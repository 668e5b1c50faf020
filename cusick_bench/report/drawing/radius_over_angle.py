"""Radius over angle: axes, and lines that close after a whole turn."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from numpy import ndarray

from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.report.drawing.palette import SOFT

WHOLE_TURN = (0, 90, 180, 270, 360)
"""Ticks of the angle [deg]."""


def radius_limits(*radii: Float[ndarray, "*_drapes _angles"], protocol: Protocol = RELEASE) -> tuple[float, float]:
    """Limits of the radius that show the radius of the plate, that of the flat cloth, and all drapes.

    Args:
        radii: Radii of drapes [m].
        protocol: Gives radii of plate and cloth.

    Returns:
        Lower and upper limit [mm].
    """
    low = min(1e3 * protocol.plate_radius_m - 5, *(1e3 * one.min() - 2 for one in radii))
    high = max(1e3 * protocol.cloth_radius_m + 3, *(1e3 * one.max() + 2 for one in radii))
    return float(low), float(high)


def label_axes(axes: Axes, limits: tuple[float, float] | None = None, angle: str = "angle from warp [deg]") -> None:
    """Titles, ticks and limits of radius over angle.

    Args:
        axes: Where to draw.
        limits: Limits of the radius [mm]; those of what is drawn by default.
        angle: Title of the angle.
    """
    axes.set(xlabel=angle, ylabel="radius [mm]", xlim=(0, 360), xticks=WHOLE_TURN)
    if limits is not None:
        axes.set_ylim(limits)


def draw_levels(axes: Axes, *, named: bool = False, colour: str = SOFT, protocol: Protocol = RELEASE) -> None:
    """Dotted lines at the radius of the plate and of the flat cloth.

    Args:
        axes: Where to draw.
        named: Whether their names stand above them.
        colour: Colour of the lines.
        protocol: Gives both radii.
    """
    low, high = axes.get_ylim()
    for metres, name in ((protocol.plate_radius_m, "plate"), (protocol.cloth_radius_m, "flat cloth")):
        radius = 1e3 * metres
        if not low <= radius <= high:
            continue
        axes.axhline(radius, color=colour, linewidth=0.9, linestyle=(0, (3, 4)), zorder=1)
        if named:
            place = {"xytext": (-2, 3), "textcoords": "offset points", "ha": "right"}
            axes.annotate(name, (360, radius), color=colour, fontsize=11, annotation_clip=False, **place)


def draw_turn(axes: Axes, radii: Float[ndarray, " angles"], **style: Any) -> None:
    """A line through the radii of one drape.

    Args:
        axes: Where to draw.
        radii: At equidistant angles from 0 [m].
        style: Options of matplotlib's line.
    """
    axes.plot(np.linspace(0, 360, len(radii) + 1), 1e3 * closed(radii), solid_joinstyle="round", **style)


def draw_range(axes: Axes, radii: Float[ndarray, "drapes angles"], **style: Any) -> None:
    """The range that several drapes fill.

    Args:
        axes: Where to draw.
        radii: At equidistant angles from 0 [m].
        style: Options of matplotlib's area.
    """
    angle = np.linspace(0, 360, radii.shape[1] + 1)
    low, high = 1e3 * closed(radii.min(0)), 1e3 * closed(radii.max(0))
    axes.fill_between(angle, low, high, linewidth=0, zorder=1.5, **style)


def closed(values: Float[ndarray, " angles"]) -> Float[ndarray, " points"]:
    """Values at equidistant angles with the first one again at the end.

    Args:
        values: At equidistant angles from 0.

    Returns:
        One value more.
    """
    return np.append(values, values[0])
