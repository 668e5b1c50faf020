"""A row of a leaderboard: a method, with its scores over cells."""

from dataclasses import dataclass
from math import nan

from cusick_bench.leaderboard.bootstrap import Estimate
from cusick_bench.leaderboard.cells.variants import method_label

RANKED_KINDS = ("solver", "null")
"""Kinds of rows that have a rank."""


@dataclass(frozen=True)
class Row:
    """One line of a leaderboard.

    Attributes:
        solver: Name with options.
        variant: What sets it apart from another row of the same name, "" where nothing does.
        kind: "solver", "null", "oracle" or "floor".
        rank: 1 for the best; rows that cannot be told apart share it; None without a rank.
        cells: Number of finished cells.
        failed: Number of failed cells.
        cloths: Cloths covered.
        draws: Silhouettes offered for unseen samples; NaN where cells differ.
        estimates: Statistic with interval of every metric and every cost.
        means: Plain means of the same.
        iqms: Interquartile means of the same.
        matched_null: Best-of-`draws` MSE of as many random-phase draws; NaN where that is not known.
        code_version: Versions of the numerics, and commits, that its cells were computed with.
    """

    solver: str
    variant: str
    kind: str
    rank: int | None
    cells: int
    failed: int
    cloths: tuple[str, ...]
    draws: float
    estimates: dict[str, Estimate]
    means: dict[str, float]
    iqms: dict[str, float]
    matched_null: float = nan
    code_version: str = ""

    @property
    def label(self) -> str:
        """Name as it is shown."""
        return method_label(self.solver, self.variant)

    def value(self, metric: str) -> float:
        """The statistic of a metric, NaN where the row has none.

        Args:
            metric: Name of a metric or cost.

        Returns:
            Its mean or interquartile mean over cells.
        """
        return self.estimates[metric].value if metric in self.estimates else nan
