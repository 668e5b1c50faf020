"""Two runs side by side: how each method's errors and costs changed over the cells that both runs have.

Cells are paired by cloth, shared seed and the sample that is left out, if any (`gate.paired`), and all numbers are over
these pairs. The ratio this / other is the geometric mean over cloths with its 95 % bootstrap interval. Settings may
differ, since that is what is compared; data and split may not.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import nan

import numpy as np
import pandas as pd

from cusick_bench.files import parse_json
from cusick_bench.leaderboard.bootstrap import Estimate, cell_values
from cusick_bench.leaderboard.cells.loading import Cells, numbered_alike
from cusick_bench.leaderboard.cells.variants import flattened, method_label, of_boards, values_in_words, variants
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.leaderboard.gate.paired import blocks, compare
from cusick_bench.runner.environment import code_text

COMPARED = ("test_mse", "train_mse", "test_hausdorff_m", "spent_forward_equivalents", "spent_wall_seconds")
"""Metrics and costs that are compared, of which smaller is better."""

_LEVEL = 0.05  # of the paired test, of which only the ratio and its bootstrap interval are shown


@dataclass(frozen=True)
class Change:
    """Change of one number of one method.

    Attributes:
        before: Mean in the other run, over the pairs of cells.
        after: The same in this run.
        ratio: after / before with its 95 % interval; NaN where there is nothing to divide by.
    """

    before: float
    after: float
    ratio: Estimate

    @property
    def verdict(self) -> str:
        """ "better", "worse" or, where the interval holds 1 or is unknown, "same"."""
        if self.ratio.high < 1:
            return "better"
        return "worse" if self.ratio.low > 1 else "same"


@dataclass(frozen=True)
class MethodChange:
    """Changes of one method.

    Attributes:
        label: Name of the method.
        kind: "solver", "null" or "oracle".
        cells: Cells of this run that the other run has too: the shared seeds of a cloth; all where there are none.
        changes: By name of `COMPARED`, where both runs have numbers.
    """

    label: str
    kind: str
    cells: int
    changes: Mapping[str, Change]


@dataclass(frozen=True)
class TwoRuns:
    """Comparison of two runs.

    Attributes:
        methods: Methods that both have on shared cloths, solvers first; one that a single run has in several settings,
            or by several versions of the code, is compared with the other's in each.
        only_here: Names of methods of this run only.
        only_there: Names of methods of the other run only.
        differences: What else differs: name, value there, value here.
    """

    methods: Sequence[MethodChange]
    only_here: Sequence[str]
    only_there: Sequence[str]
    differences: Sequence[tuple[str, str, str]]


def compare_runs(here: Cells, there: Cells, *, seed: int = 0) -> TwoRuns:
    """Compares two results folders.

    Args:
        here: This run.
        there: The run to compare with.
        seed: Seed of the resamples.

    Returns:
        The changes from the other run to this one.

    Raises:
        LeaderboardError: The runs are of other data or splits, or share no method on a cloth.
    """
    _require_same_data(here, there)
    ours, theirs = map(_methods, numbered_alike([here.table, there.table]))
    generator, shared = np.random.default_rng(seed), list(_shared(ours, theirs))
    methods = [_change(max(pair, key=len), ours[pair[0]], theirs[pair[1]], generator) for pair in shared]
    methods = [one for one in methods if one.changes]
    if not methods:
        raise LeaderboardError(
            f"{here.folder} and {there.folder} share no method on any cloth, so nothing can be compared; "
            "run the same --solver and --cloth in both"
        )
    order, compared = {"solver": 0, "null": 1, "oracle": 2}, [set(side) for side in zip(*shared, strict=True)]
    return TwoRuns(
        sorted(methods, key=lambda one: (order.get(one.kind, 3), one.label)),
        [label for label in ours if label not in compared[0]],
        [label for label in theirs if label not in compared[1]],
        list(_differences(here, there)),
    )


def _require_same_data(here: Cells, there: Cells) -> None:
    for name, words in (("dataset_hash", "data"), ("protocol", "split")):
        ours, theirs = (set(cells.table[name].astype(str)) for cells in (here, there))
        if ours != theirs:
            one, other = (values_in_words(name, values) for values in (ours, theirs))
            raise LeaderboardError(
                f"runs to compare must be of the same {words}, got {one} in {here.folder} and {other} in "
                f"{there.folder}; run one of them again on the other's {words}"
            )


def _methods(table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Cells by method; of several data sets, or splits, each by itself: they pose other problems with equal numbers."""
    return {method_label(*name) + apart: group for apart, cells in of_boards(table) for name, group in variants(cells)}


def _shared(ours: Mapping[str, pd.DataFrame], theirs: Mapping[str, pd.DataFrame]) -> Iterator[tuple[str, str]]:
    """Names of a method here and there: the same, or where one run alone has it in several settings, or by several
    versions of the code, each of them beside the other run's only one.
    """
    yield from ((label, label) for label in ours if label in theirs)
    for label in ours:
        others = [other for other in theirs if _solver(theirs[other]) == _solver(ours[label])]
        if label not in theirs and len(others) == 1:
            yield label, others[0]
    for other in theirs:
        own = [label for label in ours if _solver(ours[label]) == _solver(theirs[other])]
        if other not in ours and len(own) == 1:
            yield own[0], other


def _solver(cells: pd.DataFrame) -> tuple[str, ...]:
    """Solver of the cells of a method, with the state of their data, whatever their name, and the split."""
    return tuple(str(cells[name].iloc[0]) for name in ("solver", "dataset_hash", "protocol"))


def _change(label: str, ours: pd.DataFrame, theirs: pd.DataFrame, generator: np.random.Generator) -> MethodChange:
    kind, ours, theirs = str(ours["kind"].iloc[0]), _paired(ours, theirs), _paired(theirs, ours)
    changes = {}
    for name in COMPARED:
        before, after = (cell_values(table, name) for table in (theirs, ours))
        if pairs := [(block.before, block.after) for cloth in blocks(before, after).values() for block in cloth]:
            ratio = Estimate(nan, nan, nan)
            if any(before.values()) and any(after.values()):
                ratio = compare(before, after, level=_LEVEL, generator=generator).ratio
            means = [float(np.mean([values.mean() for values in side])) for side in zip(*pairs, strict=True)]
            changes[name] = Change(means[0], means[1], ratio)
    return MethodChange(label, kind, len(ours), changes)


def _paired(own: pd.DataFrame, other: pd.DataFrame) -> pd.DataFrame:
    """Cells whose cloth and number (`repeats`) the other table has too; of a cloth without such, all."""
    theirs = set(zip(other["cloth"], other["repeat"], strict=True))
    shared = np.array([cell in theirs for cell in zip(own["cloth"], own["repeat"], strict=True)], dtype=bool)
    by_number = own["cloth"].isin(own.loc[shared, "cloth"].tolist())
    return own.loc[np.where(by_number, shared, own["cloth"].isin(other["cloth"].tolist()))]


def _differences(here: Cells, there: Cells) -> Iterator[tuple[str, str, str]]:
    """Settings and surroundings that are not the same in both."""
    ours, theirs = _surroundings(here), _surroundings(there)
    for name in dict.fromkeys([*ours, *theirs]):
        if ours.get(name, "") != theirs.get(name, ""):
            yield name, theirs.get(name, ""), ours.get(name, "")


def _surroundings(cells: Cells) -> dict[str, str]:
    values: dict[str, set[str]] = {}
    for settings in cells.table["settings"].unique():
        for name, value in flattened(parse_json(settings, "settings of a run's cells", remedy="run it again")).items():
            values.setdefault(name, set()).add(str(value))
    found = {name: ", ".join(sorted(some)) for name, some in values.items()}
    found["seeds"] = ", ".join(str(seed) for seed in sorted(set(cells.table["seed"])))
    found["processor"] = str(cells.run.get("processor", ""))
    found["code"] = code_text(cells.run)
    return found
