"""Metrics of drapes.

distances: of two drapes, as images, outlines and surfaces; distributions: predicted drapes against samples;
prediction_score: the score of a whole prediction; stiffness, found_stiffness: stiffness that was found against the
truth.
"""

from typing import TYPE_CHECKING

from cusick_bench.lazy import lazy_names

if TYPE_CHECKING:
    from cusick_bench.metrics.distances.hausdorff_distance import hausdorff
    from cusick_bench.metrics.distances.image import iou, iou_pairs, mse, mse_pairs
    from cusick_bench.metrics.distances.profile import (
        profile_rms,
        profile_rms_rotated,
        quantile_distance,
        spectrum_distance,
    )
    from cusick_bench.metrics.distances.ruled import ruled_surface
    from cusick_bench.metrics.distances.shape import Shape
    from cusick_bench.metrics.distances.surface import Surface
    from cusick_bench.metrics.distributions.calibration import coverage, fold_test, ranks
    from cusick_bench.metrics.distributions.classification import Classifier, Confusion, learn
    from cusick_bench.metrics.distributions.distribution import DISTRIBUTION_METRICS, distribution_scores
    from cusick_bench.metrics.distributions.drape_variability import Variability, variability, variability_rows
    from cusick_bench.metrics.distributions.energy import energy_distance
    from cusick_bench.metrics.distributions.proper_scores import (
        crps,
        energy_distance_of_draws,
        energy_score,
        variogram_score,
    )
    from cusick_bench.metrics.distributions.statistics import (
        LOCKED,
        PHASE_FREE,
        SCALES,
        STATISTICS,
        drape_statistics,
        image_statistics,
        profile_statistics,
        standardised,
    )
    from cusick_bench.metrics.errors import MetricError
    from cusick_bench.metrics.prediction_score import expected_best, from_levels, score, to_levels

NUMERICS_VERSION = 1  # raised when a metric's numbers change: see runner/numerics.py

__all__ = [
    "DISTRIBUTION_METRICS",
    "LOCKED",
    "PHASE_FREE",
    "SCALES",
    "STATISTICS",
    "Classifier",
    "Confusion",
    "MetricError",
    "Shape",
    "Surface",
    "Variability",
    "coverage",
    "crps",
    "distribution_scores",
    "drape_statistics",
    "energy_distance",
    "energy_distance_of_draws",
    "energy_score",
    "expected_best",
    "fold_test",
    "from_levels",
    "hausdorff",
    "image_statistics",
    "iou",
    "iou_pairs",
    "learn",
    "mse",
    "mse_pairs",
    "profile_rms",
    "profile_rms_rotated",
    "profile_statistics",
    "quantile_distance",
    "ranks",
    "ruled_surface",
    "score",
    "spectrum_distance",
    "standardised",
    "to_levels",
    "variability",
    "variability_rows",
    "variogram_score",
]

__getattr__ = lazy_names(
    __name__,
    {
        "Classifier": "distributions.classification",
        "Confusion": "distributions.classification",
        "DISTRIBUTION_METRICS": "distributions.distribution",
        "LOCKED": "distributions.statistics",
        "MetricError": "errors",
        "PHASE_FREE": "distributions.statistics",
        "SCALES": "distributions.statistics",
        "STATISTICS": "distributions.statistics",
        "Shape": "distances.shape",
        "Surface": "distances.surface",
        "Variability": "distributions.drape_variability",
        "coverage": "distributions.calibration",
        "crps": "distributions.proper_scores",
        "distribution_scores": "distributions.distribution",
        "drape_statistics": "distributions.statistics",
        "energy_distance": "distributions.energy",
        "energy_distance_of_draws": "distributions.proper_scores",
        "energy_score": "distributions.proper_scores",
        "expected_best": "prediction_score",
        "fold_test": "distributions.calibration",
        "from_levels": "prediction_score",
        "hausdorff": "distances.hausdorff_distance",
        "image_statistics": "distributions.statistics",
        "iou": "distances.image",
        "iou_pairs": "distances.image",
        "learn": "distributions.classification",
        "mse": "distances.image",
        "mse_pairs": "distances.image",
        "profile_rms": "distances.profile",
        "profile_rms_rotated": "distances.profile",
        "profile_statistics": "distributions.statistics",
        "quantile_distance": "distances.profile",
        "ranks": "distributions.calibration",
        "ruled_surface": "distances.ruled",
        "score": "prediction_score",
        "spectrum_distance": "distances.profile",
        "standardised": "distributions.statistics",
        "to_levels": "prediction_score",
        "variability": "distributions.drape_variability",
        "variability_rows": "distributions.drape_variability",
        "variogram_score": "distributions.proper_scores",
    },
)
