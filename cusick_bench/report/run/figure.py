"""The same pictures as a file: real, simulated, difference, drape in 3D and radius over angle, side by side."""

from pathlib import Path

from jaxtyping import Float, UInt8
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy import ndarray

from cusick_bench.report.cell_view import CellView
from cusick_bench.report.drawing.palette import SIMULATED_DASH
from cusick_bench.report.drawing.pictures import difference_picture, silhouette_picture
from cusick_bench.report.drawing.radius_over_angle import draw_range, draw_turn, label_axes

_REAL, _SIMULATED = "#c85a00", "#1c63b7"


def save_figure(
    path: Path,
    title: str,
    view: CellView,
    drape: UInt8[ndarray, "height width 4"],
    unseen: Float[ndarray, "samples angles"] | None,
) -> None:
    """Writes one cell's pictures side by side as PNG, white behind.

    Args:
        path: File to write.
        title: Line above them.
        view: The cell.
        drape: Its drape in 3D.
        unseen: Radii of unseen samples [m].
    """
    figure = Figure(figsize=(15, 3.3), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 5, width_ratios=[1, 1, 1, 1.5, 2])
    pictures = [
        silhouette_picture(view.target),
        silhouette_picture(view.fit),
        difference_picture(view.fit, view.target),
    ]
    fitted = "simulated" if view.simulated else "predicted"
    names = ["real", fitted, f"blue: only {fitted}, orange: only real"]
    for axis, picture, name in zip(axes, [*pictures, drape], [*names, "from the side"], strict=False):
        axis.imshow(picture)
        axis.set_title(name, fontsize=9)
        axis.set_axis_off()
    _draw_profiles(axes[4], view, unseen, fitted=fitted)
    figure.suptitle(title, fontsize=11, parse_math=False)  # a cloth's name may hold a $
    figure.savefig(path)


def _draw_profiles(axes: Axes, view: CellView, unseen: ndarray | None, *, fitted: str) -> None:
    """Radius over angle of the real and the fitted drape, and the range of unseen samples."""
    if unseen is not None and len(unseen) > 1:
        draw_range(axes, unseen, color=_REAL, alpha=0.15, label=f"{len(unseen)} unseen silhouettes")
    draw_turn(axes, view.target_profile.radii, color=_REAL, label="real")
    draw_turn(axes, view.fit_profile.radii, color=_SIMULATED, linestyle=SIMULATED_DASH, label=fitted)
    label_axes(axes)
    axes.legend(fontsize=8, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
