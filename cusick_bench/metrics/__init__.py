"""Metrics of drapes: images, surfaces, profiles, and the score of a whole prediction."""

from cusick_bench.metrics.errors import MetricError
from cusick_bench.metrics.hausdorff import hausdorff
from cusick_bench.metrics.image import iou, iou_pairs, mse, mse_pairs
from cusick_bench.metrics.profile import (
    profile_rms,
    profile_rms_rotated,
    quantile_distance,
    spectrum_distance,
)
from cusick_bench.metrics.ruled import ruled_surface
from cusick_bench.metrics.score import expected_best, score
from cusick_bench.metrics.shape import Shape
from cusick_bench.metrics.surface import Surface

__all__ = [
    "MetricError",
    "Shape",
    "Surface",
    "expected_best",
    "hausdorff",
    "iou",
    "iou_pairs",
    "mse",
    "mse_pairs",
    "profile_rms",
    "profile_rms_rotated",
    "quantile_distance",
    "ruled_surface",
    "score",
    "spectrum_distance",
]
