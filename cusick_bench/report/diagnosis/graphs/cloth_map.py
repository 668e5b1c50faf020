"""The map of the cloth: where on it the cause of a gap sits."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from numpy import ndarray

from cusick_bench.diagnosis.inference.single_effects.localise import EDGES, SECTORS
from cusick_bench.report.diagnosis.wording.number_format import percent
from cusick_bench.report.drawing.inline_svg import TICK_SIZE, page_figure, panel
from cusick_bench.report.drawing.palette import CARD, MAP, REAL, SOFT, TINT
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

_PALEST, _GREY = 0.06, 0.45  # opacity of a cell without probability; of the darkest cell where no place is named
_DARKEST = 6  # in shares of an even map: below, the map's colours stay pale
_MIDDLE, _PIXELS = (200.0, 196.0), 1060.0  # middle of the map [px], pixels of a metre
_DIRECTIONS = ((0, "0°\nwarp", "left", "center"), (90, "90° weft", "center", "bottom"),
               (180, "180°", "right", "center"), (270, "270°", "center", "top"))  # fmt: skip


@dataclass(frozen=True)
class Region:
    """A place on the cloth.

    Attributes:
        angle: First and last angle, counter-clockwise from warp [deg]; None for all around.
        radius: Inner and outer radius [m]; None for all of them.
    """

    angle: tuple[float, float] | None = None
    radius: tuple[float, float] | None = None


@dataclass(frozen=True)
class Arrow:
    """The direction of a cause.

    Attributes:
        angle: Counter-clockwise from warp [deg].
        both_ways: Whether the opposite direction is the same.
    """

    angle: float
    both_ways: bool = False


@dataclass(frozen=True)
class _Shades:
    """Colours of the map: one hue where a place is named, pale greys where the map says nothing of the cause."""

    named: bool

    def of(self, levels: Float[ndarray, " levels"]) -> list[tuple[float, float, float, float]]:
        """Colours of levels between 0 and 1."""
        colour, darkest = (MAP, 1.0) if self.named else (SOFT, _GREY)
        return [to_rgba(colour, _PALEST + (darkest - _PALEST) * level) for level in np.clip(levels, 0, 1).tolist()]


def cloth_map(
    shares: Float[ndarray, "4 16"] | None, region: Region | None, arrow: Arrow | None, *, key: str = ""
) -> Figure:
    """The cloth from above, face up, with the probability of a local patch at each place.

    Args:
        shares: Probability by ring, from the plate outwards, and sector, counter-clockwise from warp.
        region: Place to outline; without one the map is grey, since it then says nothing of the cause.
        arrow: Direction to draw.
        key: Words below the colours' scale; by default what the map says.

    Returns:
        The figure.
    """
    figure = page_figure(400, 434)
    size = _PIXELS * CLOTH_RADIUS
    axes = panel(figure, _MIDDLE[0] - size, _MIDDLE[1] - size, 2 * size, 2 * size, polar=True)
    axes.set(ylim=(0, CLOTH_RADIUS))
    axes.set_axis_off()
    shades = _Shades(named=region is not None)
    top = 1.0 if shares is None else max(float(shares.max()), _DARKEST / shares.size)
    _draw_cells(axes, np.zeros((len(EDGES) - 1, SECTORS)) if shares is None else shares / top, shades)
    _draw_circles(axes)
    if arrow is None:
        axes.text(0, 0, "plate", ha="center", va="center", color=SOFT, fontsize=TICK_SIZE)
    else:
        _draw_arrow(axes, arrow)
    if region is not None:
        _draw_outline(axes, region)
    _draw_scale(figure, None if shares is None else top, shades, key)
    return figure


def _draw_cells(axes: Axes, levels: Float[ndarray, "rings sectors"], shades: _Shades) -> None:
    width = 2 * np.pi / SECTORS
    for ring, row in enumerate(levels):
        axes.bar(
            np.arange(SECTORS) * width, EDGES[ring + 1] - EDGES[ring], width, EDGES[ring], align="edge",
            color=shades.of(row), edgecolor=CARD, linewidth=1,
        )  # fmt: skip


def _draw_circles(axes: Axes) -> None:
    """Plate and edge of the cloth, with the names of directions around."""
    around = np.linspace(0, 2 * np.pi, 181)
    axes.fill(around, np.full(181, PLATE_RADIUS), facecolor=TINT, edgecolor=SOFT, linestyle=(0, (4, 4)), linewidth=1)
    axes.plot(around, np.full(181, CLOTH_RADIUS), color=SOFT, linewidth=1, clip_on=False)
    for degrees, words, horizontal, vertical in _DIRECTIONS:
        axes.text(
            np.deg2rad(degrees), CLOTH_RADIUS + 0.006, words, ha=horizontal, va=vertical, color=SOFT, fontsize=TICK_SIZE
        )


def _draw_outline(axes: Axes, region: Region) -> None:
    inner, outer = region.radius or (EDGES[0], EDGES[-1])
    first, last = np.deg2rad(region.angle or (0.0, 360.0))
    angle = np.linspace(first, last, max(2, round((last - first) / np.deg2rad(3))))
    out, back = (angle, np.full(len(angle), outer)), (angle[::-1], np.full(len(angle), inner))
    all_around = last - first >= 2 * np.pi
    rings = [out, back] if all_around else [np.concatenate([out, back], axis=1)]
    for ring_angle, radius in rings:
        axes.fill(
            ring_angle, radius, fill=False, edgecolor=REAL, linewidth=3.5, joinstyle="round", clip_on=False,
            label="region",
        )  # fmt: skip


def _draw_arrow(axes: Axes, arrow: Arrow) -> None:
    """An arrow across the plate."""
    angle = np.deg2rad(arrow.angle)
    line = {"color": REAL, "linewidth": 3.5, "mutation_scale": 14, "shrinkA": 0, "shrinkB": 0, "joinstyle": "miter"}
    line["arrowstyle"] = "<|-|>" if arrow.both_ways else "-|>"
    start = 0.078 if arrow.both_ways else 0.05
    axes.annotate("", (angle, 0.078), xytext=(angle + np.pi, start), arrowprops=line)


def _draw_scale(figure: Figure, top: float | None, shades: _Shades, words: str) -> None:
    """Key of the map's colours."""
    axes = panel(figure, 130, 402, 140, 10)
    axes.set(xlim=(0, 20), ylim=(0, 1))
    axes.set_axis_off()
    style = {"color": SOFT, "fontsize": TICK_SIZE, "annotation_clip": False, "textcoords": "offset points"}
    if top is None:
        axes.annotate("no map was made", (10, 0), xytext=(0, 0), ha="center", **style)
        return
    axes.bar(np.arange(20), 1, 1.0, color=shades.of(np.linspace(0, 1, 20)), align="edge")
    axes.annotate("0 %", (0, 0.5), xytext=(-6, 0), ha="right", va="center", **style)
    axes.annotate(percent(top), (20, 0.5), xytext=(6, 0), va="center", **style)
    says = "probability that the cause sits there" if shades.named else "if the cause were a local patch: no finding"
    axes.annotate(words or says, (10, 0), xytext=(0, -4), ha="center", va="top", **style)
