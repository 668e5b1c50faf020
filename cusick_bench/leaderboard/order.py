"""Which way a metric is better: most are losses, some are shares of agreement, some must hit a nominal value."""

import re
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.leaderboard.bootstrap import Statistic
from cusick_bench.leaderboard.errors import LeaderboardError

_NOMINAL = re.compile(r"_cover_(\d+)$")  # share of samples within an interval, and its nominal value [%]
_LARGER = re.compile(r"(_iou|_p)$")  # overlap; p-value of the hypothesis that draws and samples are alike
_SPENT = "spent_"  # drapes, seconds
_DESCRIPTIVE = re.compile(r"_target$|^train_(dc|folds)$|^floor_|^draws$")


@dataclass(frozen=True)
class Direction:
    """Direction in which a metric is better.

    Attributes:
        larger: Whether larger is better.
        nominal: The value to hit, None where there is none.
    """

    larger: bool = False
    nominal: float | None = None

    @property
    def words(self) -> str:
        """How rows are ordered, "" where smaller is better."""
        if self.nominal is not None:
            return f"nearest {100 * self.nominal:g} % first"
        return "largest first" if self.larger else ""

    def cost(self, value: Float[ndarray, "*batch"] | float) -> Float[ndarray, "*batch"] | float:
        """A metric's value as what is smaller for the better.

        Args:
            value: Value of the metric, in batches.

        Returns:
            The cost of each.
        """
        if self.nominal is not None:
            return np.abs(value - self.nominal)
        return -value if self.larger else value

    def of(self, statistic: Statistic) -> Statistic:
        """A statistic over cells as a cost: of coverage the miss of the statistic, as cells may err to either side.

        Args:
            statistic: Mean or interquartile mean.

        Returns:
            A function of the same values that gives the statistic's cost.
        """
        return lambda values: self.cost(statistic(values))


def smaller_is_better(metric: str) -> bool:
    """Whether a metric is a loss.

    Args:
        metric: Name of the metric.

    Returns:
        False of one that is better where it is larger or hits a value, and of one that is neither better nor worse.
    """
    return not _DESCRIPTIVE.search(metric) and direction(metric) == Direction()


def is_cost(metric: str) -> bool:
    """Whether a metric is what was spent, and no error.

    Args:
        metric: Name of the metric.

    Returns:
        True of drapes and seconds.
    """
    return metric.startswith(_SPENT)


def direction(metric: str) -> Direction:
    """Which way a metric is better.

    Args:
        metric: Name of the metric.

    Returns:
        What is better in it.

    Raises:
        LeaderboardError: It is neither better nor worse, but tells what was there.
    """
    if _DESCRIPTIVE.search(metric):
        raise LeaderboardError(f"nobody is better or worse by {metric!r}; choose for instance test_mse")
    found = _NOMINAL.search(metric)
    return Direction(bool(_LARGER.search(metric)), int(found[1]) / 100 if found else None)
