"""Statistics by which draws and unseen samples are compared: the selection `SCORED` of silhouette statistics.

The phase-free ones say how much a cloth drapes, how many folds it has and how deep they are, which is similar for all
samples of a cloth; the locked ones, low harmonics in the cloth's frame, show warp and weft (m = 2, 4) and an off-centre
cloth (m = 1). Each is defined in `cusick_bench.datasets.silhouette_statistics`.

Distances between vectors of such statistics need a unit for each. `SCALES` are constants, since a scale taken from
the samples under test would make a score improper: the standard deviation between samples of one cloth, face up,
pooled over the fabrics 1, 2, 3, 4, 5 and 9 of the public release (root of the mean variance over the samples'
first captures), rounded to two digits. Lengths among them are in proportion to the cloth's radius.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.profile import PROFILE_ANGLES
from cusick_bench.datasets.silhouette_statistics.selections import SCORED
from cusick_bench.metrics.distances.shape import Shape
from cusick_bench.metrics.errors import MetricError

PHASE_FREE, LOCKED, STATISTICS = SCORED.phase_free, SCORED.locked, SCORED.names
"""Names of the statistics, in the order of the vectors; lengths in metres, angles from +x (warp)."""

SCALES = {
    "drape_coefficient": 0.033,
    "mean_radius": 0.0019,
    "radius_quantile_05": 0.0033,
    "radius_quantile_10": 0.0031,
    "radius_quantile_25": 0.0026,
    "radius_quantile_50": 0.0021,
    "radius_quantile_75": 0.0014,
    "radius_quantile_90": 0.0014,
    "radius_quantile_95": 0.0015,
    "amplitude_1": 0.0013,
    "amplitude_2": 0.0011,
    "amplitude_3": 0.0012,
    "amplitude_4": 0.0010,
    "amplitude_5": 0.0018,
    "amplitude_6": 0.0019,
    "amplitude_7": 0.0021,
    "amplitude_8": 0.0021,
    "amplitude_9": 0.0015,
    "amplitude_10": 0.0012,
    "amplitude_11": 0.0011,
    "amplitude_12": 0.00068,
    "skewness": 0.18,
    "folds": 0.78,
    "harmonic_1_real": 0.0013,
    "harmonic_1_imaginary": 0.0013,
    "harmonic_2_real": 0.0011,
    "harmonic_2_imaginary": 0.0013,
    "harmonic_4_real": 0.0017,
    "harmonic_4_imaginary": 0.0019,
}
"""Spread of each statistic between samples of one cloth, of 0.15 m radius."""

_NO_LENGTHS = ("drape_coefficient", "skewness", "folds")


def drape_statistics(drapes: Sequence[Shape]) -> Float[ndarray, "drapes statistics"]:
    """Statistics of drapes.

    Args:
        drapes: The drapes; profiles that they have already measured are used again.

    Returns:
        One row a drape, in the order of `STATISTICS`.

    Raises:
        MetricError: A profile with radii that are not finite.
    """
    radii = np.stack([drape.profile.radii for drape in drapes]) if drapes else np.zeros((0, PROFILE_ANGLES))
    protocol = drapes[0].protocol if drapes else RELEASE
    return profile_statistics(radii, np.array([drape.drape_coefficient for drape in drapes]), protocol)


def image_statistics(
    images: Float[ndarray, "images height width"] | UInt8[ndarray, "images height width"],
    protocol: Protocol = RELEASE,
) -> Float[ndarray, "images statistics"]:
    """Statistics of silhouettes.

    Args:
        images: Silhouettes; cloth = 1, or 255 in bytes.
        protocol: How they were taken.

    Returns:
        One row an image, in the order of `STATISTICS`.
    """
    full = 255 if images.dtype == np.uint8 else 1
    return drape_statistics([Shape(image / full, protocol=protocol) for image in images])


def profile_statistics(
    radii: Float[ndarray, "drapes angles"], coefficients: Float[ndarray, " drapes"], protocol: Protocol = RELEASE
) -> Float[ndarray, "drapes statistics"]:
    """Statistics of radius profiles.

    Args:
        radii: Radii at equidistant angles over the full turn, counter-clockwise from +x [m].
        coefficients: Drape coefficients of the same drapes.
        protocol: Gives the radii of cloth and plate.

    Returns:
        One row a profile, in the order of `STATISTICS`.

    Raises:
        MetricError: Shapes that do not fit, or values that are not finite.
    """
    if radii.ndim != 2 or coefficients.shape != radii.shape[:1]:
        raise MetricError(
            f"statistics need profiles (N, angles) and N drape coefficients, got {radii.shape}, {coefficients.shape}"
        )
    if not (np.isfinite(radii).all() and np.isfinite(coefficients).all()):
        raise MetricError("a profile holds radii that are not finite; its silhouette is empty or damaged")
    cloth, plate = protocol.cloth_radius_m, protocol.plate_radius_m
    return SCORED.measure(radii, drape_coefficients=coefficients, cloth_radius=cloth, plate_radius=plate)


def standardised(
    statistics: Float[ndarray, "drapes statistics"], names: Sequence[str] = STATISTICS, protocol: Protocol = RELEASE
) -> Float[ndarray, "drapes chosen"]:
    """Chosen columns of statistics, in units of `SCALES`.

    Args:
        statistics: Result of `drape_statistics`.
        names: Names among `STATISTICS`.
        protocol: Gives the cloth's radius, with which scales that are lengths grow.

    Returns:
        One column a name.
    """
    scales = [SCALES[name] * (1.0 if name in _NO_LENGTHS else protocol.cloth_scale) for name in names]
    return statistics[:, SCORED.columns(*names)] / np.array(scales)
