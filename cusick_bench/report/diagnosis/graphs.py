"""Graphs of a diagnosis: the gap against its floor, its parts, stages, the map of the cloth, closure, z values."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from markupsafe import Markup
from numpy import ndarray

from cusick_bench.diagnosis.inference.localise import EDGES, SECTORS
from cusick_bench.report.diagnosis.values import percent, plain, signed
from cusick_bench.report.drawing.axes import Panel, bar, round_steps, span
from cusick_bench.report.drawing.svg import label, line, picture, polygon
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

_HUES = {True: ((238, 243, 249), (8, 48, 107)), False: ((244, 244, 245), (172, 176, 182))}
"""Colours of the map, lightest and darkest: one hue where a place is named, pale greys where none is."""
_DARKEST = 6  # in shares of an even map: below, the map's colours stay pale
_PIXELS = 1060.0  # of a metre of the map
_MIDDLE = (200.0, 196.0)


@dataclass(frozen=True)
class Bar:
    """A bar of a graph.

    Attributes:
        name: What stands before it.
        value: Its length, None if unknown.
        style: Its class.
        mark: A tick across it, such as a floor.
    """

    name: str
    value: float | None
    style: str
    mark: float | None = None


def gap_graph(bars: Sequence[Bar], floor: float | None, description: str) -> Markup:
    """The gap of each model, and the floor as a line through all bars.

    Args:
        bars: From the largest to what they are read against.
        floor: Smallest gap that the data allow to see, None if unknown.
        description: What a reader who cannot see the graph is told.
    """
    known = [one.value for one in bars if one.value is not None]
    height = 40 * len(bars) + 34
    panel = Panel(230, 8, 610, 40 * len(bars), span([*known, floor or 0.0]))
    parts = [*_axis(panel, "gap G: squared energy distance between data and model (0 = no difference)")]
    for index, one in enumerate(bars):
        y = panel.top + 40 * index + 7
        parts.append(label(panel.left - 12, y + 17, one.name, "name end"))
        if one.value is not None:
            parts.append(bar(panel, one.value, y, 24, one.style))
        parts.append(label(panel.column(max(one.value or 0.0, 0.0)) + 8, y + 17, plain(one.value), "value"))
    if floor is not None:
        parts.append(line(panel.column(floor), panel.top, panel.column(floor), panel.bottom, "floor"))
    return picture(parts, 930, height + 10, description, "wide")


def bars_graph(bars: Sequence[Bar], description: str, *, percents: bool = False, width: float = 440) -> Markup:
    """Bars one below another, with their values behind them.

    Args:
        bars: From top to bottom.
        description: What a reader who cannot see the graph is told.
        percents: Values are shares.
        width: Of the picture [px].
    """
    known = [value for one in bars for value in (one.value, one.mark) if value is not None]
    panel = Panel(168, 2, width - 168 - 56, 25 * len(bars), (0.0, 1.0) if percents else span(known))
    parts = [line(panel.column(0), panel.top, panel.column(0), panel.bottom, "axis")]
    for index, one in enumerate(bars):
        y = panel.top + 25 * index + 4
        parts.append(label(panel.left - 8, y + 13, one.name, "name small end"))
        if one.value is not None:
            parts.append(bar(panel, one.value, y, 16, one.style))
        if one.mark is not None:
            parts.append(line(panel.column(one.mark), y - 3, panel.column(one.mark), y + 19, "floor"))
        words = percent(one.value) if percents else plain(one.value)
        parts.append(label(panel.column(max(one.value or 0.0, one.mark or 0.0, 0.0)) + 7, y + 13, words, "value small"))
    return picture(parts, width, panel.bottom + 4, description)


def _axis(panel: Panel, title: str) -> list[str]:
    parts = [line(panel.left, panel.bottom, panel.right, panel.bottom, "axis")]
    for tick in round_steps(*panel.x):
        column = panel.column(tick)
        parts.append(line(column, panel.top, column, panel.bottom, "axis" if tick == 0 else "grid"))
        parts.append(label(column, panel.bottom + 14, signed(f"{tick:.3g}"), "tick middle"))
    parts.append(label((panel.left + panel.right) / 2, panel.bottom + 31, title, "tick middle"))
    return parts


def closure_graph(fraction: float, interval: tuple[float, float] | None, description: str) -> Markup:
    """The closed share of the gap, with its interval, between nothing and all of it; cut where it leaves -1 to 2."""
    length, *ends = (min(max(value, -1.0), 2.0) for value in (fraction, *(interval or ())))
    panel = Panel(20, 10, 860, 44, span([length, 1.0, *ends], room=0.02))
    parts = _quarters(panel)
    parts.append(bar(panel, length, panel.top + 10, 24, "cause"))
    if ends:
        y, (low, high) = panel.top + 22, (panel.column(value) for value in ends)
        parts.append(line(low, y, high, y, "whisker halo"))
        parts += [line(end, y - 8, end, y + 8, "whisker") for end in (low, high)]
        parts.append(line(low, y, high, y, "whisker"))
    return picture(parts, 900, panel.bottom + 28, description, "wide")


def _quarters(panel: Panel) -> list[str]:
    """Lines at nothing, quarters and all; the words of quarters only where there is room."""
    parts = []
    for tick, name in ((0.0, "nothing"), (0.25, ""), (0.5, "half"), (0.75, ""), (1.0, "all of it")):
        column = panel.column(tick)
        parts.append(line(column, panel.top - 4, column, panel.bottom + 4, "axis" if tick in (0, 1) else "grid"))
        if name or panel.x[1] - panel.x[0] < 1.5:
            style = "end" if tick == 1 else "middle" if tick or panel.x[0] < 0 else ""
            words = f"{percent(tick)}: {name}" if name else percent(tick)
            parts.append(label(column, panel.bottom + 20, words, f"tick {style}"))
    return parts


def share_bar(share: float | None, style: str) -> Markup:
    """A bare bar, as long as a share of its place."""
    width = 100 * min(max(share or 0.0, 0.0), 1.0)
    body = '<rect class="track" width="100" height="10"/>' + f'<rect class="{style}" width="{width:.2f}" height="10"/>'
    return Markup(f'<svg class="share" viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true">{body}</svg>')


def score_bar(score: float, most: float) -> Markup:
    """A bar to the right for what is above the base model, to the left for what is below."""
    panel = Panel(0, 0, 120, 12, (-most, most))
    parts = [line(60, 0, 60, 12, "axis"), bar(panel, score, 1.5, 9, "score")]
    return Markup('<svg class="scores" viewBox="0 0 120 12" aria-hidden="true">' + "".join(parts) + "</svg>")


@dataclass(frozen=True)
class Region:
    """A place on the cloth: sectors counter-clockwise from warp [deg], and radii [m]; None for all of them."""

    angle: tuple[float, float] | None = None
    radius: tuple[float, float] | None = None


def cloth_map(
    shares: Float[ndarray, "4 16"] | None,
    region: Region | None,
    arrow: tuple[float, bool] | None,
    description: str,
) -> Markup:
    """The cloth from above, face up, with the probability of a local patch at each place.

    Args:
        shares: Probability by ring, from the plate outwards, and sector, counter-clockwise from warp.
        region: Place to outline; without one the map is grey, since it then says nothing of the cause.
        arrow: Direction to draw, counter-clockwise from warp [deg], and whether it has both senses.
        description: What a reader who cannot see the map is told.
    """
    named = region is not None
    top = 1.0 if shares is None else max(float(shares.max()), _DARKEST / shares.size)
    parts = ['<g class="cells">']
    for ring, sector in np.ndindex(len(EDGES) - 1, SECTORS):
        share = 0.0 if shares is None else float(shares[ring, sector])
        width = 360 / SECTORS
        cell = Region((sector * width, (sector + 1) * width), (EDGES[ring], EDGES[ring + 1]))
        parts.append(f'<path d="{_outline(cell)}" fill="{_colour(share / top, named)}"/>')
    parts.append("</g>")
    parts += [_circle(PLATE_RADIUS, "plate"), _circle(CLOTH_RADIUS, "edge"), *_directions()]
    if arrow is not None:
        parts += _arrow(*arrow)
    else:
        parts.append(label(_MIDDLE[0], _MIDDLE[1] + 4, "plate", "tick middle"))
    if region is not None:
        parts.append(f'<path class="region" d="{_outline(region)}"/>')
    parts += _scale(None if shares is None else top, named)
    return picture(parts, 400, 434, description, "map")


def _place(radius: float, degrees: float) -> tuple[float, float]:
    angle = np.deg2rad(degrees)
    return float(_MIDDLE[0] + _PIXELS * radius * np.cos(angle)), float(_MIDDLE[1] - _PIXELS * radius * np.sin(angle))


def _outline(region: Region) -> str:
    """Path around a sector of a ring."""
    inner, outer = region.radius or (EDGES[0], EDGES[-1])
    first, last = region.angle or (0.0, 360.0)
    steps = np.linspace(first, last, max(2, round((last - first) / 3)))
    out, back = ([_place(r, d) for d in way] for r, way in ((outer, steps), (inner, steps[::-1])))
    rings = [out, back] if last - first >= 360 else [out + back]
    return " ".join("M" + "L".join(f"{x:.1f},{y:.1f}" for x, y in ring) + "Z" for ring in rings)


def _circle(radius: float, style: str) -> str:
    return f'<circle class="{style}" cx="{_MIDDLE[0]:g}" cy="{_MIDDLE[1]:g}" r="{_PIXELS * radius:.1f}"/>'


def _directions() -> list[str]:
    """Ends of warp and weft."""
    parts = []
    for degrees, words, style, drop in (
        (0, "0°", "", 4.0), (90, "90° weft", "middle", 0.0), (180, "180°", "end", 4.0), (270, "270°", "middle", 8.0),
    ):  # fmt: skip
        x, y = _place(CLOTH_RADIUS + 0.006, degrees)
        parts.append(label(x, y + drop, words, f"tick {style}"))
    x, y = _place(CLOTH_RADIUS + 0.006, 0)
    return [*parts, label(x, y + 17, "warp", "tick")]


def _arrow(degrees: float, both: bool) -> list[str]:
    """An arrow across the plate."""
    parts = []
    for turn in (0, 180) if both else (0,):
        tip, left, right = _place(0.078, degrees + turn), _place(0.066, degrees + turn - 6), None
        right = _place(0.066, degrees + turn + 6)
        parts.append(polygon(" ".join(f"{x:.1f},{y:.1f}" for x, y in (tip, left, right)), "head"))
    start, end = _place(0.068, degrees + 180) if both else _place(0.05, degrees + 180), _place(0.068, degrees)
    return [line(*start, *end, "arrow"), *parts]


def _scale(top: float | None, named: bool) -> list[str]:
    """Key of the map's colours."""
    if top is None:
        return [label(_MIDDLE[0], 412, "no map was made", "tick middle")]
    x, y, width = 130.0, 404.0, 140.0
    steps = np.linspace(0, 1, 20)
    parts = [
        f'<rect x="{x + s * width * 0.95:.1f}" y="{y:g}" width="{width / 20 + 0.6:.1f}" height="10" '
        f'fill="{_colour(s, named)}"/>'
        for s in steps
    ]
    ends = [label(x - 6, y + 9, "0 %", "tick end"), label(x + width + 6, y + 9, percent(top), "tick")]
    words = "probability that the cause sits there" if named else "of a local patch, were there one: not a finding"
    return [*parts, *ends, label(_MIDDLE[0], y + 23, words, "tick middle")]


def _colour(level: float, named: bool) -> str:
    pale, dark = (np.array(hue) for hue in _HUES[named])
    red, green, blue = np.round(pale + (dark - pale) * np.clip(level, 0, 1)).astype(int)
    return f"#{red:02x}{green:02x}{blue:02x}"
