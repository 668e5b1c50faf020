"""Distances between radius-angle profiles: as they lie, at the best rotation, and free of phase.

A drape's folds appear at angles that differ from sample to sample (they depend on how the cloth was laid
down), so a distance that keeps the phase mostly measures chance. The phase-free distances compare properties
that samples of one cloth have in common.
"""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.metrics.errors import MetricError

_OVERSAMPLING = 8  # rotations tried per profile sample (0.0625 deg at 720 samples)
_MODES = 30  # highest harmonic of the amplitude spectrum, as in the fold count


def profile_rms(first: Float[ndarray, "..."], second: Float[ndarray, "..."]) -> float:
    """Root mean square difference of two radius profiles over the angle.

    Args:
        first: Radii at equidistant angles over the full turn [m].
        second: Radii at the same angles [m].

    Returns:
        The difference [m].

    Raises:
        MetricError: The profiles are empty, have different lengths, or hold values that are not finite.
    """
    _check(first, second)
    return float(np.sqrt(np.mean((first - second) ** 2)))


def profile_rms_rotated(first: Float[ndarray, "..."], second: Float[ndarray, "..."]) -> float:
    """Root mean square difference of two radius profiles at the rotation that makes it smallest [m].

    The differences at all rotations come from one circular correlation:
    sum (a - b_s)^2 = |a|^2 + |b|^2 - 2 (a * b)_s, whose spectrum is padded so that rotations between
    the samples are tried too. The padding counts the highest harmonic of an even number of radii twice; between
    silhouettes of the shipped set that changes the difference by less than 1e-4 of its value.

    Args:
        first: Radii at equidistant angles over the full turn [m].
        second: Radii at the same angles [m].

    Returns:
        The difference [m].

    Raises:
        MetricError: The profiles are empty, have different lengths, or hold values that are not finite.
    """
    _check(first, second)
    count = len(first)
    spectrum = np.fft.rfft(first - first.mean()) * np.conj(np.fft.rfft(second - second.mean()))
    correlation = np.fft.irfft(spectrum, count * _OVERSAMPLING) * _OVERSAMPLING / count
    squared = first.var() + second.var() + (first.mean() - second.mean()) ** 2 - 2 * correlation.max()
    return float(np.sqrt(max(squared, 0.0)))


def quantile_distance(first: Float[ndarray, "..."], second: Float[ndarray, "..."]) -> float:
    """Root mean square difference of the sorted radii [m]: the 2-Wasserstein distance of their distributions.

    Blind to the phase, the order and the number of folds; sees their depth and the drape coefficient.

    Args:
        first: Radii at equidistant angles over the full turn [m].
        second: Radii at the same angles [m].

    Returns:
        The distance [m].

    Raises:
        MetricError: The profiles are empty, have different lengths, or hold values that are not finite.
    """
    _check(first, second)
    return profile_rms(np.sort(first), np.sort(second))


def spectrum_distance(first: Float[ndarray, "..."], second: Float[ndarray, "..."]) -> float:
    """Smallest root mean square difference that two profiles with these amplitude spectra can have [m].

    With amplitudes A_m of the harmonics m = 1..30 it is sqrt(sum (A_m - B_m)^2 / 2): blind to the
    phases and to the mean radius, sees the number and the depth of the folds.

    Args:
        first: Radii at equidistant angles over the full turn [m].
        second: Radii at the same angles [m].

    Returns:
        The distance [m].

    Raises:
        MetricError: The profiles are empty, have different lengths, or hold values that are not finite.
    """
    _check(first, second)
    difference = np.abs(_harmonics(first)) - np.abs(_harmonics(second))
    return float(np.sqrt(np.sum(difference**2) / 2))


def _harmonics(radii: ndarray) -> ndarray:
    return 2 * np.fft.rfft(radii)[1 : _MODES + 1] / len(radii)


def _check(first: ndarray, second: ndarray) -> None:
    if first.shape != second.shape or first.ndim != 1:
        raise MetricError(f"profiles must be sampled at the same angles, got shapes {first.shape} and {second.shape}")
    if len(first) == 0:
        raise MetricError("a profile needs at least one radius, got none; give radii over the full turn")
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        raise MetricError("a profile holds radii that are not finite; its silhouette is empty or damaged")
