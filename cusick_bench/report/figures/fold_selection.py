"""What decides the folds, as a picture: cloths over the drape coefficient, and factors level by level.

Above: one line a laid wave length, along which the cloth gets stiffer; crosses are real cloths. Below: one row a level,
mean ± standard error; the shaded strip is the base with its standard error.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, FigureBase

from cusick_bench.benchmark.fold_selection.real_cloth import PUBLISHED, ClothRow
from cusick_bench.benchmark.fold_selection.study import FoldRow

_LABELS = {
    "folds": "number of folds",
    "fold_depth_mm": "depth of folds, rms [mm]",
    "fold_skewness": "skewness (> 0: narrow crests)",
}
_SPREAD = ("drape_coefficient_sd", "sd of drape coefficient")
_CURVES = "stiffness"  # the factor whose rows make the upper graphs
_WIDTH, _UPPER, _ROW = 13.0, 3.6, 0.21  # [inch]


def fold_selection_figure(title: str, rows: Sequence[FoldRow], cloths: Sequence[ClothRow] = ()) -> Figure:
    """Draws a study of fold selection, white behind.

    Args:
        title: Line above.
        rows: Levels of factors.
        cloths: Measured real cloths; without them the published numbers of the paper's five are shown.

    Returns:
        The figure.
    """
    curves = [row for row in rows if row.factor == _CURVES]
    others = [row for row in rows if row.factor != _CURVES]
    heights = [_UPPER * bool(curves), (_ROW * (len(others) + len({row.factor for row in others})) + 0.9) * bool(others)]
    figure = Figure(figsize=(_WIDTH, sum(heights) + 0.5), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    shown = [height for height in heights if height > 0]
    parts = list(figure.subfigures(len(shown), 1, squeeze=False, height_ratios=shown)[:, 0])
    if curves:
        _draw_curves(parts.pop(0), curves, cloths)
    if others:
        _draw_levels(parts.pop(0), others)
    figure.suptitle(title, fontsize=11)
    return figure


def save_fold_selection(path: Path, title: str, rows: Sequence[FoldRow], cloths: Sequence[ClothRow] = ()) -> None:
    """Writes a study of fold selection as PNG.

    Args:
        path: File to write.
        title: Line above.
        rows: Levels of factors.
        cloths: Measured real cloths.
    """
    fold_selection_figure(title, rows, cloths).savefig(path, format="png")


def _draw_curves(figure: FigureBase, rows: Sequence[FoldRow], cloths: Sequence[ClothRow]) -> None:
    axes = np.atleast_1d(figure.subplots(1, len(_LABELS)))
    lengths = sorted({row.condition.laying_length for row in rows})
    for axis, name in zip(axes, _LABELS, strict=True):
        for place, length in enumerate(lengths):
            own = [row.responses for row in rows if row.condition.laying_length == length]
            axis.errorbar(
                [one.drape_coefficient for one in own], [getattr(one, name) for one in own],
                [one.error(name) for one in own], color=colormaps["viridis"](0.85 * place / max(len(lengths) - 1, 1)),
                marker="o", markersize=4, capsize=3, linewidth=1.4, label=f"laid wave length {1e3 * length:g} mm",
            )  # fmt: skip
        _draw_real(axis, name, cloths)
        axis.set(xlabel="drape coefficient", ylabel=_LABELS[name])
        axis.grid(visible=True, alpha=0.2)
    axes[0].legend(fontsize=8, frameon=False)


def _draw_real(axis: Axes, name: str, cloths: Sequence[ClothRow]) -> None:
    style = {"color": "tab:red", "linestyle": "none", "marker": "x", "markersize": 6, "elinewidth": 0.8}
    if cloths:
        found = [row.responses for row in cloths]
        axis.errorbar(
            [one.drape_coefficient for one in found], [getattr(one, name) for one in found],
            [one.error(name) for one in found], [one.error("drape_coefficient") for one in found],
            label="real cloths", **style,
        )  # fmt: skip
    elif name == "folds":
        coefficient, sd, folds = zip(*PUBLISHED.values(), strict=True)
        axis.errorbar(coefficient, folds, xerr=sd, label="the paper's five cloths", **style)


def _draw_levels(figure: FigureBase, rows: Sequence[FoldRow]) -> None:
    columns = {**_LABELS, _SPREAD[0]: _SPREAD[1]}
    axes = np.atleast_1d(figure.subplots(1, len(columns), sharey=True))
    places, ticks, place, before = [], [], 0.0, rows[0].factor
    for row in rows:
        place -= 2.0 if row.factor != before else 1.0
        before = row.factor
        places.append(place)
        ticks.append(f"{row.factor}: {row.label}")
    for axis, (name, label) in zip(axes, columns.items(), strict=True):
        base = _base(rows)
        if base is not None:
            middle, error = _value(base, name)
            axis.axvspan(middle - error, middle + error, color="0.88", linewidth=0)
        values = np.array([_value(row, name) for row in rows])
        factors = list(dict.fromkeys(row.factor for row in rows))
        for row, (value, error), height in zip(rows, values, places, strict=True):
            colour = colormaps["tab10"](factors.index(row.factor) % 10)
            axis.errorbar(value, height, xerr=error, color=colour, marker="o", markersize=4, capsize=2, linewidth=1.2)
        axis.set_xlabel(label)
        axis.grid(visible=True, axis="x", alpha=0.2)
    axes[0].set_yticks(places, ticks, fontsize=8)


def _base(rows: Sequence[FoldRow]) -> FoldRow | None:
    """The row whose condition stands in most factors."""
    conditions = [row.condition for row in rows]
    most = max(conditions, key=conditions.count)
    return next(row for row in rows if row.condition == most) if conditions.count(most) > 1 else None


def _value(row: FoldRow, name: str) -> tuple[float, float]:
    """A response and its standard error."""
    found = row.responses
    if name.endswith("_sd"):
        value = float(getattr(found, name))
        return value, value / float(np.sqrt(2 * max(found.drapes - 1, 1)))
    return float(getattr(found, name)), found.error(name)
