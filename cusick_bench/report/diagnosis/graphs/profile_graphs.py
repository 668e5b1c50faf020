"""Graphs of data, base model and base model with the cause: radius over angle, sorted radii, silhouettes."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from cusick_bench.report.diagnosis.graphs.profiles import ANGLES, SIDES, SOURCES, Sided
from cusick_bench.report.drawing.inline_svg import TICK_SIZE, page_figure, panel
from cusick_bench.report.drawing.palette import CAUSE, MODEL, REAL, RULE, SOFT, TINT
from cusick_bench.report.drawing.radius_over_angle import (
    closed,
    draw_levels,
    draw_range,
    draw_turn,
    label_axes,
    radius_limits,
)
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

_STEP = 3  # degrees from point to point of a line
MOST_LINES = 24
"""Most drapes of a panel; of more, so many evenly spaced ones."""
_LEFT, _RIGHT, _TOP, _BOTTOM = 46.0, 8.0, 12.0, 40.0  # room around the axes [px]
_LINE = {
    "data": {"color": REAL, "linewidth": 2.6},
    "base": {"color": MODEL, "linewidth": 2.0, "linestyle": (0, (3, 1.5))},
    "effect": {"color": CAUSE, "linewidth": 2.0},
}
"""Style of each source's lines."""


def mean_graph(sided: Sided, side: str) -> Figure:
    """Mean shape of each source on one side, and the range that the data's samples fill.

    Args:
        sided: The drapes.
        side: "up" or "down".

    Returns:
        The figure.
    """
    every = [drapes.shapes.mean(0) for sides in sided.values() for drapes in sides.values()]
    every += [drapes.shapes for drapes in sided.get("data", {}).values()]
    low, high = (1e3 * edge for edge in (min(s.min() for s in every), max(s.max() for s in every)))
    figure, axes = _framed(448, 230)
    label_axes(axes, (low - 2, high + 2), "angle from warp [°], cloth seen face up")
    draw_levels(axes)
    for source in (source for source in SOURCES if side in sided.get(source, {})):
        shapes = sided[source][side].shapes[:, ::_STEP]
        if source == "data" and len(shapes) > 1:
            draw_range(axes, shapes, color=REAL, alpha=0.14)
        draw_turn(axes, shapes.mean(0), **_LINE[source])
    return figure


def every_graph(sided: Sided, source: str) -> Figure:
    """Radius over angle of the drapes of a source, on both sides.

    Args:
        sided: The drapes.
        source: One of them.

    Returns:
        The figure.
    """
    figure, axes = _framed(300, 200)
    label_axes(axes, _shared_limits(sided), "angle from warp [°]")
    draw_levels(axes)
    radii = np.concatenate([drapes.radii for drapes in sided.get(source, {}).values()])
    for index in np.unique(np.linspace(0, len(radii) - 1, MOST_LINES).astype(int)):
        draw_turn(axes, radii[index, ::_STEP], color=_LINE[source]["color"], linewidth=1, alpha=0.5)
    return figure


def sorted_graph(sided: Sided) -> Figure:
    """Mean over drapes of the sorted radii: how much of the outline lies within a radius, wherever folds fall.

    Args:
        sided: The drapes.

    Returns:
        The figure.
    """
    figure, axes = _framed(300, 240)
    label_axes(axes, _shared_limits(sided), "share of the outline [%]")
    axes.set(xlim=(0, 100), xticks=(0, 25, 50, 75, 100))
    draw_levels(axes)
    share = np.linspace(0, 100, ANGLES)
    for source in (source for source in SOURCES if sided.get(source)):
        radii = np.concatenate([drapes.radii for drapes in sided[source].values()])
        axes.plot(share[::_STEP], 1e3 * np.sort(radii, axis=1).mean(0)[::_STEP], **_LINE[source])
    return figure


def silhouette_graph(sided: Sided, side: str) -> Figure:
    """Outlines of one typical drape of each source, from above, on the plate and the flat cloth.

    Args:
        sided: The drapes.
        side: "up" or "down".

    Returns:
        The figure.
    """
    figure = page_figure(300, 300)
    axes = panel(figure, 0, 0, 300, 300)
    axes.set(xlim=(-0.175, 0.175), ylim=(-0.175, 0.175))
    axes.set_axis_off()
    axes.add_patch(Circle((0, 0), CLOTH_RADIUS, fill=False, edgecolor=RULE, linewidth=1))
    dashes = (0, (4, 4))
    axes.add_patch(Circle((0, 0), PLATE_RADIUS, facecolor=TINT, edgecolor=SOFT, linewidth=1, linestyle=dashes))
    axes.text(0, 0, "plate", ha="center", va="center", color=SOFT, fontsize=TICK_SIZE)
    angle = np.deg2rad(np.arange(0, ANGLES + 1, 1))
    for source in (source for source in SOURCES if side in sided.get(source, {})):
        radius = closed(sided[source][side].typical)
        x, y = radius * np.cos(angle), radius * np.sin(angle)
        if source == "data":
            axes.fill(x, y, color=REAL, alpha=0.09, linewidth=0)
        axes.plot(x, y, solid_joinstyle="round", **_LINE[source])
    return figure


def _framed(width: float, height: float) -> tuple[Figure, Axes]:
    """A figure with room for ticks and titles around its axes."""
    figure = page_figure(width, height)
    return figure, panel(figure, _LEFT, _TOP, width - _LEFT - _RIGHT, height - _TOP - _BOTTOM)


def _shared_limits(sided: Sided) -> tuple[float, float]:
    """Of the radius [mm], the same in all graphs so that they can be compared."""
    return radius_limits(*(sided[source][side].radii for source in sided for side in SIDES if side in sided[source]))
