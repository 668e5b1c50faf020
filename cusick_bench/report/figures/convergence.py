"""Convergence as a picture: drape coefficient, folds and errors over the number of vertices.

Errors stand on logarithmic axes, where a line of slope -p/2 is an order of p in the spacing of vertices; a dashed line
shows the slope of order 2.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from cusick_bench.benchmark.convergence.linear_plate import LinearPlate
from cusick_bench.benchmark.convergence.mesh_dependence import MeshRow
from cusick_bench.benchmark.convergence.order import Limit, mesh_spacing
from cusick_bench.benchmark.convergence.reference import PlateComparison

_MOST_TICKS = 8
_FEW_DECADES = 3  # up to which 1, 2 and 5 are marked, beyond only powers of ten
_BELOW = 0.5  # share of the smallest error at which the line of order 2 ends


@dataclass(frozen=True)
class Series:
    """Values on meshes of several sizes.

    Attributes:
        label: Name in the legend.
        vertices: Mesh sizes.
        values: Values; NaN where there is none.
        errors: Half lengths of the error bars.
        level: What the values should tend to, drawn as a line across.
    """

    label: str
    vertices: Sequence[int]
    values: Sequence[float]
    errors: Sequence[float] | None = None
    level: float | None = None


@dataclass(frozen=True)
class Panel:
    """One graph over the number of vertices.

    Attributes:
        ylabel: Name and unit of the values.
        series: What it shows.
        logarithmic: Whether values are errors, on a logarithmic axis, with the slope of order 2.
    """

    ylabel: str
    series: Sequence[Series]
    logarithmic: bool = False


def mesh_panels(rows: Sequence[MeshRow], limit: Limit | None, plate: LinearPlate | None) -> list[Panel]:
    """Graphs of one cloth on several meshes.

    Args:
        rows: A row a mesh size.
        limit: Extrapolated drape coefficient, if there is one.
        plate: The linear plate, if it was simulated.

    Returns:
        Drape coefficient, number of folds, their depth, and errors.
    """
    sizes = [row.vertices for row in rows]
    level, name = (None, "drape coefficient") if limit is None else (limit.value, "drape coefficient (line: limit)")
    errors = []
    if plate is not None:
        errors.append(_plate_series(plate))
    if limit is not None:
        distance = [100 * abs(row.drape_coefficient - limit.value) for row in rows]
        errors.append(Series("drape coefficient, to its limit [points]", sizes, distance))
    panels = [
        Panel(
            name,
            [
                Series(
                    "mean ± standard error",
                    sizes,
                    [row.drape_coefficient for row in rows],
                    [row.drape_coefficient_se for row in rows],
                    level,
                )
            ],
        ),
        Panel("folds", [Series("folds", sizes, [row.folds for row in rows], [row.folds_se for row in rows])]),
        Panel(
            "depth of folds [mm]",
            [Series("depth", sizes, [row.fold_depth_mm for row in rows], [row.fold_depth_mm_se for row in rows])],
        ),
    ]
    return [*panels, Panel("error", errors, True)] if errors else panels


def reference_panels(comparisons: Sequence[PlateComparison]) -> list[Panel]:
    """Graphs of simulated reference drapes.

    Args:
        comparisons: Drapes on meshes of several sizes.

    Returns:
        Drape coefficient beside the reference's, depth of folds likewise, and the errors of the drape coefficient.
    """
    rows: dict[str, list[PlateComparison]] = {}
    for one in comparisons:
        label = f"{one.folds} folds, ln B {one.ln_bending:g}, nu {one.poisson:.2g}"
        rows.setdefault(label, []).append(one)
    coefficients, depths, errors = [], [], []
    for label, own in rows.items():
        sizes = [one.vertices for one in own]
        value = [_number(one.drape_coefficient) for one in own]
        error = [_number(one.error_points) for one in own]
        level = _first([v - e / 100 for v, e in zip(value, error, strict=True)])
        coefficients.append(Series(label, sizes, value, level=level))
        depth = [_number(one.rim_max_mm) - _number(one.rim_min_mm) for one in own]
        wrong = [_number(one.rim_max_error_mm) - _number(one.rim_min_error_mm) for one in own]
        if own[0].folds > 0:
            exact = _first([d - w for d, w in zip(depth, wrong, strict=True)])
            depths.append(Series(label, sizes, depth, level=exact))
        errors.append(Series(label, sizes, np.abs(error).tolist()))
    panels = [Panel("drape coefficient (line: reference)", coefficients), Panel("error [points]", errors, True)]
    if depths:
        panels.insert(1, Panel("largest minus least rim radius [mm]", depths))
    return panels


def convergence_figure(title: str, panels: Sequence[Panel]) -> Figure:
    """Draws graphs side by side, white behind.

    Args:
        title: Line above them.
        panels: The graphs; those with the same series share one legend.

    Returns:
        The figure.
    """
    figure = Figure(figsize=(4.2 * len(panels), 5.0), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = np.atleast_1d(figure.subplots(1, len(panels)))
    labels = list(dict.fromkeys(series.label for panel in panels for series in panel.series))
    shared = all(len(panel.series) > 2 for panel in panels)
    for axis, panel in zip(axes, panels, strict=True):
        for place, series in enumerate(panel.series):
            number = labels.index(series.label) if shared else place
            _draw(axis, series, colormaps["tab10"](number % 10))
        _finish(axis, panel)
        if not shared and (len(panel.series) > 1 or panel.logarithmic):  # a lone error is named nowhere else
            axis.legend(fontsize=8)
    if shared:
        handles = dict(zip(*reversed(axes[0].get_legend_handles_labels()), strict=True))
        figure.legend(handles.values(), handles, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    figure.suptitle(title, fontsize=11, parse_math=False)  # a file's name may hold a $
    return figure


def save_convergence(path: Path, title: str, panels: Sequence[Panel]) -> None:
    """Writes graphs side by side as PNG.

    Args:
        path: File to write.
        title: Line above them.
        panels: The graphs.
    """
    convergence_figure(title, panels).savefig(path, format="png")


def _draw(axis: Axes, series: Series, colour: object) -> None:
    axis.errorbar(
        series.vertices, series.values, series.errors, color=colour, marker="o", markersize=4, capsize=3,
        linewidth=1.4, label=series.label,
    )  # fmt: skip
    if series.level is not None:
        axis.axhline(series.level, color=colour, linewidth=0.8, linestyle=":")


def _finish(axis: Axes, panel: Panel) -> None:
    sizes = sorted({size for series in panel.series for size in series.vertices})
    axis.set(xscale="log", xlabel="vertices", ylabel=panel.ylabel)
    if panel.logarithmic:
        _logarithmic(axis, panel)
    shown = sizes[:: -(-len(sizes) // _MOST_TICKS)]
    axis.set_xticks(shown, [str(size) for size in shown])
    axis.xaxis.set_minor_locator(NullLocator())
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.grid(visible=True, alpha=0.2)


def _logarithmic(axis: Axes, panel: Panel) -> None:
    """Logarithmic errors, and below them the slope of order 2."""
    values = np.array([value for series in panel.series for value in series.values if value > 0])
    sizes = np.array(sorted({size for series in panel.series for size in series.vertices}))
    if len(values) == 0:
        return
    axis.set_yscale("log")
    decades = np.log10(values.max() / values.min())
    axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if decades < _FEW_DECADES else (1,)))
    axis.yaxis.set_major_formatter(FuncFormatter(lambda value, place: f"{value:g}"))
    axis.yaxis.set_minor_formatter(NullFormatter())
    if len(sizes) > 1:
        spacing = mesh_spacing(sizes)
        slope = (spacing / spacing[-1]) ** 2 * _BELOW * values.min()
        axis.plot(sizes, slope, color="0.4", linestyle="--", linewidth=1)
        axis.annotate("order 2", (sizes[0], slope[0]), fontsize=8, color="0.4", va="bottom")


def _plate_series(plate: LinearPlate) -> Series:
    """Root mean square error of the deflection over the meshes of each size."""
    sizes = sorted({row.vertices for row in plate.rows})
    errors = [[row.ratio - 1 for row in plate.rows if row.vertices == size] for size in sizes]
    return Series("linear plate, deflection [%]", sizes, [100 * float(np.sqrt(np.mean(np.square(e)))) for e in errors])


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def _first(values: Sequence[float]) -> float | None:
    return next((value for value in values if np.isfinite(value)), None)
