"""Graph of two runs: each method's number in the other run and in this one, joined by a line."""

from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from cusick_bench.leaderboard.two_runs import MethodChange
from cusick_bench.report.drawing.inline_svg import page_figure, panel
from cusick_bench.report.drawing.palette import INK, MODEL, SOFT
from cusick_bench.report.drawing.row_names import row_names

_WIDTH, _LEFT, _RIGHT, _TOP, _BOTTOM, _ROW = 1000.0, 215.0, 20.0, 8.0, 42.0, 26.0  # [px]
_TITLES = {"test_mse": "MSE, unseen samples"}


def change_graph(methods: Sequence[MethodChange], name: str) -> Figure:
    """A row for each method: hollow in the other run, filled in this one.

    Args:
        methods: Methods that have the number in both runs; at least one.
        name: The number, one of `two_runs.COMPARED`.

    Returns:
        The figure.
    """
    figure = page_figure(_WIDTH, _TOP + _BOTTOM + _ROW * len(methods))
    axes = panel(figure, _LEFT, _TOP, _WIDTH - _LEFT - _RIGHT, _ROW * len(methods))
    for row, method in enumerate(methods):
        change = method.changes[name]
        axes.plot([change.before, change.after], [row, row], color=SOFT, linewidth=1.5, zorder=1)
        axes.plot([change.before], [row], "o", markersize=8, markerfacecolor="none", color=SOFT, markeredgewidth=1.8)
        axes.plot([change.after], [row], "o", markersize=8, color=MODEL)
    axes.set(ylim=(len(methods) - 0.5, -0.5), xlabel=_TITLES.get(name, name))
    axes.set_xlim(left=0)
    axes.set_yticks(range(len(methods)), row_names([method.label for method in methods]), parse_math=False)
    axes.tick_params(axis="y", labelcolor=INK)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=7))
    return figure
