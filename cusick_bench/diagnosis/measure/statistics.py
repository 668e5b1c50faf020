"""Statistics of silhouettes for a diagnosis: one vector a capture, and its contrasts between faces and captures.

With r(theta) = c_0 + sum_m Re(c_m exp(-i m theta)) a radius profile, c_m = a_m + i b_m, and f its folds, m >= 4:

    phase-free   mean radius, area, quantiles of the radii about their mean, |c_3| ... |c_12|, the finer rest,
                 number of folds (counted; and the mean order of |c_m|, which is continuous), their depth and slope,
                 skewness
    locked       c_1 ... c_4, and the harmonics e_k = 2 mean(f^2 exp(i k theta)) / mean(f^2) of the folds' envelope,
                 which say at which angles of the cloth folds are deep, whatever their phase

Where folds come to lie is chance, so the phase of a high harmonic says nothing; but a cloth that is stiffer along its
warp, laid off centre or weakened at one place shows in the locked ones, averaged over samples.

A turn of the cloth by phi multiplies c_m by exp(i m phi); a mirror image theta -> pi - theta (the cloth turned over
about y) makes it (-1)^m conj(c_m). The phase-free statistics don't change.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float, Int
from numpy import ndarray

from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.captures import SIDES, Captures
from cusick_bench.sim.cloth.folds import ring_folds

_QUANTILES = (5, 25, 50, 75, 95)  # [per cent]
_AMPLITUDES = range(3, 13)
_FINE = range(13, 25)
_CENTROID = range(3, 17)
_LAST_MODE = 24  # above lie pixels
_FIRST_ENVELOPE_MODE = 4  # a cloth's shape in m = 1 to 3 would beat with its own folds
_HARMONICS = (1, 2, 3, 4)
_ENVELOPES = (1, 2, 4)
_SOFTENING = 5e-4  # [m], a third of a pixel: ratios of what is shallower, which is noise, go to 0

PHASE_FREE = (
    "mean_radius",
    "area_dc",
    *(f"quantile_{level:02d}" for level in _QUANTILES),
    *(f"amplitude_{mode}" for mode in _AMPLITUDES),
    "amplitude_high",
    "folds",
    "fold_centroid",
    "fold_depth",
    "roughness",
    "skewness",
)
_LOCKED = (*(("harmonic", mode) for mode in _HARMONICS), *(("envelope", mode) for mode in _ENVELOPES))
LOCKED = tuple(f"{what}_{mode}_{part}" for what, mode in _LOCKED for part in ("real", "imaginary"))
NAMES = PHASE_FREE + LOCKED
"""Names of the statistics in the order of the vectors; lengths in metres, roughness in metres per radian."""

LOCKED_PAIRS = tuple((len(PHASE_FREE) + 2 * i, len(PHASE_FREE) + 2 * i + 1) for i in range(len(_LOCKED)))
"""Columns of the real and imaginary part of each locked statistic."""
LOCKED_ORDERS = tuple(mode for _, mode in _LOCKED)
"""Order m of each of `LOCKED_PAIRS`."""

FREE = tuple(range(len(PHASE_FREE)))
REAL = tuple(real for real, _ in LOCKED_PAIRS)
EVEN = tuple(real for real, order in zip(REAL, LOCKED_ORDERS, strict=True) if order % 2 == 0)
"""Columns: phase-free; real parts, which are symmetric about +x; those of them that are so about both axes."""


def columns(*names: str) -> tuple[int, ...]:
    """Columns of the statistics with these names."""
    return tuple(NAMES.index(name) for name in names)


GROUPS: Mapping[str, tuple[int, ...]] = {
    "size": columns("mean_radius", "area_dc"),
    "radii": columns(*(f"quantile_{level:02d}" for level in _QUANTILES), "skewness"),
    "depth": columns("fold_depth", "roughness", "amplitude_high"),
    "number": columns("folds", "fold_centroid"),
    "spectrum": columns(*(f"amplitude_{mode}" for mode in _AMPLITUDES)),
    "harmonics": columns(*(name for name in LOCKED if name.startswith("harmonic"))),
    "envelope": columns(*(name for name in LOCKED if name.startswith("envelope"))),
}
"""The statistics by what they describe."""

_RESOLUTION_OF = {"area_dc": 1e-3, "folds": 0.3, "fold_centroid": 0.05, "roughness": 1e-3, "skewness": 0.02}
RESOLUTION = np.array(
    [_RESOLUTION_OF.get(name, 0.02 if name.startswith("envelope") else 1e-4) for name in NAMES], dtype=np.float64
)
"""What images of 723 px/m resolve: above the errors of pixels (a tenth of this), below any spread of real drapes."""


def capture_statistics(
    radii: Float[ndarray, "captures angles"], protocol: Protocol | None = None
) -> Float[ndarray, "captures statistics"]:
    """Statistics of radius profiles, in the order of `NAMES`.

    Args:
        radii: At equidistant angles from 0, counter-clockwise; from the cloth's warp if the locked statistics are to
            be the cloth's [m].
        protocol: Gives the radii of cloth and plate; the public release's by default.

    Raises:
        DiagnosisError: Too few angles, or radii that are not finite.
    """
    if radii.ndim != 2 or radii.shape[1] < 4 * _LAST_MODE or not np.isfinite(radii).all():
        raise DiagnosisError(
            f"profiles must be finite, (captures, angles) with at least {4 * _LAST_MODE} angles, got {radii.shape}"
        )
    nominal = protocol or Protocol()
    count = radii.shape[1]
    transform = np.fft.rfft(radii, axis=1)
    harmonics = 2 * transform.conj() / count
    amplitudes = np.abs(harmonics)
    mean = radii.mean(1)
    inner, outer = nominal.plate_radius_m**2, nominal.cloth_radius_m**2
    deviation = radii - mean[:, None]
    free = [
        mean,
        ((radii**2).mean(1) - inner) / (outer - inner),
        *np.percentile(deviation, _QUANTILES, axis=1),
        *amplitudes[:, list(_AMPLITUDES)].T,
        _norm(amplitudes[:, list(_FINE)]),
        _folds(radii),
        _centroid(amplitudes),
        *_depth_and_slope(amplitudes),
        (deviation**3).mean(1) / ((deviation**2).mean(1) + _SOFTENING**2) ** 1.5,
    ]
    locked = np.concatenate([harmonics[:, list(_HARMONICS)], _envelope(transform, count)], axis=1)
    parts = np.stack([np.real(locked), np.imag(locked)], axis=2).reshape(len(radii), -1)
    return np.concatenate([np.stack(free, axis=1), parts], axis=1)


def _norm(amplitudes: Float[ndarray, "captures modes"]) -> Float[ndarray, " captures"]:
    return np.sqrt((amplitudes**2).sum(1))


def _folds(radii: Float[ndarray, "captures angles"]) -> Float[ndarray, " captures"]:
    counts = [ring_folds(ring) for ring in radii]
    return np.array(counts, dtype=np.float64)


def _centroid(amplitudes: Float[ndarray, "captures modes"]) -> Float[ndarray, " captures"]:
    """Mean order of the amplitudes of the folds; goes to the middle order where there are none."""
    orders = np.array(_CENTROID, dtype=np.float64)
    weights = amplitudes[:, list(_CENTROID)] + _SOFTENING / len(orders)
    return (weights @ orders) / weights.sum(1)


def _depth_and_slope(amplitudes: Float[ndarray, "captures modes"]) -> tuple[ndarray, ndarray]:
    """Root mean squares of the folds [m] and of their derivative by the angle [m/rad]."""
    orders = np.arange(_CENTROID[0], _LAST_MODE + 1)
    folds = amplitudes[:, orders]
    return _norm(folds) / np.sqrt(2), _norm(folds * orders) / np.sqrt(2)


def _envelope(transform: Complex[ndarray, "captures modes"], count: int) -> Complex[ndarray, "captures envelopes"]:
    """Harmonics of the squared folds over their mean."""
    kept = transform.copy()
    kept[:, :_FIRST_ENVELOPE_MODE] = 0
    kept[:, _LAST_MODE + 1 :] = 0
    squared = np.fft.rfft(np.fft.irfft(kept, count, axis=1) ** 2, axis=1).conj() / count
    return 2 * squared[:, list(_ENVELOPES)] / (np.real(squared[:, :1]) + _SOFTENING**2)


def rotated(
    statistics: Float[ndarray, "*rows statistics"], angle: float | Float[ndarray, "*rows"]
) -> Float[ndarray, "*rows statistics"]:
    """Statistics of the same drapes turned counter-clockwise.

    Args:
        statistics: In the order of `NAMES`.
        angle: Of the turn [rad]; one for all or one a row.
    """
    return _map_locked(statistics, lambda value, order: value * np.exp(1j * order * np.asarray(angle)))


def mirrored(statistics: Float[ndarray, "*rows statistics"]) -> Float[ndarray, "*rows statistics"]:
    """Statistics of the mirror images theta -> pi - theta of the same drapes."""
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
        count: How many captures that were.
        face_even, face_odd: (down + up)/2 and (down - up)/2 of a sample's faces; NaN where one is missing.
        order_odd: A specimen's last capture minus its first, averaged over the sample's faces; NaN without repeats.
    """

    samples: Int[ndarray, " samples"]
    mean: Float[ndarray, "samples sides statistics"]
    count: Int[ndarray, "samples sides"]
    face_even: Float[ndarray, "samples statistics"]
    face_odd: Float[ndarray, "samples statistics"]
    order_odd: Float[ndarray, "samples statistics"]

    @property
    def specimens(self) -> Float[ndarray, "specimens statistics"]:
        """Means of the specimens that there are, sample by sample."""
        return self.mean[self.count > 0]

    @property
    def specimen_sample(self) -> Int[ndarray, " specimens"]:
        """Sample of each of `specimens`: the cluster that it belongs to."""
        return np.broadcast_to(self.samples[:, None], self.count.shape)[self.count > 0]


def specimen_statistics(captures: Captures, frame: Literal["cloth", "camera"] = "cloth") -> SpecimenStatistics:
    """Statistics by sample and face, and their contrasts.

    Args:
        captures: Of one fabric.
        frame: To which the locked statistics refer. What belongs to the cloth repeats from face to face in the
            cloth's frame, what belongs to the camera or the plate in the camera's.
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
    return SpecimenStatistics(samples, mean, count, (down + up) / 2, (down - up) / 2, _mean_of_known(drift))


def _mean_of_known(values: Float[ndarray, "samples sides statistics"]) -> Float[ndarray, "samples statistics"]:
    known = np.all(np.isfinite(values), axis=2)
    total = np.where(known[..., None], values, 0.0).sum(1)
    number = np.sum(known, axis=1, keepdims=True)
    return np.where(number > 0, total / np.maximum(number, 1), np.nan)
