"""Squared energy distance of two sets whose members may come in clusters.

    E = 2 mean |x_i - y_k| - mean |x_i - x_j| - mean |y_k - y_l|

is 0 for equal distributions and positive for different ones. With means over pairs of *different clusters* only, it is
unbiased although captures of one sample are similar; pairs within a cluster would make a set look tighter than it is,
and every gap too large. Without clusters each member is a cluster of its own.

Resampling needs only the sums over pairs of clusters: `ClusterDistances` holds these, and the distance of reweighted or
relabelled clusters takes two small products.

References:
    G. J. Szekely, M. L. Rizzo. Energy statistics: a class of statistics based on distances. Journal of Statistical
        Planning and Inference 143 (2013), 1249-1272.
"""

from dataclasses import dataclass
from math import nan

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.spatial.distance import cdist

from cusick_bench.metrics.errors import MetricError


def check_vectors(values: Float[ndarray, "rows numbers"]) -> None:
    """Checks that a set holds vectors of finite numbers.

    Args:
        values: One vector a row.

    Raises:
        MetricError: No rows, or values that are not finite.
    """
    if values.ndim != 2 or 0 in values.shape:
        raise MetricError(f"a set must hold vectors, got shape {values.shape}; is a face missing?")
    if not np.isfinite(values).all():
        raise MetricError("statistics must be finite; leave out samples that lack a face or a capture")


@dataclass(frozen=True, eq=False)
class ClusterDistances:
    """Sums of distances between the clusters of two pooled sets.

    A node is what one set holds of one cluster. Nodes of one cluster in both sets are not compared either.

    Attributes:
        sums: Sum of distances between the rows of two nodes; 0 for nodes of one cluster.
        pairs: Number of these pairs of rows; 0 for nodes of one cluster.
        in_first: Whether the first set holds the node.
    """

    sums: Float[ndarray, "nodes nodes"]
    pairs: Float[ndarray, "nodes nodes"]
    in_first: Bool[ndarray, " nodes"]

    def distance(
        self,
        first: Float[ndarray, "*batch nodes"],
        second: Float[ndarray, "*batch nodes"],
        *,
        spread_of_one: float = nan,
    ) -> Float[ndarray, "*batch"]:
        """Energy distances of sets of weighted nodes.

        Args:
            first: Weights of the nodes in the first set.
            second: Weights of the nodes in the second set.
            spread_of_one: What stands for the mean distance within a set that has fewer than two clusters: NaN, since
                it is not known, or 0 for a point.

        Returns:
            One distance for each pair of sets.
        """
        own, other = (self._mean(weights, weights, spread_of_one) for weights in (first, second))
        return np.asarray(2 * self._mean(first, second, nan) - own - other)

    def _mean(self, weights: ndarray, others: ndarray, of_none: float) -> ndarray:
        """Mean distance over pairs of different clusters; `of_none` where there is no such pair."""
        total, number = ((weights @ part * others).sum(-1) for part in (self.sums, self.pairs))
        return np.where(number > 0, total / np.where(number > 0, number, 1.0), of_none)

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
        first: Vectors of the first set.
        second: Vectors of the second set.
        first_clusters: Sample of each row of `first`; each row is its own by default.
        second_clusters: Sample of each row of `second`.
        shared: Equal labels in both sets mean the same sample, whose pairs are left out between the sets too. By
            default labels of one set have nothing to do with the other's.

    Returns:
        The sums.

    Raises:
        MetricError: An empty set, other lengths, or values that are not finite.
    """
    for values in (first, second):
        check_vectors(values)
    if first.shape[1] != second.shape[1]:
        raise MetricError(f"both sets must hold the same statistics, got {first.shape[1]} and {second.shape[1]}")
    own, own_row = _labels(first, first_clusters)
    other, other_row = _labels(second, second_clusters)
    if shared and (first_clusters is None or second_clusters is None):
        raise MetricError("shared clusters need labels of both sets")
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
        raise MetricError(f"clusters must label each of {len(values)} rows, got shape {clusters.shape}")
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
    """Unbiased squared energy distance with Euclidean distances.

    Args:
        first: Vectors of the first set.
        second: Vectors of the second set.
        first_clusters: Sample of each row of `first`; each row is its own by default.
        second_clusters: Sample of each row of `second`.
        shared: See `cluster_distances`.

    Returns:
        The distance; NaN if a set has fewer than two clusters.

    Raises:
        MetricError: See `cluster_distances`.
    """
    return cluster_distances(first, second, first_clusters, second_clusters, shared=shared).observed
