"""Which cloth a drape belongs to, judged by its statistics: what a draw should look like is its own cloth.

Diagonal linear discriminant analysis: a drape belongs to the cloth whose mean is nearest, with each statistic in
units of its spread within cloths (pooled). With a dozen samples a cloth and more statistics than that, correlations
cannot be estimated, and rules that try do worse.

References:
    S. Dudoit, J. Fridlyand, T. P. Speed. Comparison of discrimination methods for the classification of tumors
        using gene expression data. Journal of the American Statistical Association 97 (2002), 77-87.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.metrics.errors import MetricError


@dataclass(frozen=True, eq=False)
class Confusion:
    """What drapes were taken for.

    Attributes:
        cloths: Names, in the order of rows and columns.
        counts: Drapes of the row's cloth that were taken for the column's.
    """

    cloths: tuple[str, ...]
    counts: Int[ndarray, "cloths cloths"]

    @property
    def accuracy(self) -> float:
        """Share of drapes that are taken for their own cloth, each cloth counting alike; NaN without drapes."""
        shares = self.accuracies
        return float(np.nanmean(shares)) if np.isfinite(shares).any() else float("nan")

    @property
    def accuracies(self) -> Float[ndarray, " cloths"]:
        """The same for each cloth; NaN without drapes of it."""
        total = self.counts.sum(1)
        return np.where(total > 0, np.diag(self.counts) / np.maximum(total, 1), np.nan)


@dataclass(frozen=True, eq=False)
class Classifier:
    """Means and pooled spread of the cloths' statistics; made by `train`."""

    cloths: tuple[str, ...]
    means: Float[ndarray, "cloths statistics"]
    spread: Float[ndarray, " statistics"]

    def assign(self, statistics: Float[ndarray, "drapes statistics"]) -> Int[ndarray, " drapes"]:
        """Index of the cloth that each drape is taken for."""
        apart = (statistics[:, None] - self.means) / self.spread
        return (apart**2).sum(2).argmin(1)

    def confusion(self, statistics: Float[ndarray, "drapes statistics"], cloths: Sequence[str]) -> Confusion:
        """Takes drapes of known cloths for what they look like.

        Raises:
            MetricError: A cloth that the classifier does not know.
        """
        truth = _indices(self.cloths, cloths)
        return _confusion(self.cloths, truth, self.assign(statistics))


def train(statistics: Float[ndarray, "drapes statistics"], cloths: Sequence[str]) -> Classifier:
    """Learns cloths from real drapes.

    Args:
        statistics: Of the drapes.
        cloths: Their cloths.

    Raises:
        MetricError: Fewer than two cloths, or none with two drapes.
    """
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


def leave_one_out(
    statistics: Float[ndarray, "drapes statistics"], cloths: Sequence[str], samples: Sequence[Hashable]
) -> Confusion:
    """Takes every real drape for what it looks like to a classifier that has not seen its sample.

    Args:
        statistics: Of the drapes.
        cloths: Their cloths.
        samples: Which drapes are of one sample of a cloth, and so left out together.

    Raises:
        MetricError: Too few drapes, or a cloth with only one sample.
    """
    names = tuple(dict.fromkeys(cloths))
    owner = _indices(names, cloths)
    groups = list(zip(cloths, samples, strict=True))
    taken = np.zeros(len(owner), dtype=int)
    for group in dict.fromkeys(groups):
        own = np.array([other == group for other in groups])
        kept = [cloth for cloth, out in zip(cloths, own, strict=True) if not out]
        if group[0] not in kept:
            raise MetricError(f"{group[0]} must have at least 2 samples to leave one out; give a split with more")
        judge = train(statistics[~own], kept)
        taken[own] = _indices(names, judge.cloths)[judge.assign(statistics[own])]
    return _confusion(names, owner, taken)


def _indices(names: Sequence[str], cloths: Sequence[str]) -> Int[ndarray, " drapes"]:
    place = {name: index for index, name in enumerate(names)}
    unknown = sorted(set(cloths) - place.keys())
    if unknown:
        raise MetricError(f"unknown cloth {', '.join(unknown)}; the classifier knows {', '.join(names)}")
    return np.array([place[cloth] for cloth in cloths], dtype=int)


def _confusion(names: tuple[str, ...], truth: ndarray, taken: ndarray) -> Confusion:
    counts = np.zeros((len(names), len(names)), dtype=int)
    np.add.at(counts, (truth, taken), 1)
    return Confusion(names, counts)
