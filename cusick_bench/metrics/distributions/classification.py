"""Classifies drapes by their statistics: a draw should be assigned to its own cloth.

Diagonal linear discriminant analysis: a drape belongs to the cloth whose mean is nearest, with each statistic in units
of its spread within cloths (pooled). With a dozen samples a cloth and more statistics than that, correlations cannot be
estimated, and rules that try do worse. A choice among cloths alone would assign even a disc to one of them. So a drape
that is farther from every cloth than 95 % of real samples are from their own is assigned to none.

References:
    S. Dudoit, J. Fridlyand, T. P. Speed. Comparison of discrimination methods for the classification of tumors
        using gene expression data. Journal of the American Statistical Association 97 (2002), 77-87.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from math import inf, nan

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.metrics.errors import MetricError

LIKELY = 0.95  # least share of real samples that lie within the reach of their cloth
NONE = -1  # index for drapes beyond the reach of every cloth; the last column of a table


@dataclass(frozen=True, eq=False)
class Confusion:
    """Confusion table: to which cloths drapes were assigned.

    Attributes:
        cloths: Names, in the order of rows and columns.
        counts: Drapes of the row's cloth that were taken for the column's, in the last column for none.
    """

    cloths: tuple[str, ...]
    counts: Int[ndarray, "cloths choices"]

    @property
    def accuracy(self) -> float:
        """Share of drapes that are taken for their own cloth, each cloth counting alike; NaN without drapes."""
        shares = self.accuracies
        return float(np.nanmean(shares)) if np.isfinite(shares).any() else nan

    @property
    def accuracies(self) -> Float[ndarray, " cloths"]:
        """The same for each cloth; NaN without drapes of it."""
        total = self.counts.sum(1)
        return np.where(total > 0, np.diag(self.counts) / np.maximum(total, 1), np.nan)

    @property
    def strangers(self) -> float:
        """Share of drapes that are taken for no cloth, each cloth counting alike; NaN without drapes."""
        total = self.counts.sum(1)
        return float((self.counts[total > 0, NONE] / total[total > 0]).mean()) if total.any() else nan


@dataclass(frozen=True, eq=False)
class Classifier:
    """A classifier of drapes by cloth; made by `learn`.

    Attributes:
        cloths: Names.
        means: Mean of the statistics of each cloth.
        spread: Standard deviation within cloths, pooled.
        reach: Distance from a cloth's mean beyond which a drape is none of it.
    """

    cloths: tuple[str, ...]
    means: Float[ndarray, "cloths statistics"]
    spread: Float[ndarray, " statistics"]
    reach: float = inf

    def distances(self, statistics: Float[ndarray, "drapes statistics"]) -> Float[ndarray, "drapes cloths"]:
        """Distance of drapes from the means of the cloths.

        Args:
            statistics: Statistics of the drapes.

        Returns:
            Root-mean-square distances in units of the spread.

        Raises:
            MetricError: Statistics that are not finite.
        """
        _check_finite(statistics)
        apart = (statistics[:, None] - self.means) / self.spread
        return np.sqrt((apart**2).mean(2))

    def assign(self, statistics: Float[ndarray, "drapes statistics"]) -> Int[ndarray, " drapes"]:
        """Takes each drape for the nearest cloth, or for none.

        Args:
            statistics: Statistics of the drapes.

        Returns:
            Index of the cloth, or `NONE`.

        Raises:
            MetricError: Statistics that are not finite.
        """
        return _nearest(self.distances(statistics), self.reach)

    def confusion(self, statistics: Float[ndarray, "drapes statistics"], cloths: Sequence[str]) -> Confusion:
        """Takes drapes of known cloths for what they look like.

        Args:
            statistics: Statistics of the drapes.
            cloths: Name of the cloth of each.

        Returns:
            How many were taken for what.

        Raises:
            MetricError: A cloth that the classifier does not know, or statistics that are not finite.
        """
        truth = _indices(self.cloths, cloths)
        return _confusion(self.cloths, truth, self.assign(statistics))


def learn(
    statistics: Float[ndarray, "drapes statistics"], cloths: Sequence[str], samples: Sequence[Hashable]
) -> tuple[Classifier, Confusion]:
    """Learns cloths from real drapes, and how well a drape of an unseen sample is recognised.

    Args:
        statistics: Statistics of the drapes.
        cloths: Name of the cloth of each drape.
        samples: Label of the sample of each drape; drapes of one sample are left out together.

    Returns:
        The classifier, and what every drape is taken for by one that has not seen its sample.

    Raises:
        MetricError: Fewer than two cloths, too few drapes, a cloth with only one sample, or statistics that are not
            finite.
    """
    _check_finite(statistics)
    judge = _train(statistics, cloths)
    owner, groups = _indices(judge.cloths, cloths), list(zip(cloths, samples, strict=True))
    distances = np.zeros((len(owner), len(judge.cloths)))
    for group in dict.fromkeys(groups):
        own = np.array([other == group for other in groups])
        kept = [cloth for cloth, out in zip(cloths, own, strict=True) if not out]
        if group[0] not in kept:
            raise MetricError(f"{group[0]} must have at least 2 samples to leave one out; give a split with more")
        unseen = _train(statistics[~own], kept)
        distances[np.ix_(own, _indices(judge.cloths, unseen.cloths))] = unseen.distances(statistics[own])
    reach = float(np.quantile(distances[np.arange(len(owner)), owner], LIKELY, method="higher"))
    return replace(judge, reach=reach), _confusion(judge.cloths, owner, _nearest(distances, reach))


def _check_finite(statistics: ndarray) -> None:
    bad = np.argwhere(~np.isfinite(statistics))  # they are near to every cloth, to none, or to the first
    if len(bad):
        drape, column = map(int, bad[0])
        raise MetricError(f"statistics must be finite, got {statistics[drape, column]} in row {drape}, column {column}")


def _train(statistics: ndarray, cloths: Sequence[str]) -> Classifier:
    names = tuple(dict.fromkeys(cloths))
    owner = _indices(names, cloths)
    if len(names) < 2 or len(owner) <= len(names):
        raise MetricError(
            f"telling cloths apart needs at least 2 cloths and more drapes than cloths, got {len(owner)} drapes of "
            f"{len(names)}; give a run of more cloths (--cloth)"
        )
    means = np.stack([statistics[owner == index].mean(0) for index in range(len(names))])
    residuals = statistics - means[owner]
    spread = np.sqrt((residuals**2).sum(0) / (len(owner) - len(names)))
    # A statistic that never varies within a cloth says nothing where it varies not at all, and all where it does.
    return Classifier(names, means, np.maximum(spread, 1e-9 * np.abs(statistics).max(0) + 1e-300))


def _nearest(distances: Float[ndarray, "drapes cloths"], reach: float) -> Int[ndarray, " drapes"]:
    return np.where(distances.min(1) > reach, NONE, distances.argmin(1))


def _indices(names: Sequence[str], cloths: Sequence[str]) -> Int[ndarray, " drapes"]:
    place = {name: index for index, name in enumerate(names)}
    unknown = sorted(set(cloths) - place.keys())
    if unknown:
        raise MetricError(f"unknown cloth {', '.join(unknown)}; the classifier knows {', '.join(names)}")
    return np.array([place[cloth] for cloth in cloths], dtype=int)


def _confusion(names: tuple[str, ...], truth: ndarray, taken: ndarray) -> Confusion:
    counts = np.zeros((len(names), len(names) + 1), dtype=int)
    np.add.at(counts, (truth, taken), 1)
    return Confusion(names, counts)
