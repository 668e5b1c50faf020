"""Figures of one method: each with its interval, for each subset of cases.

Shares have Wilson's interval, which does not collapse where all cases went well; means have that of Student's t, which
counts how little a few cases tell of their scatter; areas under a curve have a percentile bootstrap over cases. Where
all cases are alike, or all resamples, as of an area of 1, they tell nothing, and there is no interval.
"""

from dataclasses import asdict, dataclass
from math import isfinite, nan

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.withheld.format.label import NULL, SINGLE
from cusick_bench.withheld.scoring.calibration import (
    alike,
    auroc,
    calibration_error,
    calibration_error_by_chance,
    mean_interval,
    wilson_interval,
)
from cusick_bench.withheld.scoring.measures import (
    ALL,
    AUROC,
    AUROC_GOAL,
    CALIBRATION,
    CALIBRATION_BY_CHANCE,
    CALIBRATION_GOAL,
    CLEAR,
    MEASURES,
    Goal,
    Measure,
)
from cusick_bench.withheld.scoring.subsets import subsets_of

RESAMPLES = 1000
_DIFFERENT = 2  # cases below which nothing can be resampled


@dataclass(frozen=True)
class Figure:
    """One number of the table.

    Attributes:
        method: `answers`, `chance`, or a baseline's name.
        name: Name of the figure.
        subset: Name of the subset of cases: `all`, a level of severity as `2x`, `>= 2x`, or those of the latter that no
            other effect makes.
        value: The figure; NaN without cases.
        low, high: Bounds of its 95 % interval; NaN where there is none.
        cases: Number of cases that it is taken over; of the area under the curve 0 where nulls or effects are missing.
        goal: What it should be, if anything.
    """

    method: str
    name: str
    subset: str
    value: float
    low: float
    high: float
    cases: int
    goal: Goal | None = None

    @property
    def reached(self) -> str:
        """`yes`, `no`, or "" where there is no goal or no case."""
        if self.goal is None or not isfinite(self.value):
            return ""
        return "yes" if self.goal.reached(self.value, self.high) else "no"

    def record(self) -> dict[str, object]:
        """The figure as a row of a table.

        Returns:
            Its attributes, and whether the goal is reached.
        """
        goal = "" if self.goal is None else str(self.goal)
        return {**asdict(self), "goal": goal, "reached": self.reached}


@dataclass(frozen=True, eq=False)
class _Bootstrap:
    """Percentile bootstrap over cases.

    Attributes:
        generator: Source of randomness.
        resamples: Number of samples.
    """

    generator: np.random.Generator
    resamples: int

    def resampled(self, values: Float[ndarray, " cases"]) -> Float[ndarray, "resamples cases"]:
        """As many cases again, drawn with replacement."""
        return self.generator.choice(values, size=(self.resamples, len(values)))

    def interval(self, drawn: Float[ndarray, " resamples"]) -> tuple[float, float]:
        """95 % interval of a figure, from its values in all samples; NaN where these are all alike."""
        if alike(drawn):
            return nan, nan
        low, high = np.percentile(drawn, [2.5, 97.5])
        return float(low), float(high)


def figures_of(
    method: str, cases: pd.DataFrame, generator: np.random.Generator | None, resamples: int = RESAMPLES
) -> list[Figure]:
    """All figures of one method.

    Args:
        method: `answers`, `chance`, or a baseline's name.
        cases: Judgements with the evidence of each, a row a case.
        generator: Source of the bootstrap; None for values without intervals.
        resamples: Number of bootstrap samples.

    Returns:
        The figures.
    """
    bootstrap = None if generator is None else _Bootstrap(generator, resamples)
    kind, evidence = cases["kind"].to_numpy(str), cases["evidence"].to_numpy(float)
    subsets, figures = subsets_of(cases), []
    for measure in MEASURES:
        values = cases[measure.column].to_numpy(float)
        asked = np.isin(kind, measure.kinds) & np.isfinite(values)
        for subset in subsets if measure.by_severity else (ALL,):
            figures.append(_figure(method, measure, subset, values[asked & subsets[subset]], bootstrap))
    for subset, within in subsets.items():
        positives, goal = evidence[(kind == SINGLE) & within], AUROC_GOAL if subset == CLEAR else None
        figures.append(_auroc(method, subset, positives, evidence[kind == NULL], goal, bootstrap))
    figures += _calibration(method, ALL, cases, bootstrap)
    return figures + _calibration(method, CLEAR, cases.loc[subsets[CLEAR] | (kind == NULL)], bootstrap)


def _figure(
    method: str,
    measure: Measure,
    subset: str,
    values: Float[ndarray, " cases"],
    bootstrap: _Bootstrap | None,
) -> Figure:
    mean = float(values.mean()) if len(values) else nan
    low, high = nan, nan
    if bootstrap is not None and measure.is_share:
        low, high = wilson_interval(round(float(values.sum())), len(values))
    elif bootstrap is not None:
        low, high = mean_interval(values, measure.least, measure.greatest)
    return Figure(method, measure.name, subset, mean, low, high, len(values), measure.goals.get(subset))


def _auroc(
    method: str,
    subset: str,
    positives: ndarray,
    nulls: ndarray,
    goal: Goal | None,
    bootstrap: _Bootstrap | None,
) -> Figure:
    if not len(positives) or not len(nulls):
        return Figure(method, AUROC, subset, nan, nan, nan, 0, goal)
    low, high = nan, nan
    if bootstrap is not None and min(len(positives), len(nulls)) >= _DIFFERENT:
        low, high = bootstrap.interval(auroc(bootstrap.resampled(positives), bootstrap.resampled(nulls)))
    area = float(auroc(positives, nulls))
    return Figure(method, AUROC, subset, area, low, high, len(positives) + len(nulls), goal)


def _calibration(method: str, subset: str, cases: pd.DataFrame, bootstrap: _Bootstrap | None) -> list[Figure]:
    known = cases.loc[cases["confidence"].notna()]
    confidence, right = known["confidence"].to_numpy(float), known["right"].to_numpy(float)
    if not len(known):
        return []
    chance = []
    if bootstrap is not None:
        value = calibration_error_by_chance(confidence, bootstrap.generator)
        chance = [Figure(method, CALIBRATION_BY_CHANCE, subset, value, nan, nan, len(known))]
    error = calibration_error(confidence, right)
    goal = CALIBRATION_GOAL if subset == CLEAR else None
    # No interval: chance adds to a binned error, and once more when its cases are resampled. Of 250 answers with a true
    # error of .03 percentile intervals never hold it.
    return [Figure(method, CALIBRATION, subset, error, nan, nan, len(known), goal), *chance]
