"""Tests and intervals for captures that come in samples: whole samples are drawn, flipped and permuted.

Captures of one sample repeat each other's folds. A test that permutes captures takes such repeats for evidence and
rejects equal halves of one face far more often than its level; a test that permutes whole samples holds its level.

References:
    P. H. Westfall, S. S. Young. Resampling-Based Multiple Testing (1993): family-wise error by the maximum over tests.
    B. Phipson, G. K. Smyth. Permutation p-values should never be zero. Statistical Applications in Genetics and
        Molecular Biology 9 (2010), 39.
    A. C. Davison, D. V. Hinkley. Bootstrap Methods and their Application (1997), section 3.8: resampling of clusters.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.errors import DiagnosisError

_ROUNDING = 1e-12  # relative tolerance: a permutation that reproduces the data counts as equally extreme


@dataclass(frozen=True, eq=False)
class ContrastTest:
    """A test of paired contrasts against 0.

    Attributes:
        p: Probability of a largest contrast at least as extreme as the data's, if all contrasts are symmetric about 0.
        each: Family-wise p-values: the same probability for the contrast of each statistic.
        t: Student's t of each statistic; 0 where all its contrasts are 0.
        mean: Mean contrast.
        samples: Number of contrasts.
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
        flips: Largest number of flips.

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
