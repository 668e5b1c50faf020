"""Has a solver become worse? A paired test of two runs over the cells that they share.

Cells are paired by cloth, by the sample that is left out where samples are left out in turn, and by the seeds that both
runs have; where they share none, by cloth and sample alone. For a cloth with values b (before) and a (after) the change
is

    d = (mean a - mean b) / mean of all of them,

a relative change, which has either sign equally often if nothing has changed. The test is about the mean of d over
these cloths. The number that is shown is the ratio after / before, its geometric mean over cloths: a value that is ten
times as large is "x 10", where d would be 1.6.

Two tests, chosen by the numbers of cells and comparisons and never by values. With many cells: the labels "before" and
"after" are permuted within each cloth (for a shared seed: their sign flipped), which is exact whatever the noise. With
so few that permutations cannot reach the level after correction for all comparisons, or with so many comparisons that
`PERMUTATIONS` random ones cannot: Student's t over the paired changes, each cloth counting alike however many of them
it has.

References:
    B. Phipson, G. K. Smyth. Permutation p-values should never be zero. Stat. Appl. Genet. Mol. Biol. 9, 2010.
    S. Holm. A simple sequentially rejective multiple test procedure. Scand. J. Stat. 6, 1979.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import comb, inf, isnan, log, nan

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy import stats

from cusick_bench.leaderboard.bootstrap import Estimate, Values, geometric_mean
from cusick_bench.leaderboard.cells.cell_number import SEEDS, split_of

PERMUTATIONS = 20_000
POWER = 0.8  # at which a change counts as detectable
_SPARE = 10  # number of permutations that the test needs, over the least number that can reach the level
_LEAST = 2.0  # number of random permutations, the run itself among them, that may be as extreme at the level
_LARGEST = 1e6  # largest ratio that is shown, for values that were 0
_ROUNDING = 1e-6  # largest relative change by the digits of a baseline and the arithmetic of another machine


@dataclass(frozen=True)
class Block:
    """Values whose labels may be exchanged: those of one shared seed, or all of a cloth.

    Attributes:
        before: Values of the baseline.
        after: Values of the run.
        split: Number of their split, where samples are left out in turn.
    """

    before: Float[ndarray, " b"]
    after: Float[ndarray, " a"]
    split: int = 0

    @property
    def arrangements(self) -> int:
        """Ways to give out the labels."""
        return comb(len(self.before) + len(self.after), len(self.before))


Blocks = Mapping[str, Sequence[Block]]  # by cloth


@dataclass(frozen=True)
class Comparison:
    """Change of one metric of one solver.

    Attributes:
        ratio: Geometric mean over the cloths of after / before, with its 95 % interval; above 1 is worse.
        change: The mean change that is tested, as a ratio: values of 0 and below weigh no more in it than others.
        p: Probability of as great a change if nothing has changed; NaN where cells are too few for any test.
        test: "permutation", "t" or "none".
        units: Paired values behind it.
        detectable: Ratio that would be found in four of five cases; infinite where none would, NaN where no test can
            be made.
    """

    ratio: Estimate
    change: float
    p: float
    test: str
    units: int
    detectable: float


def blocks(before: Values, after: Values) -> dict[str, list[Block]]:
    """Pairs the values of two runs, cloth by cloth.

    Seeds that change nothing within a cloth (within one of its splits), in either run, are one value, not many.

    Args:
        before: Values of the baseline by (cloth, seed).
        after: Values of the run.

    Returns:
        Blocks of each cloth.
    """
    found: dict[str, list[Block]] = {}
    for cloth in sorted({cloth for cloth, _ in before} & {cloth for cloth, _ in after}):
        old, new = ({number: one for (name, number), one in run.items() if name == cloth} for run in (before, after))
        if splits := sorted({split_of(number) for number in old} & {split_of(number) for number in new}):
            by_split = ((split, _of_seeds(_within(old, split), _within(new, split))) for split in splits)
            found[cloth] = [replace(block, split=split) for split, of_split in by_split for block in of_split]
        else:
            found[cloth] = _of_seeds(old, new)
    return found


def _within(values: Mapping[int, float], split: int) -> dict[int, float]:
    return {number: value for number, value in values.items() if split_of(number) == split}


def _of_seeds(old: Mapping[int, float], new: Mapping[int, float]) -> list[Block]:
    if _constant(old) and _constant(new):
        return [_block([next(iter(old.values()))], [next(iter(new.values()))])]
    if shared := sorted(old.keys() & new.keys()):
        return [_block([old[seed]], [new[seed]]) for seed in shared]
    return [_block(list(old.values()), list(new.values()))]


def compare(before: Values, after: Values, *, level: float, generator: np.random.Generator) -> Comparison:
    """Compares two runs of one solver in one metric, of which smaller is better.

    Args:
        before: Values of the baseline by (cloth, seed).
        after: Values of the run.
        level: One-sided level that the p-value has to be able to reach.
        generator: Source of permutations and of resamples.

    Returns:
        Change, p-value, and what could have been detected.
    """
    pairs = blocks(before, after)
    changes = _changes(pairs)
    ratio = geometric_mean(_log_ratios(pairs), generator)
    units = len(changes)
    observed = _statistic(pairs)
    change = _ratio(observed)
    arrangements = sum(log(block.arrangements) for cloth in pairs.values() for block in cloth)
    if arrangements >= log(_SPARE / level) and level * (1 + PERMUTATIONS) >= _LEAST:
        null = _permuted(pairs, generator)
        p = (1 + np.count_nonzero(null >= observed - _ROUNDING)) / (1 + PERMUTATIONS)
        freedom = sum(len(block.before) + len(block.after) - 1 for cloth in pairs.values() for block in cloth) - 1
        detectable = _ratio(float(np.std(null)) * _reach(level, freedom))
        return Comparison(ratio, change, float(p), "permutation", units, detectable)
    if units < 2:
        return Comparison(ratio, change, nan, "none", units, nan)
    weights = np.array([1 / (len(pairs) * len(pairs[cloth])) for cloth, _ in changes])
    error = float(np.std(list(changes.values()), ddof=1) * np.linalg.norm(weights))
    p = _student(observed, error, units - 1)
    return Comparison(ratio, change, p, "t", units, _ratio(error * _reach(level, units - 1)))


def holm(p_values: Sequence[float]) -> list[float]:
    """Holm's adjusted p-values; NaN, a comparison that could not be made, stays NaN and does not count.

    Args:
        p_values: Unadjusted p-values.

    Returns:
        Adjusted p-values in the same order.
    """
    made = [place for place, p in enumerate(p_values) if not isnan(p)]
    adjusted, running = [nan] * len(p_values), 0.0
    for rank, place in enumerate(sorted(made, key=lambda place: p_values[place])):
        running = max(running, min(1.0, (len(made) - rank) * p_values[place]))
        adjusted[place] = running
    return adjusted


def _block(before: list[float], after: list[float]) -> Block:
    return Block(np.array(before, dtype=np.float64), np.array(after, dtype=np.float64))


def _constant(values: Mapping[int, float]) -> bool:
    numbers = list(values.values())
    return bool(np.allclose(numbers, numbers[0], rtol=1e-6, atol=0))


def _scale(cloth: Sequence[Block]) -> float:
    """Mean of all values of a cloth, which no exchange of labels alters."""
    values = np.concatenate([np.concatenate([block.before, block.after]) for block in cloth])
    return float(np.abs(values).mean()) or 1.0


def _statistic(pairs: Blocks) -> float:
    scaled = [(cloth, _scale(cloth)) for cloth in pairs.values()]
    means = [np.mean([_change(block, scale) for block in cloth]) for cloth, scale in scaled]
    return float(np.mean(means)) if means else nan


def _changes(pairs: Blocks) -> dict[tuple[str, int], float]:
    """Relative change of every block, by cloth and place."""
    scales = {cloth: _scale(group) for cloth, group in pairs.items()}
    return {
        (cloth, place): _change(block, scales[cloth])
        for cloth, group in pairs.items()
        for place, block in enumerate(group)
    }


def _change(block: Block, scale: float) -> float:
    change = float(block.after.mean() - block.before.mean()) / scale
    return 0.0 if abs(change) < _ROUNDING else change


def _log_ratios(pairs: Blocks) -> dict[tuple[str, int], float]:
    """Logarithm of after / before of every block, by cloth and number of its split and place."""
    return {
        (cloth, SEEDS * block.split + place): _log_ratio(float(block.before.mean()), float(block.after.mean()))
        for cloth, group in pairs.items()
        for place, block in enumerate(group)
    }


def _log_ratio(before: float, after: float) -> float:
    """Logarithm of after / before; of a value that is or was 0, that of the largest ratio that is told."""
    if abs(after - before) <= _ROUNDING * max(abs(before), abs(after)):
        return 0.0
    if before <= 0 or after <= 0:
        return log(_LARGEST) if after > before else -log(_LARGEST)
    return max(-log(_LARGEST), min(log(_LARGEST), log(after / before)))


def _ratio(change: float) -> float:
    """The ratio a / b of two values whose relative change (a - b) / ((a + b) / 2) is given."""
    return (2 + change) / (2 - change) if change < 2 else inf


def _permuted(pairs: Blocks, generator: np.random.Generator) -> Float[ndarray, " permutations"]:
    """The statistic under random exchanges of labels."""
    total = np.zeros(PERMUTATIONS)
    for cloth in pairs.values():
        weight = 1 / (_scale(cloth) * len(cloth) * len(pairs))
        for block in cloth:
            values, count = np.concatenate([block.before, block.after]), len(block.before)
            order = generator.random((PERMUTATIONS, len(values))).argsort(axis=1)
            shuffled = values[order]
            total += weight * (shuffled[:, count:].mean(1) - shuffled[:, :count].mean(1))
    return total


def _student(change: float, error: float, freedom: int) -> float:
    """One-sided p-value; changes that are all alike, up to rounding, are no chance."""
    if error <= _ROUNDING:
        return 0.0 if change > _ROUNDING else 1.0
    return float(stats.t.sf(change / error, freedom))


def _reach(level: float, freedom: int) -> float:
    """Size of a change that is found with probability `POWER` [standard errors]."""
    return float(stats.t.isf(level, freedom) + stats.t.ppf(POWER, freedom))
