"""Units of statistics in which energy distances are taken, and the distance on each group of statistics alone.

Distances are Euclidean in units of a scale or of a covariance, divided by the root of the number of statistics, so that
distances on groups of statistics compare. The distance itself is `cusick_bench.metrics.energy`.

References:
    J. Schaefer, K. Strimmer. A shrinkage approach to large-scale covariance matrix estimation. Statistical
        Applications in Genetics and Molecular Biology 4 (2005), 32.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.linalg import solve_triangular

from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.metrics.energy import check_vectors, energy_distance


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

        Args:
            scales: Scales, each in its statistic's unit.

        Returns:
            The unit.

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

        Returns:
            The unit.

        Raises:
            DiagnosisError: Fewer than two clusters.
            MetricError: No values, or some that are not finite.
        """
        check_vectors(values)
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
        """Vectors whose Euclidean distance is the distance of the statistics, or of some of them alone.

        Args:
            values: Statistics.
            columns: Which of the statistics; all by default.

        Returns:
            One vector a row of `values`.
        """
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
        first: Statistics of the first set, not standardised.
        second: Statistics of the second set.
        standardisation: Their unit.
        groups: Columns of each group.
        first_clusters: Sample of each row of `first`; each row is its own by default.
        second_clusters: Sample of each row of `second`.

    Returns:
        Group -> distance.
    """
    found = {}
    for name, columns in groups.items():
        own, other = (standardisation.apply(values, columns) for values in (first, second))
        found[name] = energy_distance(own, other, first_clusters, second_clusters)
    return found
