"""Bending stiffness that solvers found of one cloth, by direction: posteriors, fits and the truth."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, log10

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy import ndarray
from numpy.typing import ArrayLike
from scipy.stats import gaussian_kde

from cusick_bench.metrics.found_stiffness import FoundStiffness
from cusick_bench.metrics.stiffness import BENDING, GF_CM2_PER_CM
from cusick_bench.report.drawing.inline_svg import TICK_SIZE, page_figure, panel
from cusick_bench.report.drawing.palette import INK, MODEL, PALE, REAL, SOFT
from cusick_bench.report.drawing.row_names import row_names

_WIDTH, _LEFT, _GAP, _RIGHT = 1000.0, 205.0, 26.0, 10.0  # [px]
_TOP, _BOTTOM, _ROW = 48.0, 40.0, 32.0
_MICRO = 1e6
_ROOM = 0.12  # decades beside the outermost numbers
_GRID = 160  # points of a density
_FEWEST_TICKS, _MOST_TICKS = 2, 4


@dataclass(frozen=True, eq=False)
class StiffnessLine:
    """What one solver found.

    Attributes:
        label: Name of the solver.
        found: Stiffness with intervals.
        draws: Bending stiffness of draws from its posterior [N m], in the order of `BENDING`; None without one.
    """

    label: str
    found: FoundStiffness
    draws: Float[ndarray, "draws bending"] | None = None


def stiffness_graph(lines: Sequence[StiffnessLine]) -> Figure:
    """A panel for each direction, a row for each solver.

    Args:
        lines: What the solvers found of one cloth; at least one.

    Returns:
        The figure.
    """
    height = _TOP + _BOTTOM + _ROW * len(lines)
    figure = page_figure(_WIDTH, height)
    width = (_WIDTH - _LEFT - _RIGHT - 2 * _GAP) / len(BENDING)
    limits = _limits(lines)
    true = next((line.found.true_bending for line in lines if line.found.true_bending), None)
    names = row_names([line.label for line in lines])
    for place, direction in enumerate(BENDING):
        axes = panel(figure, _LEFT + place * (width + _GAP), _TOP, width, _ROW * len(lines))
        axes.set(xscale="log", xlim=limits, ylim=(len(lines) - 0.5, -0.5), xlabel="µN m")
        axes.set_yticks(range(len(lines)), names if place == 0 else [""] * len(lines), parse_math=False)
        axes.tick_params(axis="y", labelcolor=INK)
        _ticks(axes, limits)
        axes.text(0, -0.5 - 26 / _ROW, direction, transform=axes.get_yaxis_transform(), color=INK, size=TICK_SIZE + 1.5)
        if true is not None:
            axes.axvline(_MICRO * true[direction], color=REAL, linewidth=2, linestyle=(0, (4, 2)))
        for row, line in enumerate(lines):
            _draw(axes, row, line, place)
    return figure


def _draw(axes: Axes, row: int, line: StiffnessLine, place: int) -> None:
    one = line.found.bending[BENDING[place]]
    if line.draws is not None:
        grid, density = _density(_MICRO * line.draws[:, place])
        axes.fill_between(grid, row + 0.36, row + 0.36 - 0.72 * density, color=PALE, alpha=0.55, linewidth=0)
    if one.ci90 is not None:
        axes.plot([_MICRO * bound for bound in one.ci90], [row, row], color=MODEL, linewidth=2)
    axes.plot([_MICRO * one.value], [row], marker="o", markersize=6.5, color=MODEL, linestyle="none")


def _density(values: Float[ndarray, " draws"]) -> tuple[ndarray, ndarray]:
    """Density of the logarithm, 1 at its highest."""
    logs = np.log(values)
    spread = max(float(logs.std()), 1e-3)
    grid = np.linspace(logs.min() - spread, logs.max() + spread, _GRID)
    if logs.std() < 1e-9:
        return np.exp(grid), np.exp(-0.5 * ((grid - logs.mean()) / spread) ** 2)
    density = gaussian_kde(logs)(grid)
    return np.exp(grid), density / density.max()


def _limits(lines: Sequence[StiffnessLine]) -> tuple[float, float]:
    numbers = [
        bound for line in lines for one in line.found.bending.values() for bound in (one.value, *(one.ci90 or ()))
    ]
    numbers += [value for line in lines for value in (line.found.true_bending or {}).values()]
    positive = [_MICRO * number for number in numbers if number > 0] or [1.0]
    return 10 ** (log10(min(positive)) - _ROOM), 10 ** (log10(max(positive)) + _ROOM)


def _ticks(axes: Axes, limits: tuple[float, float]) -> None:
    """Ticks of the axis, and a second scale in gf cm2/cm."""
    number_ticks(axes, limits)
    other = axes.secondary_xaxis("top", functions=(_to_kawabata, _from_kawabata))
    other.spines["top"].set_color(SOFT)
    other.tick_params(colors=SOFT, labelsize=TICK_SIZE - 1.5)
    ticks = _round_numbers(*_to_kawabata(limits).tolist())
    other.set_xticks(ticks, [_plain(tick) for tick in ticks])
    other.minorticks_off()
    axes.text(
        1, 1 + 30 / (_ROW * abs(axes.get_ylim()[0] - axes.get_ylim()[1])), "gf cm²/cm", transform=axes.transAxes,
        ha="right", color=SOFT, size=TICK_SIZE - 1.5,
    )  # fmt: skip


def number_ticks(axes: Axes, limits: tuple[float, float]) -> None:
    """Ticks of a logarithmic x axis at 1, 2 and 5 of a decade, at powers of ten where that would be many.

    A short axis, on which fewer than two of these lie, has ticks at equal distances.

    Args:
        axes: The axes.
        limits: Ends of its x axis, > 0.
    """
    ticks = _round_numbers(*limits)
    axes.set_xticks(ticks, [_plain(tick) for tick in ticks])
    axes.minorticks_off()


def _to_kawabata(micro: ArrayLike) -> ndarray:
    return np.asarray(micro) / (_MICRO * GF_CM2_PER_CM)


def _from_kawabata(kawabata: ArrayLike) -> ndarray:
    return np.asarray(kawabata) * _MICRO * GF_CM2_PER_CM


def _round_numbers(low: float, high: float) -> list[float]:
    decades = range(floor(log10(low)), ceil(log10(high)) + 1)
    for steps in ((1, 2, 5), (1, 3), (1,)):
        ticks = [step * 10.0**decade for decade in decades for step in steps if low <= step * 10.0**decade <= high]
        if len(ticks) <= _MOST_TICKS:
            break
    if len(ticks) < _FEWEST_TICKS:
        even = MaxNLocator(_MOST_TICKS, steps=(1, 2, 5, 10)).tick_values(low, high)
        return [float(tick) for tick in even if low <= tick <= high]
    return ticks[:: ceil(len(ticks) / _MOST_TICKS)]


def _plain(value: float) -> str:
    text = f"{value:.10f}".rstrip("0").rstrip(".")
    return text.replace("0.", ".", 1) if value < 1 else text
