"""Figures of a page that compare methods: anytime curves and performance profiles, with one key for all of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from cusick_bench.leaderboard import Cells, Leaderboard
from cusick_bench.leaderboard.anytime import COSTS, Curve, curves
from cusick_bench.leaderboard.cells.variants import BOARD, of_boards
from cusick_bench.leaderboard.order import direction, is_cost
from cusick_bench.leaderboard.performance import NEAR, PerformanceProfile, cost_profiles, error_profiles
from cusick_bench.report.drawing.inline_svg import inline_svg
from cusick_bench.report.drawing.method_graphs import (
    COST_TITLES,
    MOST_RANGES,
    anytime_graph,
    method_style,
    performance_graph,
)

_DASH_NAMES = ("solid", "dashed", "dotted")  # of the key, in the order of `DASHES`
_MARK_LETTERS = ("", "○", "□", "△", "◇", "▽")  # of the key, in the order of `MARKS`


@dataclass(frozen=True)
class MethodKey:
    """How a method is drawn.

    Attributes:
        label: Its name.
        colour: Number of its colour in the style sheet.
        dash: "solid", "dashed" or "dotted".
        mark: The mark along its lines, "" without one.
    """

    label: str
    colour: int
    dash: str
    mark: str


@dataclass(frozen=True)
class MethodFigure:
    """A figure.

    Attributes:
        graph: Its SVG element.
        caption: What it shows.
    """

    graph: Markup
    caption: str


@dataclass(frozen=True)
class MethodCurves:
    """Figures that compare methods on one data set.

    Attributes:
        key: The methods.
        anytime: Anytime curves, one a cost.
        profiles: Performance profiles.
        has_ranges: Whether anytime curves show the range over cells.
        of: What sets their cells apart from those of other leaderboards of the page; "" where there are none.
    """

    key: list[MethodKey]
    anytime: list[MethodFigure]
    profiles: list[MethodFigure]
    has_ranges: bool = False
    of: str = ""


def method_curves(cells: Cells, board: Leaderboard) -> MethodCurves | None:
    """The figures of the cells of a leaderboard.

    Args:
        cells: Cells of the results folder.
        board: The leaderboard.

    Returns:
        The content of the section; None where no method has a trace, and no two can be compared.
    """
    same = (cells.table["dataset_hash"] == board.dataset_hash) & (cells.table["protocol"] == board.protocol)
    table, skipped = cells.table.loc[same], cells.skipped
    by_cost = {cost: _drawable(curves(table, cost)) for cost in COSTS}
    smaller_is_better = direction(board.by) == direction("test_mse")
    errors = error_profiles(table, board.by, skipped=skipped) if smaller_is_better else []
    costs = cost_profiles(table, skipped=skipped)
    labels = [curve.label for found in by_cost.values() for curve in found]
    labels = list(dict.fromkeys([*labels, *(one.label for one in (*errors, *costs))]))
    if not labels:
        return None
    places = {label: place for place, label in enumerate(labels)}
    anytime = [
        MethodFigure(inline_svg(anytime_graph(found, cost, places), _curves_in_words(found, cost)), COST_TITLES[cost])
        for cost, found in by_cost.items()
        if found
    ]
    profiles = [
        MethodFigure(
            inline_svg(performance_graph(found, quantity, places), _profiles_in_words(found)),
            f"{caption}; problems that count: {len(found[0].ratios)}",
        )
        for found, quantity, caption in (
            (errors, board.by, f"Cost ({board.by})" if is_cost(board.by) else f"Error that is left ({board.by})"),
            (costs, "cost", f"Cost of coming within {NEAR:.0%} of the lowest training loss of any method"),
        )
        if found
    ]
    has_ranges = any(0 < len(found) <= MOST_RANGES for found in by_cost.values())
    key = [_key(label, place) for label, place in places.items()]
    return MethodCurves(key, anytime, profiles, has_ranges, _of(cells, board))


def _of(cells: Cells, board: Leaderboard) -> str:
    own = tuple(getattr(board, name) for name in BOARD)
    words = {tuple(table[BOARD].iloc[0]): apart for apart, table in of_boards(cells.table)}
    return words.get(own, "").removeprefix(", ")


def _key(label: str, place: int) -> MethodKey:
    style = method_style(place)
    return MethodKey(label, style.colour, _DASH_NAMES[style.dash], _MARK_LETTERS[style.mark])


def _drawable(found: Sequence[Curve]) -> list[Curve]:
    """Curves with two points and more that a logarithmic scale can show."""
    return [curve for curve in found if np.count_nonzero(curve.until_end.loss > 0) > 1]


def _curves_in_words(found: Sequence[Curve], cost: str) -> str:
    unit = COSTS[cost]
    ends = "; ".join(f"{one.label} {one.loss[-1]:.4f} after {one.end:.3g} {unit}" for one in found)
    return f"Mean best training loss over {unit}; at the end: {ends}"


def _profiles_in_words(found: Sequence[PerformanceProfile]) -> str:
    shares = "; ".join(f"{one.label} {one.share(1):.0%} and {one.share(2):.0%}" for one in found)
    return f"Share of problems on which each method is the best, and within a factor of 2 of the best: {shares}"
