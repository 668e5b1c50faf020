"""Squared energy distance of two sets of statistics whose members come in clusters.

    E = 2 mean |x_i - y_k| - mean |x_i - x_j| - mean |y_k - y_l|

is 0 for one distribution and positive for two. With means over pairs of *different clusters* only it is unbiased
although captures of one sample are alike; pairs within a cluster would make a set look tighter than it is, and every
gap too large. Distances are Euclidean in units of a scale or of a covariance, divided by the root of the number of
statistics, so that distances on groups of statistics compare.

All that resampling needs of the pairs are their sums between clusters: `ClusterDistances` holds these, and a
distance of reweighted or relabelled clusters is two small products.

References:
    G. J. Szekely, M. L. Rizzo. Energy statistics: a class of statistics based on distances. Journal of Statistical
        Planning and Inference 143 (2013), 1249-1272.
    J. Schaefer, K. Strimmer. A shrinkage approach to large-scale covariance matrix estimation. Statistical
        Applications in Genetics and Molecular Biology 4 (2005), 32.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan, sqrt

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.linalg import solve_triangular
from scipy.spatial.distance import cdist

from cusick_bench.diagnosis.errors import DiagnosisError


@dataclass(frozen=True, eq=False)
class Standardisation:
    """The unit in which distances of statistics are measured.

    Attributes:
        covariance: Positive definite; a diagonal one stands for scales.
    """

    covariance: Float[ndarray, "statistics statistics"]

    @classmethod
    def of_scales(cls, scales: Float[ndarray, " statistics"]) -> "Standardisation":
        """One scale for each statistic.

        Raises:
            DiagnosisError: A scale that is not > 0.
        """
        if not (scales > 0).all():
            raise DiagnosisError(f"scales must be > 0, got {scales.min()}; raise them to the resolution of the images")
        return cls(np.diag(np.square(scales)))

    @classmethod
    def of_spread(
        cls,
        values: Float[ndarray, "rows statistics"],
        clusters: Int[ndarray, " rows"],
        resolution: Float[ndarray, " statistics"],
        *,
        correlated: bool = False,
    ) -> "Standardisation":
        """Unit from the spread between clusters: of the clusters' means, at least the resolution.

        Args:
            values: Statistics; rows of one cluster are averaged first.
            clusters: Label of each row.
            resolution: Least scale of each statistic.
            correlated: Take the correlations too (whitening), shrunk towards 0 as far as so few clusters demand.

        Raises:
            DiagnosisError: Fewer than two clusters, or values that are not finite.
        """
        check_finite(values)
        labels, row = np.unique(clusters, return_inverse=True)
        if len(labels) < 2:
            raise DiagnosisError("a spread needs at least 2 samples, got 1; give scales of another fabric")
        means = np.stack([values[row == i].mean(0) for i in range(len(labels))])
        scales = np.maximum(means.std(0, ddof=1), resolution)
        if not correlated:
            return cls.of_scales(scales)
        return cls(_shrunk_correlation(means, scales) * np.outer(scales, scales))

    def apply(
        self, values: Float[ndarray, "rows statistics"], columns: Sequence[int] | None = None
    ) -> Float[ndarray, "rows chosen"]:
        """Vectors whose Euclidean distance is the distance of the statistics, or of some of them alone."""
        chosen = list(range(len(self.covariance)) if columns is None else columns)
        root = np.linalg.cholesky(self.covariance[np.ix_(chosen, chosen)])
        return solve_triangular(root, values[:, chosen].T, lower=True).T / sqrt(len(chosen))


def _shrunk_correlation(means: ndarray, scales: ndarray) -> Float[ndarray, "statistics statistics"]:
    """Correlations times 1 - lambda, with lambda = sum Var(r_ij) / sum r_ij^2 over i /= j."""
    count = len(means)
    standard = (means - means.mean(0)) / scales
    products = standard[:, :, None] * standard[:, None, :]
    correlation = products.sum(0) / (count - 1)
    variance = products.var(0, ddof=1) * count / (count - 1) ** 2
    apart = ~np.eye(len(scales), dtype=bool)
    strength = (correlation[apart] ** 2).sum()
    # Above .95 the matrix would be as good as diagonal, at 0 with fewer clusters than statistics singular.
    shrinkage = np.clip(variance[apart].sum() / strength if strength > 0 else 1.0, 0.05, 1.0)
    result = (1 - shrinkage) * correlation
    np.fill_diagonal(result, 1.0)
    return result


@dataclass(frozen=True, eq=False)
class ClusterDistances:
    """Sums of distances between the clusters of two pooled sets.

    A node is what one set holds of one cluster. Nodes of one cluster in both sets are not compared either.

    Attributes:
        sums: Sum of distances between the rows of two nodes; 0 for nodes of one cluster.
        pairs: Number of these pairs of rows; 0 for nodes of one cluster.
        in_first: Which nodes the first set holds.
    """

    sums: Float[ndarray, "nodes nodes"]
    pairs: Float[ndarray, "nodes nodes"]
    in_first: Bool[ndarray, " nodes"]

    def distance(
        self, first: Float[ndarray, "*batch nodes"], second: Float[ndarray, "*batch nodes"]
    ) -> Float[ndarray, "*batch"]:
        """Energy distances of sets of weighted nodes; NaN where a set has fewer than two clusters."""
        return np.asarray(2 * self._mean(first, second) - self._mean(first, first) - self._mean(second, second))

    def _mean(self, weights: ndarray, others: ndarray) -> ndarray:
        total, number = ((weights @ part * others).sum(-1) for part in (self.sums, self.pairs))
        return np.where(number > 0, total / np.where(number > 0, number, 1.0), nan)

    @property
    def observed(self) -> float:
        """Energy distance of the two sets as they are."""
        return float(self.distance(self.in_first.astype(float), (~self.in_first).astype(float)))


def cluster_distances(
    first: Float[ndarray, "rows numbers"],
    second: Float[ndarray, "others numbers"],
    first_clusters: Int[ndarray, " rows"] | None = None,
    second_clusters: Int[ndarray, " others"] | None = None,
    *,
    shared: bool = False,
) -> ClusterDistances:
    """Sums of distances between clusters.

    Args:
        first, second: Standardised statistics of the two sets.
        first_clusters, second_clusters: Sample of each row; each row is its own by default.
        shared: Equal labels in both sets mean the same sample, whose pairs are left out between the sets too. By
            default labels of one set have nothing to do with the other's.

    Raises:
        DiagnosisError: An empty set, other lengths, or values that are not finite.
    """
    check_finite(first)
    check_finite(second)
    if first.shape[1] != second.shape[1]:
        raise DiagnosisError(f"both sets must hold the same statistics, got {first.shape[1]} and {second.shape[1]}")
    own, own_row = _labels(first, first_clusters)
    other, other_row = _labels(second, second_clusters)
    if shared and (first_clusters is None or second_clusters is None):
        raise DiagnosisError("shared clusters need labels of both sets")
    values = np.concatenate([first, second])
    row = np.concatenate([own_row, len(own) + other_row])
    nodes = len(own) + len(other)
    cluster = np.concatenate([own, other]) if shared else np.arange(nodes)
    apart = cluster[:, None] != cluster[None, :]
    sizes = np.bincount(row).astype(np.float64)
    sums = _sums_by_node(values[np.argsort(row, kind="stable")], np.cumsum(sizes) - sizes)
    return ClusterDistances(sums * apart, np.outer(sizes, sizes) * apart, np.arange(nodes) < len(own))


def _sums_by_node(values: ndarray, starts: ndarray) -> Float[ndarray, "nodes nodes"]:
    """Sums of distances; the rows of a node follow each other from its start."""
    first = starts.astype(np.int64)
    distances = cdist(values, values)
    return np.add.reduceat(np.add.reduceat(distances, first, axis=0), first, axis=1)


def _labels(values: ndarray, clusters: ndarray | None) -> tuple[ndarray, ndarray]:
    """Labels of the clusters, and the place of each row's label among them."""
    if clusters is None:
        return np.arange(len(values)), np.arange(len(values))
    if clusters.shape != (len(values),):
        raise DiagnosisError(f"clusters must label each of {len(values)} rows, got shape {clusters.shape}")
    labels, row = np.unique(clusters, return_inverse=True)
    return labels, row


def energy_distance(
    first: Float[ndarray, "rows numbers"],
    second: Float[ndarray, "others numbers"],
    first_clusters: Int[ndarray, " rows"] | None = None,
    second_clusters: Int[ndarray, " others"] | None = None,
    *,
    shared: bool = False,
) -> float:
    """Unbiased squared energy distance; see `cluster_distances`. NaN if a set has fewer than two clusters."""
    return cluster_distances(first, second, first_clusters, second_clusters, shared=shared).observed


def energy_by_group(
    first: Float[ndarray, "rows statistics"],
    second: Float[ndarray, "others statistics"],
    standardisation: Standardisation,
    groups: Mapping[str, Sequence[int]],
    first_clusters: Int[ndarray, " rows"] | None = None,
    second_clusters: Int[ndarray, " others"] | None = None,
) -> dict[str, float]:
    """Energy distance on each group of statistics alone; the distances do not add up to that on all.

    Args:
        first, second: Statistics, not standardised.
        standardisation: Their unit.
        groups: Columns of each group.
        first_clusters, second_clusters: Sample of each row.
    """
    found = {}
    for name, columns in groups.items():
        own, other = (standardisation.apply(values, columns) for values in (first, second))
        found[name] = energy_distance(own, other, first_clusters, second_clusters)
    return found


def check_finite(values: Float[ndarray, "rows numbers"]) -> None:
    """Raises:
    DiagnosisError: No rows, or values that are not finite.
    """
    if values.ndim != 2 or 0 in values.shape:
        raise DiagnosisError(f"a set must hold vectors, got shape {values.shape}; is a face missing?")
    if not np.isfinite(values).all():
        raise DiagnosisError("statistics must be finite; leave out samples that lack a face or a capture")
