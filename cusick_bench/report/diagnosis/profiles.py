"""Before and after: radius over angle and silhouettes of data, base model and base model with the cause.

Profiles come as the camera sees them. Here they are shown in the cloth's frame: of a cloth that lies face down and was
turned over about y, what is seen at theta belongs to 180 deg - theta of the cloth seen face up.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from markupsafe import Markup
from numpy import ndarray

from cusick_bench.report.diagnosis.values import items, mappings, number
from cusick_bench.report.drawing.axes import Panel, frame, framed, level, round_steps
from cusick_bench.report.drawing.svg import label, picture, polygon, polyline
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

ANGLES = 360
SOURCES = ("data", "base", "effect")
SIDES = ("up", "down")
_LARGEST = 1.0  # [m]; no sample is larger
_EVERY = 3  # degrees from point to point of a line
SHAPE_MODES = 4  # waves around an outline that no fold makes
_LINES = 24  # most drapes of a panel
_AROUND = (0.0, 360.0)  # angles of a whole turn [deg]
_OUTLINE_PIXELS = 850.0  # of a metre of a silhouette


@dataclass(frozen=True, eq=False)
class Drapes:
    """Profiles of one source on one side.

    Attributes:
        radii: In the cloth's frame [m].
        damaged: How many had no usable outline.
    """

    radii: Float[ndarray, "drapes 360"]
    damaged: int = 0

    def __len__(self) -> int:
        return len(self.radii)

    @property
    def shapes(self) -> Float[ndarray, "drapes 360"]:
        """The profiles without their folds [m]."""
        harmonics = np.fft.rfft(self.radii, axis=1)
        harmonics[:, SHAPE_MODES + 1 :] = 0
        return np.fft.irfft(harmonics, ANGLES, axis=1)

    @property
    def typical(self) -> Float[ndarray, "360"]:
        """The drape whose mean radius is the median."""
        return self.radii[np.argsort(self.radii.mean(1), kind="stable")[len(self) // 2]]


Sided = Mapping[str, Mapping[str, Drapes]]
"""Source -> side -> drapes; what there is none of is left out."""


def read_profiles(document: Any) -> dict[str, dict[str, Drapes]]:
    """Profiles of the document, source by source and side by side; an unknown side counts as up."""
    found: dict[str, dict[str, Drapes]] = {}
    for source in SOURCES:
        entries = mappings(document.get(source) if isinstance(document, Mapping) else None)
        for side in SIDES:
            own = [one for one in entries if (one.get("side") == "down") == (side == "down")]
            rings = [_ring(one.get("radii_m")) for one in own]
            usable = [ring for ring in rings if ring is not None]
            if usable:
                radii = np.stack([_cloth_frame(ring) if side == "down" else ring for ring in usable])
                found.setdefault(source, {})[side] = Drapes(radii, len(own) - len(usable))
    return found


def _ring(value: Any) -> Float[ndarray, "360"] | None:
    """Radii at whole degrees, None where they are no outline."""
    radii = [number(one) for one in items(value)]
    if len(radii) < 16 or any(one is None or not 0 < one < _LARGEST for one in radii):
        return None
    ring = np.array(radii, dtype=np.float64)
    places = np.arange(len(ring) + 1) * ANGLES / len(ring)
    return np.interp(np.arange(ANGLES), places, np.append(ring, ring[0]))


def _cloth_frame(ring: Float[ndarray, "360"]) -> Float[ndarray, "360"]:
    return ring[(ANGLES // 2 - np.arange(ANGLES)) % ANGLES]


def mean_difference(sided: Sided, source: str) -> tuple[float, float] | None:
    """How far a model's mean shape is from that of the data, root mean square over angles and sides.

    Returns:
        The difference, and what chance alone would make of it, from the spread between drapes [m]; None where there
        is nothing to compare.
    """
    shared = [side for side in SIDES if side in sided.get("data", {}) and side in sided.get(source, {})]
    pairs = [(sided["data"][side].shapes, sided[source][side].shapes) for side in shared]
    if not pairs:
        return None
    squares = [(model.mean(0) - data.mean(0)) ** 2 for data, model in pairs]
    errors = [_error(data) + _error(model) for data, model in pairs]
    return float(np.sqrt(np.mean(squares))), float(np.sqrt(np.mean(errors)))


def _error(shapes: Float[ndarray, "drapes 360"]) -> Float[ndarray, "360"]:
    """Variance of the mean, 0 for a single drape [m2]."""
    return shapes.var(0, ddof=min(1, len(shapes) - 1)) / len(shapes)


def mean_graph(sided: Sided, side: str, description: str) -> Markup:
    """Mean shape of each source on one side, and the range that the data's samples fill."""
    every = [drapes.shapes.mean(0) for sides in sided.values() for drapes in sides.values()]
    every += [drapes.shapes for drapes in sided.get("data", {}).values()]
    low, high = (1e3 * edge for edge in (min(s.min() for s in every), max(s.max() for s in every)))
    panel = framed(448, 230, _AROUND, (low - 2, high + 2))
    parts = _frame(panel, "angle from warp [°], cloth seen face up")
    data = sided.get("data", {}).get(side)
    if data is not None and len(data) > 1:
        low, high = (1e3 * _closed(edge) for edge in (data.shapes.min(0), data.shapes.max(0)))
        there = np.concatenate([_angles(), _angles()[::-1]])
        parts.append(polygon(panel.points(there, np.concatenate([low, high[::-1]])), "band"))
    for source in SOURCES:
        drapes = sided.get(source, {}).get(side)
        if drapes is not None:
            parts.append(polyline(panel.points(_angles(), 1e3 * _closed(drapes.shapes.mean(0))), source))
    return picture(parts, 448, 230, description)


def every_graph(sided: Sided, source: str, description: str) -> Markup:
    """Radius over angle of every drape of a source, both sides, and their mean."""
    panel = framed(300, 200, _AROUND, _range(sided))
    parts = _frame(panel, "angle from warp [°]")
    radii = np.concatenate([drapes.radii for drapes in sided.get(source, {}).values()])
    for index in np.unique(np.linspace(0, len(radii) - 1, _LINES).astype(int)):
        parts.append(polyline(panel.points(_angles(), 1e3 * _closed(radii[index])), f"{source} thin"))
    return picture(parts, 300, 200, description)


def sorted_graph(sided: Sided, description: str) -> Markup:
    """Mean over drapes of the sorted radii: how much of the outline lies within a radius, wherever folds fall."""
    panel = framed(300, 240, (0.0, 100.0), _range(sided))
    parts = _frame(panel, "share of the outline [%]", (0, 25, 50, 75, 100))
    share = np.linspace(0, 100, ANGLES // _EVERY)
    for source in SOURCES:
        rings = [drapes.radii for drapes in sided.get(source, {}).values()]
        if rings:
            mean = np.sort(np.concatenate(rings), axis=1).mean(0)
            values = np.interp(share, np.linspace(0, 100, ANGLES), mean)
            parts.append(polyline(panel.points(share, 1e3 * values), source))
    return picture(parts, 300, 240, description)


def silhouette_graph(sided: Sided, side: str, description: str) -> Markup:
    """Outlines of one typical drape of each source, from above, on the plate and the flat cloth."""
    middle, size = 150.0, 300.0
    parts = [
        f'<circle class="{style}" cx="{middle:g}" cy="{middle:g}" r="{_OUTLINE_PIXELS * radius:.1f}"/>'
        for radius, style in ((CLOTH_RADIUS, "flat"), (PLATE_RADIUS, "plate"))
    ]
    parts.append(label(middle, middle + 4, "plate", "tick middle"))
    angle = np.deg2rad(np.arange(0, ANGLES, 1.5))
    for source in SOURCES:
        drapes = sided.get(source, {}).get(side)
        if drapes is not None:
            radius = _OUTLINE_PIXELS * np.interp(np.arange(0, ANGLES, 1.5), np.arange(ANGLES), drapes.typical)
            x, y = middle + radius * np.cos(angle), middle - radius * np.sin(angle)
            points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
            parts.append(polygon(points, f"line {source}{' filled' if source == 'data' else ''}"))
    return picture(parts, size, size, description)


def _angles() -> Float[ndarray, " points"]:
    return np.arange(0, ANGLES + 1, _EVERY, dtype=np.float64)


def _closed(ring: Float[ndarray, "360"]) -> Float[ndarray, " points"]:
    return np.append(ring, ring[0])[::_EVERY]


def _range(sided: Sided) -> tuple[float, float]:
    """Of all radii [mm], so that graphs can be compared."""
    every = [drapes.radii for sides in sided.values() for drapes in sides.values()]
    low = min(85.0, *(1e3 * radii.min() - 2 for radii in every))
    high = max(153.0, *(1e3 * radii.max() + 2 for radii in every))
    return low, high


def _frame(panel: Panel, x_title: str, ticks: Sequence[float] = (0, 90, 180, 270, 360)) -> list[str]:
    """Axes, and the plate's and the flat cloth's radius."""
    parts = frame(panel, x_title, "radius [mm]", ticks, round_steps(*panel.y))
    return [*parts, *level(panel, 1e3 * PLATE_RADIUS), *level(panel, 1e3 * CLOTH_RADIUS)]
