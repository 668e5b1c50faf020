"""The same pictures as a file: real, simulated, difference, drape in 3D and radius over angle, side by side."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy import ndarray

from cusick_bench.report.cell_view import CellView
from cusick_bench.report.drawing.pictures import difference_picture, silhouette_picture

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
    names = ["real", "simulated" if view.simulated else "predicted", "blue: only simulated, orange: only real"]
    for axis, picture, name in zip(axes, [*pictures, drape], [*names, "from the side"], strict=False):
        axis.imshow(picture)
        axis.set_title(name, fontsize=9)
        axis.set_axis_off()
    angle = np.linspace(0, 360, len(view.target_profile.radii) + 1)
    if unseen is not None and len(unseen) > 1:
        low, high = (1e3 * np.append(edge, edge[0]) for edge in (unseen.min(0), unseen.max(0)))
        axes[4].fill_between(
            angle, low, high, color=_REAL, alpha=0.15, linewidth=0, label=f"{len(unseen)} unseen samples"
        )
    for profile, colour, name in ((view.target_profile, _REAL, names[0]), (view.fit_profile, _SIMULATED, names[1])):
        axes[4].plot(angle, 1e3 * np.append(profile.radii, profile.radii[0]), color=colour, label=name)
    axes[4].set(xlabel="angle from warp [deg]", ylabel="radius [mm]", xlim=(0, 360), xticks=range(0, 361, 90))
    axes[4].legend(fontsize=8, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    figure.suptitle(title, fontsize=11)
    figure.savefig(path)
