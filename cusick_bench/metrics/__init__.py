"""Metrics of drapes: images, surfaces, profiles, and the score of a whole prediction."""

from typing import TYPE_CHECKING

from cusick_bench.lazy import lazy_names

if TYPE_CHECKING:
    from cusick_bench.metrics.calibration import coverage, fold_test, ranks
    from cusick_bench.metrics.classification import Classifier, Confusion, learn
    from cusick_bench.metrics.distribution import DISTRIBUTION_METRICS, distribution_scores
    from cusick_bench.metrics.drape_variability import Variability, variability, variability_rows
    from cusick_bench.metrics.energy import energy_distance
    from cusick_bench.metrics.errors import MetricError
    from cusick_bench.metrics.hausdorff_distance import hausdorff
    from cusick_bench.metrics.image import iou, iou_pairs, mse, mse_pairs
    from cusick_bench.metrics.prediction_score import expected_best, from_levels, score, to_levels
    from cusick_bench.metrics.profile import profile_rms, profile_rms_rotated, quantile_distance, spectrum_distance
    from cusick_bench.metrics.proper_scores import crps, energy_distance_of_draws, energy_score, variogram_score
    from cusick_bench.metrics.ruled import ruled_surface
    from cusick_bench.metrics.shape import Shape
    from cusick_bench.metrics.statistics import (
        LOCKED,
        PHASE_FREE,
        SCALES,
        STATISTICS,
        drape_statistics,
        image_statistics,
        profile_statistics,
        standardised,
    )
    from cusick_bench.metrics.surface import Surface

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
        "Classifier": "classification",
        "Confusion": "classification",
        "DISTRIBUTION_METRICS": "distribution",
        "LOCKED": "statistics",
        "MetricError": "errors",
        "PHASE_FREE": "statistics",
        "SCALES": "statistics",
        "STATISTICS": "statistics",
        "Shape": "shape",
        "Surface": "surface",
        "Variability": "drape_variability",
        "coverage": "calibration",
        "crps": "proper_scores",
        "distribution_scores": "distribution",
        "drape_statistics": "statistics",
        "energy_distance": "energy",
        "energy_distance_of_draws": "proper_scores",
        "energy_score": "proper_scores",
        "expected_best": "prediction_score",
        "fold_test": "calibration",
        "from_levels": "prediction_score",
        "hausdorff": "hausdorff_distance",
        "image_statistics": "statistics",
        "iou": "image",
        "iou_pairs": "image",
        "learn": "classification",
        "mse": "image",
        "mse_pairs": "image",
        "profile_rms": "profile",
        "profile_rms_rotated": "profile",
        "profile_statistics": "statistics",
        "quantile_distance": "profile",
        "ranks": "calibration",
        "ruled_surface": "ruled",
        "score": "prediction_score",
        "spectrum_distance": "profile",
        "standardised": "statistics",
        "to_levels": "prediction_score",
        "variability": "drape_variability",
        "variability_rows": "drape_variability",
        "variogram_score": "proper_scores",
    },
)
