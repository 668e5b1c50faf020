"""Floors of a gap: how far a fabric's own drapes lie from each other.

The gap between simulation and data is read against two of them. Two halves of a fabric's samples have an energy
distance that is 0 on average, but not in one split: its spread over splits says below what a gap means nothing.
And captures of one specimen, a face of one sample, say how well a drape repeats: no simulator of the drape alone
can come closer to a single capture.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.spatial.distance import cdist

from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.resampling import halves_by_cluster
from cusick_bench.metrics.energy import cluster_distances


def split_half_floor(
    values: Float[ndarray, "rows numbers"],
    clusters: Int[ndarray, " rows"],
    generator: np.random.Generator,
    splits: int = 999,
    *,
    versus: int | None = None,
) -> Float[ndarray, " splits"]:
    """Energy distances between random halves of the samples.

    Args:
        values: Standardised statistics.
        clusters: Sample of each row.
        generator: Random generator of the splits.
        splits: Number of random splits.
        versus: Scale the distances to those of all n samples from this number m of independent others: for equal
            distributions they go as 1/n + 1/m. By default they stay those of halves, which are larger.

    Returns:
        A distance for each split.

    Raises:
        DiagnosisError: Fewer than four samples.
    """
    labels, row = np.unique(clusters, return_inverse=True)
    number = len(labels)
    if number < 4:
        raise DiagnosisError(f"split halves need at least 4 samples, got {number}; use another fabric's floor")
    part = row < number // 2  # any two parts do: every split draws on the nodes of both
    pooled = cluster_distances(values[part], values[~part], row[part], row[~part])
    first = halves_by_cluster(number, generator, splits)
    between = pooled.distance(first, 1 - first)
    if versus is None:
        return between
    half = number // 2
    return between * (1 / number + 1 / versus) / (1 / half + 1 / (number - half))


@dataclass(frozen=True)
class RepeatFloor:
    """Mean distances between single captures, in the unit of the standardised statistics.

    Attributes:
        repeat: Spread of captures of one specimen; NaN without repeats.
        face: Spread of captures of a sample's two faces; NaN without them.
        sample: Spread of captures of one face of different samples; NaN without them.
    """

    repeat: float
    face: float
    sample: float


def repeat_floor(values: Float[ndarray, "rows numbers"], samples: Int[ndarray, " rows"], sides: ndarray) -> RepeatFloor:
    """How far captures of one specimen lie apart, beside those of other faces and samples.

    Args:
        values: Standardised statistics of every capture.
        samples: Sample of each.
        sides: Face of each; "" where it is not known.

    Returns:
        Mean distances.
    """
    distance = cdist(values, values)

    def mean(where: Bool[ndarray, "rows rows"]) -> float:
        return float(distance[where].mean()) if where.any() else np.nan

    return RepeatFloor(*(mean(where) for where in _kinds_of_pairs(samples, sides)))


@dataclass(frozen=True, eq=False)
class Spread:
    """Standard deviations of each statistic at the levels of a nested design; NaN where a level has no pairs.

    Attributes:
        sample: Between samples, of what both faces of a sample share.
        face: Between the faces of a sample; the mean difference of all samples' faces is taken off.
        repeat: Between captures of one specimen.
    """

    sample: Float[ndarray, " statistics"]
    face: Float[ndarray, " statistics"]
    repeat: Float[ndarray, " statistics"]


def spread_by_level(
    values: Float[ndarray, "rows statistics"], samples: Int[ndarray, " rows"], sides: ndarray
) -> Spread:
    """Components of variance, from mean squared differences of pairs; a negative one counts as 0.

    Args:
        values: Statistics of every capture.
        samples: Sample of each.
        sides: Face of each; "" where it is not known.

    Returns:
        Standard deviations [each statistic's unit].
    """
    centred = values.copy()
    for side in np.unique(sides):
        centred[sides == side] -= values[sides == side].mean(0)
    repeats, faces, apart = _kinds_of_pairs(samples, sides)
    repeat, face, sample = (_half_square(centred, where) for where in (repeats, faces, apart))
    return Spread(np.sqrt(np.maximum(sample - face, 0)), np.sqrt(np.maximum(face - repeat, 0)), np.sqrt(repeat))


def _half_square(values: ndarray, where: Bool[ndarray, "rows rows"]) -> Float[ndarray, " statistics"]:
    first, second = np.nonzero(np.triu(where))
    if len(first) == 0:
        return np.full(values.shape[1], np.nan)
    return ((values[first] - values[second]) ** 2).mean(0) / 2


def _kinds_of_pairs(samples: ndarray, sides: ndarray) -> tuple[ndarray, ndarray, ndarray]:
    """Which pairs of captures show one specimen, the two faces of a sample, one face of two samples."""
    same_sample, same_side = samples[:, None] == samples[None, :], sides[:, None] == sides[None, :]
    known = (sides[:, None] != "") & (sides[None, :] != "")
    other = ~np.eye(len(samples), dtype=bool)
    return same_sample & same_side & other, same_sample & ~same_side & known, ~same_sample & same_side
