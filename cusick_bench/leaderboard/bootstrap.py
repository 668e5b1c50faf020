"""Means with bootstrap intervals over cells (cloth x seed), and paired differences of two solvers.

Seeds are resampled within each cloth (stratified), so that statements are about these cloths. If a cloth has only one
seed, or seeds change nothing, this would give no interval; then the cloths are resampled, each with its mean over
seeds. Where samples are left out in turn, these are resampled within each cloth instead of seeds, each with its mean
over seeds: fits with several seeds are scored on the same sample and tell little more than one of them. Two solvers are
compared on the same resampled cells, so that effects of the cloth on both cancel. SciPy resamples the strata; this
module decides which units they hold.

Percentile intervals of few units are too narrow: of normal values those of 3, 5 and 12 cloths with one seed each would
hold the true mean in 75, 84 and 91 % of cases instead of 95. So the bounds are stretched about the value as Student's t
has it, by t / z sqrt(n / nu): t and z are the quantiles of Student's t with nu degrees of freedom and of the normal
distribution, n is the number of units, and nu is n less the number of strata. The square root undoes the bias of the
bootstrap's variance. For means of normal values the interval is then that of Student's t.

A geometric mean gives every cloth the same weight, however many seeds it has. With n_c units of cloth c, each of the
weight u_c, the bootstrap's variance is sum (n_c - 1) u_c^2 / sum n_c u_c^2 of the true one, and it is known to

    nu = (sum (n_c - 1) u_c^2)^2 / sum (n_c - 1) u_c^4

degrees of freedom (Satterthwaite). With equal weights that is what is said above. Of normal values of two cloths with 5
and 12 seeds, or of four with 2, 6, 6 and 6, the interval then holds the true mean in 95 and 96 % of cases; stretched as
if all units weighed alike, in 93 and 90 %. Of two cloths with 2 and 12 it is too wide: 99 % instead of 79 %.

References:
    R. Agarwal, M. Schwarzer, P. S. Castro, A. Courville, M. G. Bellemare. Deep reinforcement learning at the
    edge of the statistical precipice. NeurIPS 2021 (interquartile mean, stratified bootstrap). T. C. Hesterberg. What
    teachers should know about the bootstrap. The American Statistician 69(4), 2015 (intervals of small samples).
    F. E. Satterthwaite. An approximate distribution of estimates of variance components. Biometrics Bulletin 2, 1946.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, inf, isfinite, nan

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.stats import bootstrap, norm, trim_mean
from scipy.stats import t as student

from cusick_bench.leaderboard.cells.cell_number import split_of

RESAMPLES = 4000
LEVEL = 0.95
MINIMUM_UNITS = 3  # least number of resampled units for a meaningful interval

Values = Mapping[tuple[str, int], float]  # (cloth, number of the cell as `cell_number` has it) -> value
Statistic = Callable[[Float[ndarray, "*batch cells"]], Float[ndarray, "*batch"] | float]


def mean(values: Float[ndarray, "*batch cells"]) -> Float[ndarray, "*batch"] | float:
    """Mean over cells.

    Args:
        values: A value a cell, in batches.

    Returns:
        The mean of each batch.
    """
    return values.mean(-1)


def interquartile_mean(values: Float[ndarray, "*batch cells"]) -> Float[ndarray, "*batch"] | float:
    """Mean of the middle half of the cells; the plain mean of fewer than four.

    Args:
        values: A value a cell, in batches.

    Returns:
        The interquartile mean of each batch.
    """
    return trim_mean(values, 0.25, axis=-1)


STATISTICS: dict[str, Statistic] = {"mean": mean, "iqm": interquartile_mean}


@dataclass(frozen=True)
class Estimate:
    """A statistic with its bootstrap interval; the bounds are NaN where there are too few cells."""

    value: float
    low: float
    high: float

    def columns(self, name: str) -> dict[str, float]:
        """The estimate as three columns of a table.

        Args:
            name: Name of the column with the value; those of the bounds end in `_low` and `_high`.

        Returns:
            Value and bounds by column.
        """
        return {name: self.value, f"{name}_low": self.low, f"{name}_high": self.high}

    @property
    def decided(self) -> bool:
        """Whether there is an interval and it leaves out 0."""
        return self.low > 0 or self.high < 0


def repeats(table: pd.DataFrame) -> list[int]:
    """Number of each cell among those of its method and cloth.

    Args:
        table: A row a cell, with `repeat` (`load_cells`), or else with `seed`.

    Returns:
        The numbers.
    """
    return [int(number) for number in table["repeat" if "repeat" in table else "seed"]]


def cell_values(table: pd.DataFrame, name: str) -> dict[tuple[str, int], float]:
    """A column of a table of cells, without what is not finite.

    Args:
        table: A row a cell, with columns `cloth` and `repeat` or `seed`.
        name: The column.

    Returns:
        Values by cloth and number (`repeats`); none where there is no such column.
    """
    if name not in table:
        return {}
    cells = zip(table["cloth"], repeats(table), table[name].astype(float), strict=True)
    return {(str(cloth), number): float(value) for cloth, number, value in cells if isfinite(value)}


def estimate(values: Values, statistic: Statistic, generator: np.random.Generator, most: float = inf) -> Estimate:
    """Statistic of one solver's values with its interval.

    Args:
        values: A value for each cell (cloth, seed).
        statistic: One of `STATISTICS`.
        generator: Source of the resamples.
        most: Largest value that there can be, such as 1 of shares.

    Returns:
        The statistic with its 95 % interval, which ends at 0 where no value is negative, and at `most`.
    """
    found = _interval([values], lambda columns: statistic(columns[0]), generator)
    if not isfinite(found.low):
        return found
    least = 0.0 if min(values.values()) >= 0 else -inf  # of no values that are negative no mean is, however few
    return replace(found, low=max(found.low, least), high=min(found.high, most))


def geometric_mean(logarithms: Values, generator: np.random.Generator) -> Estimate:
    """Geometric mean over cloths of positive numbers, stiffnesses or ratios, with its interval.

    A cloth has the weight of any other one, however many seeds it has.

    Args:
        logarithms: Natural logarithm of a number for each cell (cloth, seed), of any sign.
        generator: Source of the resamples.

    Returns:
        The geometric mean with its 95 % interval: the same multiples of it in any unit of the numbers, and of their
        inverses.
    """
    if not logarithms:
        return Estimate(nan, nan, nan)
    sizes = np.array([len(stratum) for stratum in _strata([logarithms])])
    # Resampled units stay in the places of their stratum.
    shares = 1 / (len(sizes) * sizes)
    weights = np.repeat(shares, sizes)
    found = _interval([logarithms], lambda columns: columns[0] @ weights, generator, shares)
    return Estimate(*(exp(one) if isfinite(one) else nan for one in (found.value, found.low, found.high)))


def beside(values: Values, others: Values, statistic: Statistic) -> float:
    """Statistic of other values of the same cells, which count as much as those of a solver do in its `estimate`.

    Args:
        values: A value for each cell (cloth, seed) of the solver.
        others: The values to read them against, for all of these cells at least.
        statistic: One of `STATISTICS`.

    Returns:
        The statistic of the others.
    """
    units = np.array([unit for stratum in _strata([values, others], decisive=1) for unit in stratum])
    return float(statistic(units[:, 1]))


def difference(first: Values, second: Values, statistic: Statistic, generator: np.random.Generator) -> Estimate:
    """Statistic of `first` minus that of `second`, on the cells that both have, with its interval.

    Args:
        first: A value for each cell (cloth, seed). A solver with one seed of a cloth (of one of its splits) is taken to
            have no randomness: the value stands for all seeds that the other solver has there.
        second: Values of the other solver.
        statistic: One of `STATISTICS`.
        generator: Source of the resamples.

    Returns:
        The difference with its 95 % interval; NaN where the solvers share no cell.
    """
    one, other = _filled(first, second), _filled(second, first)
    shared = sorted(one.keys() & other.keys())
    columns = [{cell: one[cell] for cell in shared}, {cell: other[cell] for cell in shared}]
    return _interval(columns, lambda columns: statistic(columns[0]) - statistic(columns[1]), generator)


def _filled(own: Values, other: Values) -> Values:
    seeds = Counter((cloth, split_of(number)) for cloth, number in own)
    single = {(cloth, split_of(number)): value for (cloth, number), value in own.items()}
    single = {place: value for place, value in single.items() if seeds[place] == 1}
    places = {cell: (cell[0], split_of(cell[1])) for cell in other}
    return {cell: single[place] for cell, place in places.items() if place in single} | dict(own)


def _interval(
    columns: Sequence[Values],
    statistic: Callable[[ndarray], ndarray | float],
    generator: np.random.Generator,
    shares: Float[ndarray, " strata"] | None = None,
) -> Estimate:
    """Statistic of columns with the same cells, and its stretched percentile interval.

    `shares` are the weights that the statistic gives to a unit of each stratum, by default the same to all.
    """
    if not columns[0]:
        return Estimate(nan, nan, nan)
    strata = [np.array(stratum) for stratum in _strata(columns)]
    units = np.concatenate(strata)
    value = float(statistic(units.T))
    if len(units) < MINIMUM_UNITS:
        return Estimate(value, nan, nan)
    # Places are resampled instead of values, so that columns stay paired within every stratum.
    places = np.split(np.arange(len(units)), np.cumsum([len(part) for part in strata])[:-1])
    resampled = bootstrap(
        places,
        lambda *chosen, axis: statistic(np.moveaxis(units[np.concatenate(chosen, axis=axis)], -1, 0)),
        n_resamples=RESAMPLES,
        method="percentile",
        vectorized=True,
        rng=generator,
    ).bootstrap_distribution
    tail = 50 * (1 - LEVEL)  # SciPy rounds this otherwise, which would change the last digit of committed bounds
    bounds = np.percentile(resampled, [tail, 100 - tail])
    sizes = np.array([len(part) for part in strata])
    low, high = value + _stretch(sizes, np.ones(len(sizes)) if shares is None else shares) * (bounds - value)
    return Estimate(value, float(low), float(high))


def _stretch(sizes: Int[ndarray, " strata"], shares: Float[ndarray, " strata"]) -> float:
    """Width of Student's interval over that of the percentile bootstrap, for a mean of strata of these sizes.

    `shares` are the weights of a unit of each.
    """
    squares = (shares / shares.max()) ** 2  # 1 where all units weigh alike, and all that follows is exact
    seen = (sizes - 1) * squares
    freedom = float(seen.sum() ** 2 / (seen @ squares))
    upper = (1 + LEVEL) / 2
    return float(student.ppf(upper, freedom) / norm.ppf(upper)) * float(sizes @ squares / seen.sum()) ** 0.5


def _strata(columns: Sequence[Values], decisive: int | None = None) -> list[list[list[float]]]:
    """Values to resample, a row a unit: those of each cloth as a stratum, or else all cloths as one stratum.

    The first `decisive` columns, by default all, say whether seeds change anything.
    """
    by_split: dict[str, dict[int, list[list[float]]]] = {}
    for cloth, number in sorted(columns[0]):
        of_split = by_split.setdefault(cloth, {}).setdefault(split_of(number), [])
        of_split.append([column[cloth, number] for column in columns])
    by_cloth = {cloth: _units(list(splits.values())) for cloth, splits in by_split.items()}
    if min(map(len, by_cloth.values())) > 1 and not all(_constant(rows, decisive) for rows in by_cloth.values()):
        return list(by_cloth.values())
    return [[np.mean(rows, axis=0).tolist() for rows in by_cloth.values()]]


def _units(splits: list[list[list[float]]]) -> list[list[float]]:
    """Units of a cloth: its seeds, or its splits where there are several, each with its mean over seeds."""
    return splits[0] if len(splits) == 1 else [np.mean(seeds, axis=0).tolist() for seeds in splits]


def _constant(rows: list[list[float]], decisive: int | None) -> bool:
    """Whether seeds change nothing in the first columns, up to rounding."""
    shown = np.array(rows)[:, :decisive]
    return bool(np.allclose(shown, shown[0], rtol=1e-6, atol=0))
