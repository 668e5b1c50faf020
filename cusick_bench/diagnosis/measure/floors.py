"""The floor of a gap: how far a fabric's own drapes lie from each other.

The energy distance of two random halves of a fabric's samples is 0 on the mean over all splits, whatever the samples,
since all three of its means are over pairs of different samples; but not in a single split. Its spread over splits, not
its mean, shows how large a gap between simulation and data must be to mean anything.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.resampling import halves_by_cluster
from cusick_bench.metrics.distributions.energy import cluster_distances


def split_half_floor(
    values: Float[ndarray, "rows numbers"],
    clusters: Int[ndarray, " rows"],
    generator: np.random.Generator,
    splits: int = 999,
    *,
    folds: Sequence[tuple[int, int]] = (),
) -> Float[ndarray, " splits"]:
    """Energy distances between random halves of the samples.

    Args:
        values: Standardised statistics.
        clusters: Sample of each row.
        generator: Random generator of the splits.
        splits: Number of random splits.
        folds: Scale the distances to the mean of those between n and m independent samples, for each (n, m): for equal
            distributions each goes as 1/n + 1/m. By default they stay those of halves.

    Returns:
        A distance for each split.

    Raises:
        DiagnosisError: Fewer than four samples.
    """
    labels, row = np.unique(clusters, return_inverse=True)
    number = len(labels)
    if number < 4:
        raise DiagnosisError(f"split halves need at least 4 samples, got {number}; use another fabric's floor")
    part = row < number // 2  # any two parts will do: every random split takes samples from both
    pooled = cluster_distances(values[part], values[~part], row[part], row[~part])
    first = halves_by_cluster(number, generator, splits)
    between = pooled.distance(first, 1 - first)
    if not folds:
        return between
    half = number // 2
    scale = np.linalg.norm([1 / n + 1 / m for n, m in folds]) / len(folds)
    return between * scale / (1 / half + 1 / (number - half))
