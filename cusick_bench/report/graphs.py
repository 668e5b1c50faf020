"""Line graphs as inline SVG, coloured by the page's style sheet, so that they follow its light or dark mode."""

from dataclasses import dataclass
from math import ceil, floor, log10

import numpy as np
from jaxtyping import Float
from markupsafe import Markup, escape
from numpy import ndarray

_HEIGHT = 210
_LEFT, _RIGHT, _TOP, _BOTTOM = 44, 10, 10, 34
_PLATE_MM, _CLOTH_MM = 90.0, 150.0


@dataclass(frozen=True)
class _Axes:
    """Linear map from data to the picture."""

    x: tuple[float, float]
    y: tuple[float, float]
    width: int

    @property
    def right(self) -> int:
        return self.width - _RIGHT

    def column(self, value: float) -> float:
        return _LEFT + (value - self.x[0]) / (self.x[1] - self.x[0]) * (self.right - _LEFT)

    def row(self, value: float) -> float:
        return _HEIGHT - _BOTTOM - (value - self.y[0]) / (self.y[1] - self.y[0]) * (_HEIGHT - _TOP - _BOTTOM)

    def points(self, x: ndarray, y: ndarray) -> str:
        return " ".join(f"{self.column(a):.1f},{self.row(b):.1f}" for a, b in zip(x, y, strict=True))


def profile_graph(
    real: Float[ndarray, " angles"],
    simulated: Float[ndarray, " angles"],
    unseen: Float[ndarray, "samples angles"] | None,
    description: str,
) -> Markup:
    """Radius over angle: the real training sample, the simulation, and the band that unseen samples fill.

    Args:
        real: Radii at equidistant angles [m].
        simulated: Radii at the same angles [m].
        unseen: Radii of unseen samples [m], None where they are not at hand.
        description: What a reader who cannot see the graph is told.
    """
    every = [real, simulated] if unseen is None else [real, simulated, *unseen]
    low = min(85.0, 5 * floor(200 * min(radii.min() for radii in every)))
    high = max(153.0, 1e3 * max(radii.max() for radii in every) + 3)
    axes = _Axes((0.0, 360.0), (low, high), 560)
    angle = np.arange(0, len(real) + 1, 3) * 360 / len(real)
    parts = [
        _grid(
            axes, [0.0, 90.0, 180.0, 270.0, 360.0], [90.0, 110.0, 130.0, 150.0], "angle from warp [deg]", "radius [mm]"
        )
    ]
    parts += [_level(axes, _PLATE_MM, "plate"), _level(axes, _CLOTH_MM, "flat cloth")]
    if unseen is not None and len(unseen) > 1:
        edges = [1e3 * np.append(edge, edge[0])[::3] for edge in (unseen.min(0), unseen.max(0))]
        around = axes.points(np.concatenate([angle, angle[::-1]]), np.concatenate([edges[0], edges[1][::-1]]))
        parts.append(f'<polygon class="band" points="{around}"/>')
    for radii, name in ((real, "real"), (simulated, "simulated")):
        parts.append(_line(axes.points(angle, 1e3 * np.append(radii, radii[0])[::3]), name))
    return _svg(parts, axes.width, description)


def trace_graph(trace: Float[ndarray, "evaluations 2"], description: str) -> Markup:
    """Best training loss over cost, on a logarithmic scale; empty where fewer than two evaluations are known.

    Args:
        trace: Forward-equivalents and best loss after each evaluation.
        description: What a reader who cannot see the graph is told.
    """
    trace = trace[(trace > 0).all(1)] if len(trace) else trace
    if len(trace) < 2:
        return Markup("")
    cost, loss = trace[:, 0], np.log10(trace[:, 1])
    low, high = floor(4 * loss.min()) / 4, ceil(4 * loss.max() + 1e-9) / 4
    axes = _Axes((0.0, float(cost.max())), (low, max(high, low + 0.25)), 415)
    ticks = [m * 10.0**e for e in range(floor(low), ceil(high) + 1) for m in (1, 2, 5)]
    shown = [tick for tick in ticks if low <= log10(tick) <= axes.y[1]]
    step = 10 ** floor(log10(cost.max())) / (1 if cost.max() >= 4 * 10 ** floor(log10(cost.max())) else 2)
    parts = [_grid(axes, np.arange(0, cost.max() + 1e-9, step).tolist(), [], "cost [drapes]", "best loss")]
    for tick in shown:
        row = axes.row(log10(tick))
        parts.append(f'<line class="grid" x1="{_LEFT}" x2="{axes.right}" y1="{row:.1f}" y2="{row:.1f}"/>')
        parts.append(f'<text class="tick end" x="{_LEFT - 5}" y="{row + 3.5:.1f}">{_number(tick)}</text>')
    stairs = np.repeat(np.column_stack([cost, loss]), 2, axis=0)
    parts.append(_line(axes.points(stairs[1:, 0], stairs[:-1, 1]), "simulated"))
    return _svg(parts, axes.width, description)


def _number(value: float) -> str:
    return f"{value:g}".replace("0.", ".", 1) if value < 1 else f"{value:g}"


def _grid(axes: _Axes, x_ticks: list[float], y_ticks: list[float], x_title: str, y_title: str) -> str:
    base = _HEIGHT - _BOTTOM
    parts = [f'<line class="axis" x1="{_LEFT}" x2="{axes.right}" y1="{base}" y2="{base}"/>']
    for tick in x_ticks:
        parts.append(f'<text class="tick middle" x="{axes.column(tick):.1f}" y="{base + 14}">{tick:g}</text>')
    for tick in y_ticks:
        row = axes.row(tick)
        parts.append(f'<line class="grid" x1="{_LEFT}" x2="{axes.right}" y1="{row:.1f}" y2="{row:.1f}"/>')
        parts.append(f'<text class="tick end" x="{_LEFT - 5}" y="{row + 3.5:.1f}">{tick:g}</text>')
    middle = (_LEFT + axes.right) / 2
    parts.append(f'<text class="title middle" x="{middle}" y="{_HEIGHT - 4}">{escape(x_title)}</text>')
    turn = f'transform="rotate(-90 11 {_HEIGHT / 2 - 10})"'
    parts.append(f'<text class="title middle" x="11" y="{_HEIGHT / 2 - 10}" {turn}>{escape(y_title)}</text>')
    return "".join(parts)


def _level(axes: _Axes, value: float, name: str) -> str:
    row = axes.row(value)
    return (
        f'<line class="level" x1="{_LEFT}" x2="{axes.right}" y1="{row:.1f}" y2="{row:.1f}"/>'
        f'<text class="tick end" x="{axes.right - 2}" y="{row - 3:.1f}">{name}</text>'
    )


def _line(points: str, name: str) -> str:
    return f'<polyline class="line {name}" points="{points}"/>'


def _svg(parts: list[str], width: int, description: str) -> Markup:
    # Everything in `parts` is numbers and fixed words; only the description comes from outside.
    head = f'<svg class="graph" viewBox="0 0 {width} {_HEIGHT}" role="img" aria-label="{escape(description)}">'
    return Markup(head + "".join(parts) + "</svg>")
