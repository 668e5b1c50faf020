"""Panels of a graph: linear axes, their ticks and titles, level lines, bars."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.report.drawing.svg import label, line, upright

FRAME = (46.0, 8.0, 12.0, 38.0)
"""Room for ticks and titles left of, above, right of and below a panel with `frame` [px]."""


@dataclass(frozen=True)
class Panel:
    """A rectangle of the picture with linear axes.

    Attributes:
        left, top, width, height: Where it lies.
        x, y: Data at its left and right, and at its lower and upper edge.
    """

    left: float
    top: float
    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float] = (0.0, 1.0)

    @property
    def right(self) -> float:
        """Its right edge."""
        return self.left + self.width

    @property
    def bottom(self) -> float:
        """Its lower edge."""
        return self.top + self.height

    def column(self, value: float) -> float:
        """Horizontal place of a value."""
        return self.left + (value - self.x[0]) / (self.x[1] - self.x[0]) * self.width

    def row(self, value: float) -> float:
        """Vertical place of a value."""
        return self.bottom - (value - self.y[0]) / (self.y[1] - self.y[0]) * self.height

    def points(self, x: Float[ndarray, " points"], y: Float[ndarray, " points"]) -> str:
        """Points of a line through data."""
        return " ".join(f"{self.column(a):.1f},{self.row(b):.1f}" for a, b in zip(x, y, strict=True))


def framed(width: float, height: float, x: tuple[float, float], y: tuple[float, float]) -> Panel:
    """The panel of a picture of a size that leaves room for its `frame`."""
    left, above, right, below = FRAME
    return Panel(left, above, width - left - right, height - above - below, x, y)


def frame(
    panel: Panel,
    x_title: str,
    y_title: str,
    x_ticks: Sequence[float],
    y_ticks: Sequence[float],
    *,
    y_words: Callable[[float], str] = "{:g}".format,
) -> list[str]:
    """Both axes.

    Args:
        panel: Where they are.
        x_title, y_title: What they measure, with the unit.
        x_ticks, y_ticks: Values that are marked.
        y_words: What stands at a tick of y.
    """
    parts = [line(panel.left, panel.bottom, panel.right, panel.bottom, "axis")]
    for tick in x_ticks:
        column = panel.column(tick)
        parts.append(line(column, panel.bottom, column, panel.bottom + 4, "axis"))
        parts.append(label(column, panel.bottom + 17, f"{tick:g}", "tick middle"))
    for tick in y_ticks:
        row = panel.row(tick)
        parts.append(line(panel.left, row, panel.right, row, "grid"))
        parts.append(label(panel.left - 6, row + 4, y_words(tick), "tick end"))
    parts.append(label((panel.left + panel.right) / 2, panel.bottom + 34, x_title, "tick middle"))
    return [*parts, upright(panel.left - 35, (panel.top + panel.bottom) / 2, y_title, "tick")]


def level(panel: Panel, value: float, words: str = "") -> list[str]:
    """A line across the panel at a value of y that has a meaning, nothing where it lies outside."""
    row = panel.row(value)
    if not panel.top <= row <= panel.bottom:
        return []
    named = [label(panel.right - 2, row - 3, words, "tick end")] if words else []
    return [line(panel.left, row, panel.right, row, "level"), *named]


def bar(panel: Panel, value: float, y: float, thickness: float, style: str) -> str:
    """A bar from 0 to the value, downwards from y."""
    start, end = sorted((panel.column(0.0), panel.column(value)))
    return f'<rect class="{style}" x="{start:.1f}" y="{y:.1f}" width="{end - start:.1f}" height="{thickness:g}"/>'


def span(values: Sequence[float], *, room: float = 0.0) -> tuple[float, float]:
    """Smallest range that holds the values and 0, never empty; with room above, as a share of it."""
    low, high = min(0.0, *values, 0.0), max(0.0, *values, 0.0)
    if high - low < 1e-12:
        high = low + 1.0
    return low, high + room * (high - low)


def round_steps(low: float, high: float, count: int = 5) -> list[float]:
    """Some round numbers within a range, about so many."""
    rough = (high - low) / count
    size = 10.0 ** np.floor(np.log10(rough))
    step = next(s * size for s in (1, 2, 5, 10) if s * size >= rough)
    first = int(np.ceil(low / step - 1e-9))
    return [step * k for k in range(first, int(np.floor(high / step + 1e-9)) + 1)]
