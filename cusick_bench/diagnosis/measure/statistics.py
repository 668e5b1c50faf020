"""Statistics of silhouettes for a diagnosis: one vector a capture, and its contrasts between faces and captures.

The vectors hold the selection `DIAGNOSED` of the vocabulary in `cusick_bench.datasets.silhouette_statistics`, where
each statistic is defined: phase-free ones, and complex ones c_m that are locked to the frame of the angles. The places
of folds are random, so the phase of a high harmonic is meaningless; but a cloth that is stiffer along its warp, laid
off centre or weakened at one place shows in the locked statistics, averaged over samples.

A turn of the cloth by phi multiplies c_m by exp(i m phi); a mirror image theta -> pi - theta (the cloth turned over
about y) makes it (-1)^m conj(c_m). The phase-free statistics don't change.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.silhouette_statistics.definitions import LAST_ORDER
from cusick_bench.datasets.silhouette_statistics.selections import DIAGNOSED
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.captures import SIDES, Captures

PHASE_FREE, LOCKED, NAMES = DIAGNOSED.phase_free, DIAGNOSED.locked, DIAGNOSED.names
"""Names of the statistics in the order of the vectors; lengths in metres, roughness in metres per radian."""

_REAL_PARTS = tuple(name for name in LOCKED if name.endswith("_real"))

LOCKED_PAIRS = tuple((NAMES.index(name), NAMES.index(name) + 1) for name in _REAL_PARTS)
"""Columns of the real and imaginary part of each locked statistic."""
LOCKED_ORDERS = tuple(int(name.split("_")[-2]) for name in _REAL_PARTS)
"""Order m of each of `LOCKED_PAIRS`."""

FREE = tuple(range(len(PHASE_FREE)))
REAL = tuple(real for real, _ in LOCKED_PAIRS)
EVEN = tuple(real for real, order in zip(REAL, LOCKED_ORDERS, strict=True) if order % 2 == 0)
"""Columns: phase-free; real parts, which are symmetric about +x; those of them that are so about both axes."""

columns = DIAGNOSED.columns
"""Columns of the statistics with these names."""

GROUPS: Mapping[str, tuple[int, ...]] = {
    "size": columns("mean_radius", "area_dc"),
    "radii": columns(*(name for name in NAMES if name.startswith("quantile")), "skewness"),
    "depth": columns("fold_depth", "roughness", "amplitude_high"),
    "number": columns("folds", "fold_centroid"),
    "spectrum": columns(*(name for name in NAMES if name.startswith("amplitude") and name != "amplitude_high")),
    "harmonics": columns(*(name for name in LOCKED if name.startswith("harmonic"))),
    "envelope": columns(*(name for name in LOCKED if name.startswith("envelope"))),
    "slopes": columns(*(name for name in LOCKED if name.startswith(("slope_envelope", "cubed")))),
    "asymmetry": columns("slope_skewness", "curvature_skewness", "valley_curvature"),
    "outline": columns("crest_radius", "crest_spread", "valley_gap", "plate_nearness"),
    "sides": columns(*(name for name in LOCKED if name.startswith(("crest", "valley", "nearness")))),
}
"""The statistics by what they describe."""

_RESOLUTION_OF = {
    "area_dc": 1e-3,
    "folds": 0.3,
    "fold_centroid": 0.05,
    "roughness": 1e-3,
    "skewness": 0.02,
    "plate_nearness": 0.005,
    "nearness": 0.005,
    "slope_skewness": 0.02,
    "curvature_skewness": 0.05,
    "valley_curvature": 0.02,
    "envelope": 0.02,
    "slope_envelope": 0.02,
    "cubed": 0.02,
}
"""By name, or by family of locked ones; lengths are not in it."""


def _resolution(name: str) -> float:
    family = name.rsplit("_", 2)[0] if name in LOCKED else name
    return _RESOLUTION_OF.get(family, 1e-4)


RESOLUTION = np.array([_resolution(name) for name in NAMES], dtype=np.float64)
"""Resolution of images of 723 px/m of a 30 cm cloth: ten times the errors of pixels, so that images with a third of the
pixels will do as well, and below any spread of real drapes. Lengths are those of that cloth, as in the atlas.
"""


def capture_statistics(
    radii: Float[ndarray, "captures angles"], protocol: Protocol | None = None
) -> Float[ndarray, "captures statistics"]:
    """Statistics of radius profiles.

    Args:
        radii: At equidistant angles from 0, counter-clockwise; from the cloth's warp if the locked statistics are to
            be the cloth's [m].
        protocol: Gives the radii of cloth and plate; the public release's by default.

    Returns:
        One row a capture, in the order of `NAMES`.

    Raises:
        DiagnosisError: Too few angles, or radii that are not finite.
    """
    if radii.ndim != 2 or radii.shape[1] < 4 * LAST_ORDER or not np.isfinite(radii).all():
        raise DiagnosisError(
            f"profiles must be finite, (captures, angles) with at least {4 * LAST_ORDER} angles, got {radii.shape}"
        )
    nominal = protocol or Protocol()
    return DIAGNOSED.measure(radii, cloth_radius=nominal.cloth_radius_m, plate_radius=nominal.plate_radius_m)


def rotated(
    statistics: Float[ndarray, "*rows statistics"], angle: float | Float[ndarray, "*#rows"]
) -> Float[ndarray, "*rows statistics"]:
    """Statistics of the same drapes turned counter-clockwise.

    Args:
        statistics: Statistics in the order of `NAMES`.
        angle: Angle of the turn [rad]; one for all or one a row.

    Returns:
        Statistics of the turned drapes.
    """
    return _map_locked(statistics, lambda value, order: value * np.exp(1j * order * np.asarray(angle)))


def mirrored(statistics: Float[ndarray, "*rows statistics"]) -> Float[ndarray, "*rows statistics"]:
    """Statistics of the mirror images theta -> pi - theta of the same drapes.

    Args:
        statistics: Statistics in the order of `NAMES`.

    Returns:
        Statistics of the mirror images.
    """
    return _map_locked(statistics, lambda value, order: (-1) ** order * value.conj())


def _map_locked(statistics: ndarray, change: Callable[[ndarray, int], ndarray]) -> ndarray:
    result = statistics.copy()
    for (real, imaginary), order in zip(LOCKED_PAIRS, LOCKED_ORDERS, strict=True):
        value = change(statistics[..., real] + 1j * statistics[..., imaginary], order)
        result[..., real], result[..., imaginary] = np.real(value), np.imag(value)
    return result


@dataclass(frozen=True, eq=False)
class SpecimenStatistics:
    """Statistics of a fabric by sample and face, a specimen being one face of one sample.

    Attributes:
        samples: Numbers of the samples, ascending.
        mean: Mean over each specimen's captures, faces in the order of `SIDES`; NaN where there is none.
        count: Number of these captures.
        face_odd: (down - up)/2 of a sample's faces; NaN where one is missing.
        order_odd: A specimen's last capture minus its first, averaged over the sample's faces; NaN without repeats.
    """

    samples: Int[ndarray, " samples"]
    mean: Float[ndarray, "samples sides statistics"]
    count: Int[ndarray, "samples sides"]
    face_odd: Float[ndarray, "samples statistics"]
    order_odd: Float[ndarray, "samples statistics"]


def specimen_statistics(captures: Captures, frame: Literal["cloth", "camera"] = "cloth") -> SpecimenStatistics:
    """Statistics by sample and face, and their contrasts.

    Args:
        captures: Captures of one fabric.
        frame: Frame to which the locked statistics refer. What belongs to the cloth repeats from face to face in the
            cloth's frame, what belongs to the camera or the plate in the camera's.

    Returns:
        Means and contrasts of every sample.
    """
    radii = captures.cloth_frame() if frame == "cloth" else captures.radii
    values = capture_statistics(radii, captures.protocol)
    samples, row = np.unique(captures.sample, return_inverse=True)
    mean = np.full((len(samples), len(SIDES), values.shape[1]), np.nan)
    drift, count = mean.copy(), np.zeros(mean.shape[:2], dtype=np.int64)
    for i in range(len(samples)):
        for j, side in enumerate(SIDES):
            own = np.flatnonzero(np.logical_and(row == i, captures.side == side))
            count[i, j] = len(own)
            if len(own):
                mean[i, j] = values[own].mean(0)
                own = own[np.argsort(captures.capture[own], kind="stable")]
            if len(own) > 1:
                drift[i, j] = values[own[-1]] - values[own[0]]
    up, down = mean[:, SIDES.index("up")], mean[:, SIDES.index("down")]
    return SpecimenStatistics(samples, mean, count, (down - up) / 2, _mean_of_known(drift))


def _mean_of_known(values: Float[ndarray, "samples sides statistics"]) -> Float[ndarray, "samples statistics"]:
    known = np.all(np.isfinite(values), axis=2)
    total = np.where(known[..., None], values, 0.0).sum(1)
    number = np.sum(known, axis=1, keepdims=True)
    return np.where(number > 0, total / np.maximum(number, 1), np.nan)
