"""Numbers of a fabric over the ranges that measured fabrics fill: a panel for each quantity, a row a direction."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log10

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cusick_bench.report.drawing.inline_svg import TICK_SIZE, page_figure, panel
from cusick_bench.report.drawing.palette import INK, MODEL, REAL, RULE, SOFT
from cusick_bench.report.drawing.stiffness_graph import number_ticks

_WIDTH, _LEFT, _GAP, _RIGHT = 1000.0, 120.0, 70.0, 14.0  # [px]
_TOP, _BOTTOM, _ROW = 30.0, 40.0, 40.0
_ROOM = 0.05  # decades beside the outermost numbers
_ALL, _SIMILAR = 0.17, 0.13  # how far above and below the row's middle the two ranges lie


@dataclass(frozen=True)
class FabricRow:
    """One number of the fabric.

    Attributes:
        label: Direction.
        value: The number, in the panel's unit.
        ci90: Its interval; None without one.
        every: Quantiles at 5, 25, 50, 75 and 95 % of all measured fabrics.
        similar: Those of fabrics of similar weight.
    """

    label: str
    value: float
    ci90: tuple[float, float] | None
    every: tuple[float, ...]
    similar: tuple[float, ...]


@dataclass(frozen=True)
class FabricPanel:
    """One quantity.

    Attributes:
        title: What it is.
        unit: Its unit.
        rows: A row for each direction; the same in all panels.
    """

    title: str
    unit: str
    rows: Sequence[FabricRow]


def fabric_range_graph(panels: Sequence[FabricPanel]) -> Figure:
    """The fabric's numbers over the ranges of measured fabrics.

    Args:
        panels: Quantities, at least one.

    Returns:
        The figure: thin lines hold 90 % of the fabrics, thick ones half of them, a mark across is the median; all
        fabrics above, those of similar weight below, the fabric itself with its interval in the middle.
    """
    count = len(panels[0].rows)
    figure = page_figure(_WIDTH, _TOP + _BOTTOM + _ROW * count)
    width = (_WIDTH - _LEFT - _RIGHT - _GAP * (len(panels) - 1)) / len(panels)
    for place, one in enumerate(panels):
        axes = panel(figure, _LEFT + place * (width + _GAP), _TOP, width, _ROW * count)
        numbers = [number for row in one.rows for number in (*row.every, *row.similar, row.value, *(row.ci90 or ()))]
        limits = 10 ** (log10(min(numbers)) - _ROOM), 10 ** (log10(max(numbers)) + _ROOM)
        axes.set(xscale="log", xlim=limits, ylim=(count - 0.5, -0.5), xlabel=one.unit)
        axes.set_yticks(range(count), [row.label if place == 0 else "" for row in one.rows])
        axes.tick_params(axis="y", labelcolor=INK)
        axes.grid(axis="y", visible=False)
        number_ticks(axes, limits)
        axes.text(0, -0.5 - 10 / _ROW, one.title, transform=axes.get_yaxis_transform(), color=INK, size=TICK_SIZE + 1.5)
        for height, row in enumerate(one.rows):
            axes.axhline(height - 0.5, color=RULE, linewidth=1)
            _range(axes, height - _ALL, row.every, SOFT)
            _range(axes, height + _SIMILAR, row.similar, REAL)
            _number(axes, height, row)
    return figure


def _range(axes: Axes, height: float, quantiles: tuple[float, ...], colour: str) -> None:
    low, lower, middle, upper, high = quantiles
    axes.plot([low, high], [height, height], color=colour, linewidth=1.2, solid_capstyle="butt")
    axes.plot([lower, upper], [height, height], color=colour, linewidth=6, alpha=0.45, solid_capstyle="butt")
    axes.plot([middle], [height], marker="|", markersize=8, color=colour, linestyle="none")


def _number(axes: Axes, height: float, row: FabricRow) -> None:
    if row.ci90 is not None:
        axes.plot(row.ci90, [height, height], color=MODEL, linewidth=2)
    axes.plot([row.value], [height], marker="o", markersize=6.5, color=MODEL, linestyle="none")
