"""Statistics that say what a cloth's drapes are like: free of the folds' phase, and locked to the cloth's frame.

Where folds lie changes from sample to sample, how many there are and how deep they are does not. The phase-free
statistics of a radius profile r(theta) are its drape coefficient, mean, quantiles, the amplitudes c_m of
c_m cos(m theta - phase_m), its skewness and its number of folds. The locked ones are a_m = c_m cos(phase_m) and
b_m = c_m sin(phase_m) of the low harmonics, in which warp and weft show (m = 2, 4), and an off-centre cloth (m = 1).

Distances between vectors of such statistics need a unit for each. `SCALES` are constants, since a scale taken from
the samples under test would make a score improper: the standard deviation between samples of one cloth, face up,
pooled over the fabrics 1, 2, 3, 4, 5 and 9 of the public release (root of the mean variance over the samples'
first captures), rounded to two digits.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from cusick_bench.datasets.profile import Profile, fold_count
from cusick_bench.metrics.errors import MetricError
from cusick_bench.metrics.shape import Shape

MODES = 12  # amplitudes; drapes have 4 to 14 folds, and half of that from sample to sample is noise above
QUANTILES = (5, 10, 25, 50, 75, 90, 95)  # [per cent]
LOCKED_MODES = (1, 2, 4)
_SOFTENING = 5e-4  # [m], a third of a pixel: the skewness of flatter profiles, which is noise, goes to 0

PHASE_FREE = (
    "dc",
    "radius_mean_m",
    *(f"radius_q{level:02d}_m" for level in QUANTILES),
    *(f"amplitude_{mode:02d}_m" for mode in range(1, MODES + 1)),
    "skewness",
    "folds",
)
LOCKED = tuple(f"{part}_{mode:02d}_m" for mode in LOCKED_MODES for part in ("locked_cos", "locked_sin"))
STATISTICS = PHASE_FREE + LOCKED
"""Names of the statistics, in the order of the vectors; lengths in metres, angles from +x (warp)."""

SCALES = {
    "dc": 0.033,
    "radius_mean_m": 0.0019,
    "radius_q05_m": 0.0033,
    "radius_q10_m": 0.0031,
    "radius_q25_m": 0.0026,
    "radius_q50_m": 0.0021,
    "radius_q75_m": 0.0014,
    "radius_q90_m": 0.0014,
    "radius_q95_m": 0.0015,
    "amplitude_01_m": 0.0013,
    "amplitude_02_m": 0.0011,
    "amplitude_03_m": 0.0012,
    "amplitude_04_m": 0.0010,
    "amplitude_05_m": 0.0018,
    "amplitude_06_m": 0.0019,
    "amplitude_07_m": 0.0021,
    "amplitude_08_m": 0.0021,
    "amplitude_09_m": 0.0015,
    "amplitude_10_m": 0.0012,
    "amplitude_11_m": 0.0011,
    "amplitude_12_m": 0.00068,
    "skewness": 0.18,
    "folds": 0.78,
    "locked_cos_01_m": 0.0013,
    "locked_sin_01_m": 0.0013,
    "locked_cos_02_m": 0.0011,
    "locked_sin_02_m": 0.0013,
    "locked_cos_04_m": 0.0017,
    "locked_sin_04_m": 0.0019,
}
"""Spread of each statistic between samples of one cloth."""


def drape_statistics(drapes: Sequence[Shape]) -> Float[ndarray, "drapes statistics"]:
    """Statistics of drapes, in the order of `STATISTICS`.

    Args:
        drapes: The drapes; profiles that they have already measured are used again.
    """
    radii = np.stack([drape.profile.radii for drape in drapes]) if drapes else np.zeros((0, 720))
    return profile_statistics(radii, np.array([drape.drape_coefficient for drape in drapes]))


def image_statistics(
    images: Float[ndarray, "images height width"] | UInt8[ndarray, "images height width"],
) -> Float[ndarray, "images statistics"]:
    """Statistics of silhouettes (cloth = 1, or 255 in bytes), in the order of `STATISTICS`."""
    full = 255 if images.dtype == np.uint8 else 1
    return drape_statistics([Shape(image / full) for image in images])


def profile_statistics(
    radii: Float[ndarray, "drapes angles"], coefficients: Float[ndarray, " drapes"]
) -> Float[ndarray, "drapes statistics"]:
    """Statistics of radius profiles, in the order of `STATISTICS`.

    Args:
        radii: Radii at equidistant angles over the full turn, counter-clockwise from +x [m].
        coefficients: Drape coefficients of the same drapes.

    Raises:
        MetricError: Shapes that do not fit, or values that are not finite.
    """
    if radii.ndim != 2 or coefficients.shape != radii.shape[:1]:
        raise MetricError(
            f"statistics need profiles (N, angles) and N drape coefficients, got {radii.shape}, {coefficients.shape}"
        )
    if not (np.isfinite(radii).all() and np.isfinite(coefficients).all()):
        raise MetricError("a profile holds radii that are not finite; its silhouette is empty or damaged")
    mean = radii.mean(1)
    harmonics = 2 * np.fft.rfft(radii, axis=1)[:, : MODES + 1] / radii.shape[1]
    locked = harmonics[:, LOCKED_MODES].conj()  # r = sum_m a_m cos(m theta) + b_m sin(m theta): a_m + i b_m
    columns = [
        coefficients[:, None],
        mean[:, None],
        np.percentile(radii, QUANTILES, axis=1).T,
        np.abs(harmonics[:, 1:]),
        _skewness(radii - mean[:, None])[:, None],
        np.array([[float(fold_count(Profile(row)))] for row in radii]).reshape(-1, 1),
        np.stack([locked.real, locked.imag], axis=-1).reshape(len(radii), -1),
    ]
    return np.concatenate(columns, axis=1)


def standardised(
    statistics: Float[ndarray, "drapes statistics"], names: Sequence[str] = STATISTICS
) -> Float[ndarray, "drapes chosen"]:
    """Chosen columns of statistics, in units of `SCALES`.

    Args:
        statistics: From `drape_statistics`.
        names: Which of `STATISTICS`.
    """
    chosen = [STATISTICS.index(name) for name in names]
    return statistics[:, chosen] / np.array([SCALES[name] for name in names])


def _skewness(deviation: Float[ndarray, "drapes angles"]) -> Float[ndarray, " drapes"]:
    """Third standardised moment: negative where narrow valleys part broad lobes."""
    return (deviation**3).mean(1) / ((deviation**2).mean(1) + _SOFTENING**2) ** 1.5
