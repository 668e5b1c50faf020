"""Anytime curves as a picture: best training loss over drapes, and over wall time."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from cusick_bench.leaderboard.anytime import Curve
from cusick_bench.report.drawing.method_graphs import COST_TITLES

_DASHES = ("-", "--", ":", "-.")
_MOST_RANGES = 8  # methods whose ranges can be told apart


def save_anytime(path: Path, title: str, panels: Mapping[str, Sequence[Curve]]) -> None:
    """Writes one panel a cost as PNG, white behind.

    Args:
        path: File to write.
        title: Line above the panels.
        panels: Curves by cost, `forward_equivalents` and `wall_seconds`.
    """
    figure = Figure(figsize=(13, 4.6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = np.atleast_1d(figure.subplots(1, len(panels), sharey=True))
    names = sorted({curve.label for curves in panels.values() for curve in curves})
    colours = [colormaps["tab10"](place % 10) for place in range(len(names))]
    dashes = cycle(dash for dash in _DASHES for _ in range(10))
    styles = {name: (colour, dash) for name, colour, dash in zip(names, colours, dashes, strict=False)}
    for axis, (cost, curves) in zip(axes, panels.items(), strict=True):
        for curve in (one.until_end for one in curves):
            colour, dash = styles[curve.label]
            axis.step(curve.cost, curve.loss, where="post", color=colour, linestyle=dash, label=curve.label)
            if len(curves) <= _MOST_RANGES:
                axis.fill_between(curve.cost, curve.low, curve.high, step="post", color=colour, alpha=0.1, linewidth=0)
        axis.set(xscale="log", yscale="log", xlabel=COST_TITLES[cost])
        axis.grid(visible=True, which="both", alpha=0.2)
    ranges = " and range" if max(map(len, panels.values())) <= _MOST_RANGES else ""
    axes[0].set_ylabel(f"best training MSE (mean{ranges} of cells)")
    legend = figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right center", fontsize=8, frameon=False)
    for text in legend.get_texts():
        text.set_parse_math(False)
    figure.suptitle(title, fontsize=11, parse_math=False)  # a data set's name may hold a $
    figure.savefig(path)
