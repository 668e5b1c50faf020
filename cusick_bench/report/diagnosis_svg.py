"""What the graphs of a diagnosis are drawn with: SVG that the page's style sheet colours.

Coordinates are pixels of the page at full width, y down. Text that comes from outside is escaped here.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from markupsafe import Markup, escape
from numpy import ndarray


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


def picture(parts: Sequence[str], width: float, height: float, description: str, style: str = "") -> Markup:
    """The picture.

    Args:
        parts: What it shows, already safe.
        width, height: Its size [px].
        description: What a reader who cannot see it is told.
        style: Further class.
    """
    head = f'<svg class="{f"graph {style}".strip()}" viewBox="0 0 {width:g} {height:g}" role="img" '
    return Markup(head + f'aria-label="{escape(description)}">' + "".join(parts) + "</svg>")


def label(x: float, y: float, words: str, style: str = "") -> str:
    """Text with its baseline at y."""
    return f'<text class="{style}" x="{x:.1f}" y="{y:.1f}">{escape(words)}</text>'


def line(x1: float, y1: float, x2: float, y2: float, style: str) -> str:
    """A straight line."""
    return f'<line class="{style}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"/>'


def polyline(points: str, style: str) -> str:
    """An open line."""
    return f'<polyline class="line {style}" points="{points}"/>'


def polygon(points: str, style: str) -> str:
    """A closed outline."""
    return f'<polygon class="{style}" points="{points}"/>'


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
