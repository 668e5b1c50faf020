"""Graphs that compare methods: anytime curves and performance profiles, a colour, dash and mark for each method."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor, inf, log10
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator
from numpy import ndarray

from cusick_bench.leaderboard.anytime import Curve
from cusick_bench.leaderboard.performance import PerformanceProfile
from cusick_bench.report.drawing.inline_svg import page_figure, panel
from cusick_bench.report.drawing.palette import CARD, DASHES, MARKS, SERIES

COST_TITLES = {"forward_equivalents": "cost [drapes]", "wall_seconds": "wall time [s]"}
_WIDTH, _HEIGHT = 560.0, 300.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 52.0, 14.0, 10.0, 42.0  # room around the axes [px]
MOST_RANGES = 4
"""Methods whose ranges can be told apart."""
_MARK_SIZE, _MARK_SPACING = 6.5, 0.12  # [px]; share of the axes' diagonal from mark to mark of a line
_LARGEST_FACTOR = 100.0  # shown of a performance profile
_LOG_STEPS = (1, 2, 5)


@dataclass(frozen=True)
class MethodStyle:
    """How a method's lines are drawn; no two of 144 methods are drawn alike.

    Attributes:
        colour: Number of its colour in `SERIES`.
        dash: Number of its dash in `DASHES`.
        mark: Number of its mark in `MARKS`.
    """

    colour: int
    dash: int
    mark: int


def method_style(place: int) -> MethodStyle:
    """Style of a method's lines.

    Args:
        place: Number of the method, from 0.

    Returns:
        Colours and dashes in turn; once all their pairs are used, again with the next mark.
    """
    return MethodStyle(place % len(SERIES), place % len(DASHES), place // (len(SERIES) * len(DASHES)) % len(MARKS))


def anytime_graph(curves: Sequence[Curve], cost: str, places: Mapping[str, int]) -> Figure:
    """Best training loss over cost, mean and range of each method's cells.

    Args:
        curves: Curves over that cost; at least one.
        cost: Name of the cost, one of `anytime.COSTS`.
        places: Number of each method, which says its style.

    Returns:
        The figure.
    """
    figure, axes = _graph()
    for curve in (one.until_end for one in curves):
        shown = np.isfinite(curve.loss) & (curve.low > 0)
        spent, style = curve.cost[shown], _style(places[curve.label])
        axes.step(spent, curve.loss[shown], where="post", linewidth=2, **style)
        if len(curves) <= MOST_RANGES:
            axes.fill_between(
                spent, curve.low[shown], curve.high[shown], step="post", color=style["color"], alpha=0.12, linewidth=0
            )
    axes.set(xscale="log", yscale="log", xlabel=COST_TITLES[cost], ylabel="best training loss (MSE)")
    _log_ticks(axes)
    return figure


def performance_graph(profiles: Sequence[PerformanceProfile], quantity: str, places: Mapping[str, int]) -> Figure:
    """Share of problems on which each method is within a factor of the best one, over that factor.

    Args:
        profiles: Profiles of the methods; at least one.
        quantity: What the factor is of, such as "test error".
        places: Number of each method, which says its style.

    Returns:
        The figure.
    """
    figure, axes = _graph()
    worst = max([float(one.ratios[one.ratios < inf].max(initial=1.0)) for one in profiles])
    limit = min(max(worst * 1.1, 2.0), _LARGEST_FACTOR)
    for one in profiles:
        factors, shares = _staircase(one, limit)
        axes.step(factors, 100 * shares, where="post", linewidth=2, clip_on=False, **_style(places[one.label]))
    axes.set(xscale="log", xlim=(1, limit), ylim=(0, 100), ylabel="problems [%]")
    axes.set_xlabel(f"{quantity}, as a multiple of the best method's")
    axes.set_yticks([0, 25, 50, 75, 100])
    ticks = [step * 10.0**decade for decade in (0, 1, 2) for step in (1, 1.2, 1.5, 2, 3, 5) if limit > 2.5 or step < 5]
    shown = [tick for tick in ticks if tick <= limit and (limit < 5 or tick >= 2 or tick == 1)]
    axes.set_xticks(shown, [f"{tick:g}" for tick in shown])
    axes.minorticks_off()
    return figure


def _graph() -> tuple[Figure, Axes]:
    figure = page_figure(_WIDTH, _HEIGHT)
    return figure, panel(figure, _LEFT, _TOP, _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM)


def _style(place: int) -> dict[str, Any]:
    style = method_style(place)
    line = {"color": SERIES[style.colour], "linestyle": DASHES[style.dash]}
    if not MARKS[style.mark]:
        return line
    mark = {"marker": MARKS[style.mark], "markevery": _MARK_SPACING, "markersize": _MARK_SIZE}
    return line | mark | {"markerfacecolor": CARD, "markeredgewidth": 1.5}


def _staircase(profile: PerformanceProfile, limit: float) -> tuple[Float[ndarray, " steps"], Float[ndarray, " steps"]]:
    factors = np.unique(np.concatenate([[1.0], profile.ratios[profile.ratios < limit], [limit]]))
    return factors, np.array([profile.share(factor) for factor in factors])


def _log_ticks(axes: Axes) -> None:
    """Ticks at 1, 2 and 5 of a decade, at powers of ten where that would be many, in plain numbers."""
    for axis, limits in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        decades = ceil(log10(limits[1])) - floor(log10(limits[0]))
        axis.set_major_locator(LogLocator(subs=_LOG_STEPS if decades <= 3 else (1,)))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
