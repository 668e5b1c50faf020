"""Data of one cell for the report: its prediction, which is checked when it is read, and the trace of the search."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.files.silhouette import profile_of
from cusick_bench.datasets.profile import Profile
from cusick_bench.leaderboard.anytime import steps_of
from cusick_bench.metrics import ruled_surface
from cusick_bench.metrics.stiffness import BENDING
from cusick_bench.report.prediction_file import check_mesh, read_prediction

_MAXIMUM_DRAWS = 6  # largest number of draws that are shown
_SHOWN_MODES = 40  # highest harmonic of a profile in its picture


@dataclass(frozen=True, eq=False)
class CellView:
    """One cell as it is shown.

    Attributes:
        fit: Simulated silhouette of the training sample.
        target: The real one.
        draws: The first few silhouettes offered for unseen samples, none where the only one is the fit.
        vertices: Drape behind `fit` [m], or the ruled surface over its silhouette.
        faces: Triangles of `vertices`.
        simulated: Whether `vertices` is a simulated drape.
        trace: Best loss after each evaluation from the first success on, as (forward-equivalents, loss).
        protocol: How the silhouettes are taken.
        bending_draws: Bending stiffness of draws from the posterior [N m], in the order of `BENDING`; None without one.
        bending: Bending stiffness that the tables of the elements (hinges or faces) mean [N m], in the order of the
            tables; None where all have one.
        both_faces: Whether every other draw lies with the other face up.
    """

    fit: Float[ndarray, "size size"]
    target: Float[ndarray, "size size"]
    draws: Float[ndarray, "draws size size"]
    vertices: Float[ndarray, "vertices 3"]
    faces: Int[ndarray, "faces 3"]
    simulated: bool
    trace: Float[ndarray, "evaluations 2"]
    protocol: Protocol = RELEASE
    bending_draws: Float[ndarray, "posterior_draws directions"] | None = None
    bending: Float[ndarray, "elements 3 5"] | None = None
    both_faces: bool = False

    @property
    def fit_profile(self) -> Profile:
        """Radius-angle profile of the fit."""
        return profile_of(self.fit, self.protocol)

    @property
    def target_profile(self) -> Profile:
        """Radius-angle profile of the real silhouette."""
        return profile_of(self.target, self.protocol)


def load_cell_view(folder: Path, protocol: Protocol = RELEASE, law: str = "paper") -> CellView:
    """Reads `prediction.npz` and `trace.jsonl` of a finished cell.

    Args:
        folder: The cell's folder.
        protocol: How the data's silhouettes were taken.
        law: Material law of the cell, which says what stiffness its tables mean.

    Returns:
        What is shown of the cell.

    Raises:
        ReportError: The prediction is missing, damaged or oversized; the message says which file.
    """
    steps = steps_of(folder, "forward_equivalents")
    trace = np.column_stack([steps.cost, steps.loss])[np.isfinite(steps.loss)]
    return read_prediction(folder, lambda arrays: _view(arrays, trace, protocol, law))


def shown_surface(
    profile: Profile, protocol: Protocol = RELEASE, *, every: int = 1, strips: int = 12
) -> trimesh.Trimesh:
    """The ruled surface over a profile, without the pleats that single pixels would make.

    Args:
        profile: Radius over angle.
        protocol: Gives radii of plate and cloth.
        every: Angles of the profile from generator to generator.
        strips: Strips of triangles from plate to rim.

    Returns:
        The surface [m].
    """
    harmonics = np.fft.rfft(profile.radii)
    harmonics[_SHOWN_MODES + 1 :] = 0
    radii, plate = np.fft.irfft(harmonics, len(profile.radii))[::every], protocol.plate_radius_m
    return ruled_surface(radii, slant=protocol.overhang_m, plate_radius=plate, strips=strips)


def _view(arrays: Mapping[str, ndarray], trace: ndarray, protocol: Protocol, law: str) -> CellView:
    fit, target = (np.asarray(arrays[name], dtype=np.float64) for name in ("train_image", "train_target"))
    if fit.shape != target.shape or fit.ndim != 2:
        raise ValueError(f"images have shapes {fit.shape} and {target.shape}")
    draws = np.asarray(arrays["draws"])
    shown = draws[:_MAXIMUM_DRAWS] / 255 if len(draws) > 1 else np.zeros((0, *fit.shape))
    simulated = "vertices" in arrays and "faces" in arrays
    if simulated:
        vertices, faces = np.asarray(arrays["vertices"], dtype=np.float64), np.asarray(arrays["faces"], dtype=np.int64)
        check_mesh(vertices, faces)
    else:
        surface = shown_surface(profile_of(fit, protocol), protocol)
        vertices, faces = np.asarray(surface.vertices), np.asarray(surface.faces)
    drawn, tables = _bending_draws(arrays), _bending(arrays, law) if simulated else None
    both_faces = "draw_turned" in arrays
    return CellView(fit, target, shown, vertices, faces, simulated, trace, protocol, drawn, tables, both_faces)


def _bending_draws(arrays: Mapping[str, ndarray]) -> ndarray | None:
    if "bending_draws" not in arrays:
        return None
    draws = np.asarray(arrays["bending_draws"], dtype=np.float64)
    shaped = draws.ndim == 2 and len(draws) > 1 and draws.shape[1] == len(BENDING)
    if not (shaped and np.isfinite(draws).all() and draws.min() > 0):
        raise ValueError("its draws of bending stiffness are damaged")
    return draws


def _bending(arrays: Mapping[str, ndarray], law: str) -> ndarray | None:
    """Stiffness by the tables of the elements, None where there are none of their own."""
    from cusick_bench.sim.cloth.material import PUBLISHED_BENDING_FACTOR

    if "bending" not in arrays or np.asarray(arrays["bending"]).ndim != 3:
        return None
    tables = np.asarray(arrays["bending"], dtype=np.float64)
    if not (np.isfinite(tables).all() and tables.min() > 0):
        raise ValueError("its tables of bending stiffness are damaged")
    return tables / PUBLISHED_BENDING_FACTOR if law == "published" else tables
