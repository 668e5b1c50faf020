"""Learning curves: fits of one, two, four, ... samples of a cloth, scored on the same unseen samples.

The unseen samples are spread evenly over all samples of a cloth, since the last ones alone may come from another piece
of cloth, or another day. Of the others the first ones are fitted, with one silhouette each. All of these show the same
face, since a fit learns from one face; samples with pictures of the other face only are chosen as unseen first.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from cusick_bench.datasets import DrapeDataset
from cusick_bench.datasets.splits import Split
from cusick_bench.leaderboard.bootstrap import Estimate, cell_values, estimate, mean
from cusick_bench.leaderboard.cells.loading import Cells
from cusick_bench.leaderboard.cells.plausible import largest
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.leaderboard.stiffness import stiffness_scores
from cusick_bench.metrics.found_stiffness import FoundStiffness
from cusick_bench.solvers.base import Solver

METRICS = ("test_mse", "test_energy_distance", "test_dc_crps", "test_dc_cover_50", "test_dc_cover_90")
"""Columns of `Cells.table` that a curve shows."""
USUAL_UNSEEN = 4
"""Number of samples that no fit sees, where the name of a split says nothing of it."""
_SPLIT = re.compile(r"first-(\d+)(?:-unseen-\d+)?")


@dataclass(frozen=True)
class LearningStep:
    """Scores of a solver for one number of samples, over cloths and seeds.

    Attributes:
        solver: Name with options.
        samples: Training samples of each fit.
        cells: Number of fits.
        metrics: Means of `METRICS` with bootstrap intervals over cells; NaN where a solver has none.
        interval_factor: Half width of the 90 % interval of bending stiffness as a factor; NaN without a posterior.
        error_factor: exp(mean |log(found / true)|) of bending stiffness; NaN where the truth is not known.
        coverage: Share of the 90 % intervals of bending stiffness that hold the truth; NaN where there are none.
    """

    solver: str
    samples: int
    cells: int
    metrics: dict[str, Estimate]
    interval_factor: float
    error_factor: float
    coverage: float


def learning_splits(
    dataset: DrapeDataset, cloths: Sequence[str] | None, samples: Sequence[int], unseen: int
) -> dict[int, list[Split]]:
    """Splits for every number of training samples.

    Args:
        dataset: The data set.
        cloths: Cloths; None for those of the split `paper`.
        samples: Numbers of training samples.
        unseen: Number of samples that no fit sees.

    Returns:
        A split a cloth for each number.

    Raises:
        LeaderboardError: A cloth has too few samples.
        DataError: An unknown cloth.
    """
    found: dict[int, list[Split]] = {count: [] for count in sorted(set(samples))}
    for split in dataset.split("paper", cloths):
        rows = (split.train[0], *split.test)  # one silhouette a sample
        train, test = _dealt(dataset.index.loc[list(rows), "side"].astype(str).tolist(), unseen)
        if len(test) < unseen:
            raise LeaderboardError(
                f"{split.cloth} has {len(rows)} samples, of which one trains at least, too few for {unseen} unseen; "
                "give fewer unseen ones, or other cloths"
            )
        if max(found) > len(train):
            raise LeaderboardError(
                f"{split.cloth} has {len(rows)} samples, of which {len(train)} show the face that is fitted and are "
                f"none of the {unseen} unseen, too few to learn from {max(found)}; give smaller numbers of samples or "
                "fewer unseen ones"
            )
        for count, splits in found.items():
            splits.append(Split(split.cloth, tuple(rows[i] for i in train[:count]), tuple(rows[i] for i in test)))
    return found


def _dealt(sides: Sequence[str], unseen: int) -> tuple[list[int], list[int]]:
    """Which samples may train, the first one first, and which are unseen."""
    alike = [number for number, side in enumerate(sides) if side == sides[0]]
    turned = [number for number in range(len(sides)) if number not in alike][:unseen]
    count = unseen - len(turned)
    steps = (np.arange(count) + 0.5) * (len(alike) - 1) / max(count, 1)
    held = {alike[1 + int(step)] for step in steps if len(alike) > 1}
    return [number for number in alike if number not in held], sorted({*held, *turned})


def numbers_without_more(solver: Solver, samples: Sequence[int]) -> list[int]:
    """Numbers of training samples of which a solver uses no more than of a smaller one, so that its fits are the same.

    Args:
        solver: The solver.
        samples: Numbers of training samples.

    Returns:
        Those of them, in order.
    """
    counts = sorted(set(samples))
    used = [solver.samples_used(count) for count in counts]
    return [count for number, count in enumerate(counts) if used[number] in used[:number]]


def learning_curve(cells: Cells, *, seed: int = 0) -> list[LearningStep]:
    """Sums up finished fits.

    Args:
        cells: Cells of several numbers of training samples.
        seed: Seed of the bootstrap.

    Returns:
        A step for each solver and number of samples, in this order.
    """
    generator, steps = np.random.default_rng(seed), []
    table = cells.table.assign(samples=trained_on(cells.table))
    for solver, samples in sorted(set(zip(table["solver"], table["samples"], strict=True))):
        part = table.loc[(table["solver"] == solver) & (table["samples"] == samples)]
        known = part.get("stiffness", [])
        interval, error, _, coverage = stiffness_scores(one for one in known if isinstance(one, FoundStiffness))
        metrics = {name: _estimate(part, name, generator) for name in METRICS}
        steps.append(LearningStep(str(solver), int(samples), len(part), metrics, interval, error, coverage))
    return steps


def split_name(samples: int, unseen: int = USUAL_UNSEEN) -> str:
    """Name of the split of a learning curve; another number of unseen samples makes another split.

    Args:
        samples: Number of training samples.
        unseen: Number of samples that no fit sees.

    Returns:
        Such as `first-4`, or `first-4-unseen-2`.
    """
    return f"first-{samples}" + ("" if unseen == USUAL_UNSEEN else f"-unseen-{unseen}")


def samples_of_split(name: str) -> int | None:
    """Number of training samples of a learning curve's split.

    Args:
        name: Name of a split.

    Returns:
        The number; None for any other split.
    """
    found = _SPLIT.fullmatch(name)
    return int(found[1]) if found else None


def trained_on(table: pd.DataFrame) -> pd.Series:
    """Number of training samples of each cell.

    Args:
        table: `Cells.table` of cells whose protocol is `first-N`.

    Returns:
        A number a row.

    Raises:
        LeaderboardError: A cell of another protocol.
    """
    names = table["protocol"].astype(str).tolist()
    found = [samples_of_split(name) for name in names]
    if None in found:
        raise LeaderboardError(f"cells of the protocol {names[0]!r} are no learning curve; see learning-curve")
    return pd.Series(found, index=table.index, dtype=int)


def _estimate(part: pd.DataFrame, name: str, generator: np.random.Generator) -> Estimate:
    values = cell_values(part, name)
    return estimate(values, mean, generator, largest(name)) if values else Estimate(np.nan, np.nan, np.nan)
