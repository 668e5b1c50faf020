"""Tests and intervals for captures that come in samples: the sample is what is drawn, flipped and permuted.

Captures of one sample repeat each other's folds. A test that shuffles captures takes such repeats for evidence and
rejects equal halves of one face far more often than it says; one that moves whole samples holds its level.

References:
    P. H. Westfall, S. S. Young. Resampling-Based Multiple Testing (1993): family-wise error by the maximum over tests.
    B. Phipson, G. K. Smyth. Permutation p-values should never be zero. Statistical Applications in Genetics and
        Molecular Biology 9 (2010), 39.
    A. C. Davison, D. V. Hinkley. Bootstrap Methods and their Application (1997), section 3.8: resampling of clusters.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.metrics.energy import ClusterDistances

_ROUNDING = 1e-12  # relative: a permutation that gives the data back is as extreme as they are


@dataclass(frozen=True, eq=False)
class ContrastTest:
    """A test of paired contrasts against 0.

    Attributes:
        p: Probability, if no contrast differs from 0, of a largest contrast as extreme as the data's.
        each: Likewise of a largest one as extreme as each statistic's: family-wise p-values.
        t: Student's t of each statistic; 0 where all its contrasts are 0.
        mean: Mean contrast.
        samples: How many contrasts there were.
    """

    p: float
    each: Float[ndarray, " statistics"]
    t: Float[ndarray, " statistics"]
    mean: Float[ndarray, " statistics"]
    samples: int


def sign_flip_test(
    contrasts: Float[ndarray, "samples statistics"], generator: np.random.Generator, flips: int = 4999
) -> ContrastTest:
    """Tests whether contrasts, one vector a sample, are symmetric about 0, by flipping each sample's sign.

    Where there are no more than `flips` ways to flip, all are tried, and the p-value is exact.

    Args:
        contrasts: As `face_odd` or `order_odd`; rows with NaN are left out.
        generator: Random generator of the flips.
        flips: How many at most.

    Returns:
        The test. scipy's `permutation_test` flips signs too, but gives no family-wise p-values.

    Raises:
        DiagnosisError: Fewer than two samples are left.
    """
    known = contrasts[np.isfinite(contrasts).all(1)]
    count = len(known)
    if count < 2:
        raise DiagnosisError(f"a contrast needs at least 2 samples with both of its sides, got {count}")
    size = np.sqrt((known**2).sum(0))
    size[size == 0] = np.inf
    exact = count <= 30 and 2**count <= flips + 1
    # The first row is the data themselves: p-values are never 0.
    signs = _all_signs(count) if exact else generator.choice([-1.0, 1.0], (flips, count))
    signs = signs if exact else np.concatenate([np.ones((1, count)), signs])
    largest = (np.abs(signs @ known) / size).max(1)
    observed = np.abs(known.sum(0)) / size
    each = (largest[:, None] >= observed * (1 - _ROUNDING)).mean(0)
    mean, error = known.mean(0), known.std(0, ddof=1) / np.sqrt(count)
    certain = np.where(mean == 0, 0.0, np.copysign(np.inf, mean))
    t = np.divide(mean, error, out=certain, where=error > 0)
    return ContrastTest(float(each.min()), each, t, mean, count)


def _all_signs(count: int) -> Float[ndarray, "flips samples"]:
    return np.array(list(product((1.0, -1.0), repeat=count)))


def two_sample_test(distances: ClusterDistances, generator: np.random.Generator, permutations: int = 999) -> float:
    """p-value of equal distributions: the energy distance, permuted by sample.

    Args:
        distances: Distances of two sets that share no sample; with one sample a row it is the usual permutation test.
        generator: Random generator of the permutations.
        permutations: Number of random permutations.

    Returns:
        The p-value; never 0. The sums between samples are permuted, not the captures as scipy would.

    Raises:
        DiagnosisError: A set with fewer than two samples, or a sample in both sets.
    """
    nodes = len(distances.in_first)
    if (distances.pairs[~np.eye(nodes, dtype=bool)] == 0).any():
        raise DiagnosisError("a sample must be in one set only; test paired contrasts by flipping signs")
    if min(distances.in_first.sum(), (~distances.in_first).sum()) < 2:
        raise DiagnosisError("a two-sample test needs at least 2 samples in each set")
    first = generator.permuted(np.tile(distances.in_first, (permutations, 1)), axis=1).astype(float)
    permuted, observed = distances.distance(first, 1 - first), distances.observed
    as_large = np.count_nonzero(permuted >= observed - _ROUNDING * abs(observed))
    return (1 + as_large) / (1 + permutations)


def bootstrap_weights(clusters: int, generator: np.random.Generator, draws: int) -> Float[ndarray, "draws clusters"]:
    """How often each cluster is drawn when as many are drawn with replacement.

    Args:
        clusters: Number of clusters.
        generator: Generator of the draws.
        draws: Number of draws.

    Returns:
        Counts, as floating-point weights.
    """
    return generator.multinomial(clusters, np.full(clusters, 1 / clusters), size=draws).astype(float)


def bootstrap_distance(
    distances: ClusterDistances, generator: np.random.Generator, draws: int = 999, *, both: bool = True
) -> Float[ndarray, " draws"]:
    """Energy distances of sets whose samples are drawn with replacement; copies of a sample are not compared.

    Args:
        distances: Distances of two sets that share no sample.
        generator: Random generator of the draws.
        draws: Number of bootstrap draws.
        both: Draw the second set's samples too; else only the first's, as when the second is a large simulated set.

    Returns:
        A distance for each draw.
    """
    weights = np.zeros((2, draws, len(distances.in_first)))
    for part, members in zip(weights, (distances.in_first, ~distances.in_first), strict=True):
        part[:, members] = bootstrap_weights(int(members.sum()), generator, draws)
    weights[1] = weights[1] if both else (~distances.in_first).astype(float)
    return distances.distance(weights[0], weights[1])


def bootstrap_rows(
    clusters: Int[ndarray, " rows"], generator: np.random.Generator
) -> tuple[Int[ndarray, " drawn"], Int[ndarray, " drawn"]]:
    """Draws clusters with replacement.

    Args:
        clusters: Label of each row.
        generator: Random generator of the draw.

    Returns:
        The rows of the drawn clusters; the number of the draw of each, so that a cluster drawn twice counts as two.
        For distances between rows keep the clusters' own labels instead, since copies are not compared.
    """
    labels = np.unique(clusters)
    drawn = generator.choice(labels, len(labels))
    rows = [np.flatnonzero(clusters == label) for label in drawn]
    return np.concatenate(rows), np.repeat(np.arange(len(rows)), [len(part) for part in rows])


def halves_by_cluster(clusters: int, generator: np.random.Generator, splits: int) -> Float[ndarray, "splits clusters"]:
    """Random halves of clusters.

    Args:
        clusters: Number of clusters.
        generator: Generator of the splits.
        splits: Number of splits.

    Returns:
        1 for clusters of the first half, which has one fewer where the number is odd, else 0.
    """
    half = np.arange(clusters) < clusters // 2
    return generator.permuted(np.tile(half, (splits, 1)), axis=1).astype(float)
