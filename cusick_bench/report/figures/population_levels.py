"""Simulated samples beside real ones, by what differs between them, as a picture: a row for each fabric and face."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

_COLUMNS = {
    "dc": ("drape coefficient ± sd [points]", "dc_sd"),
    "folds": ("number of folds ± sd", "folds_sd"),
    "depth_mm": ("depth of folds, rms [mm]", None),
    "other_mse": ("MSE of two samples", None),
    "repeat_mse": ("MSE of repeats", None),
    "flip_mse": ("MSE of the two faces", None),
    "dc_drift": ("change of the drape\ncoefficient in repeats [points]", None),
}
"""Column of a row, the words below its graph, and the column of its bars."""
_STYLES: dict[str, dict[str, Any]] = {
    "samples": {"marker": "o", "color": "black"},
    "simulated": {"marker": "s", "color": "tab:blue", "markerfacecolor": "none"},
}
_APART = 0.15  # of real and simulated samples about the line of their fabric, in rows
_WIDTH, _ROW, _WORDS = 15.0, 0.34, 1.6  # [inch]

Row = Mapping[str, str | float]


def population_levels_figure(title: str, rows: Sequence[Row]) -> Figure:
    """Draws how samples of a fabric differ, and how simulated ones do, white behind.

    Args:
        title: Line above.
        rows: From `compare_levels`.

    Returns:
        The figure.
    """
    fabrics = list(dict.fromkeys((str(row["fabric"]), str(row["turned"])) for row in rows))
    figure = Figure(figsize=(_WIDTH, _ROW * len(fabrics) + _WORDS), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    axes = np.atleast_1d(figure.subplots(1, len(_COLUMNS), sharey=True))
    for axis, (name, (label, spread)) in zip(axes, _COLUMNS.items(), strict=True):
        for of in _STYLES:
            _draw(axis, fabrics, [row for row in rows if row["of"] == of], of, name, spread)
        axis.set_xlabel(label, fontsize=8)
        axis.tick_params(axis="x", labelsize=8)
        axis.grid(visible=True, alpha=0.2)
    faces = {"False": "", "True": ", turned"}
    axes[0].set_yticks(range(len(fabrics)), [fabric + faces[turned] for fabric, turned in fabrics], fontsize=8)
    axes[0].invert_yaxis()
    axes[0].legend(fontsize=8, frameon=False)
    figure.suptitle(title, fontsize=11)
    return figure


def save_population_levels(path: Path, title: str, rows: Sequence[Row]) -> None:
    """Writes how samples of a fabric differ, and how simulated ones do, as PNG.

    Args:
        path: File to write.
        title: Line above.
        rows: From `compare_levels`.
    """
    population_levels_figure(title, rows).savefig(path, format="png")


def _draw(
    axis: Axes, fabrics: Sequence[tuple[str, str]], rows: Sequence[Row], of: str, name: str, spread: str | None
) -> None:
    """One column of the samples, or of the simulated ones."""
    side = -_APART if of == "samples" else _APART
    axis.errorbar(
        [float(row[name]) for row in rows],
        [fabrics.index((str(row["fabric"]), str(row["turned"]))) + side for row in rows],
        xerr=None if spread is None else [float(row[spread]) for row in rows],
        label=of, linestyle="none", markersize=5, elinewidth=1.0, capsize=2, **_STYLES[of],
    )  # fmt: skip
