"""Which silhouettes train and which test."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from cusick_bench.datasets.errors import DataError
from cusick_bench.datasets.published import CLOTHS
from cusick_bench.sim.errors import did_you_mean

LEAVE_ONE_OUT = "leave-one-sample-out"
PROTOCOLS = ("paper", LEAVE_ONE_OUT)


@dataclass(frozen=True)
class Split:
    """Which rows of the index train and which test.

    Attributes:
        cloth: Set that is split.
        train, test: Rows of the index.
    """

    cloth: str
    train: tuple[int, ...]
    test: tuple[int, ...]


def split_rows(
    table: pd.DataFrame, protocol: str, cloths: Sequence[str] | None, generator: np.random.Generator | None
) -> list[Split]:
    """Splits the samples of each cloth; see `DrapeDataset.split`.

    Args:
        table: Index of a data set.
        protocol: One of `PROTOCOLS`.
        cloths: Set or sets to split; None for all that the protocol is for.
        generator: Draws the training sample of sets that have no published one.

    Returns:
        The splits.
    """
    if protocol not in PROTOCOLS:
        raise DataError(f"unknown split {protocol!r}", remedy=f"use one of {', '.join(PROTOCOLS)}")
    present = list(dict.fromkeys(table["cloth"]))
    every = paper_cloths(present) if protocol == "paper" else present
    chosen = every if cloths is None else [cloths] if isinstance(cloths, str) else list(dict.fromkeys(cloths))
    unknown = [cloth for cloth in chosen if cloth not in present]
    if unknown:
        hint = did_you_mean(unknown[0], present)
        raise DataError(f"unknown cloth {', '.join(unknown)}", remedy=f"{hint}use one of {', '.join(present)}")
    if protocol == "paper":
        sides = table["side"].tolist()
        return [_paper_split(cloth, _samples(table, cloth), sides, generator) for cloth in chosen]
    return [split for cloth in chosen for split in _leave_one_out(cloth, _samples(table, cloth))]


def left_out_sample(table: pd.DataFrame, protocol: str, test: Sequence[int]) -> int | None:
    """Number of the sample that a split leaves out.

    Args:
        table: Index of a data set.
        protocol: How the samples were split.
        test: Rows of the index that test.

    Returns:
        The sample's number within its cloth, as names of files have it; None where samples are not left out in turn.
    """
    return int(table["sample"].iloc[test[0]]) if protocol == LEAVE_ONE_OUT and test else None


def paper_cloths(present: Sequence[str]) -> list[str]:
    """Sets that the paper's split is for: the named ones if there are any, else all.

    Args:
        present: Names of a data set's sets.

    Returns:
        The names.
    """
    return [cloth for cloth in present if cloth in CLOTHS] or list(present)


def _samples(table: pd.DataFrame, cloth: str) -> dict[int, tuple[int, ...]]:
    """Rows of each sample."""
    groups: dict[int, tuple[int, ...]] = {}
    for row, (owner, sample) in enumerate(zip(table["cloth"], table["sample"], strict=True)):
        if owner == cloth:
            groups[int(sample)] = (*groups.get(int(sample), ()), row)
    if len(groups) < 2:
        raise DataError(
            f"{cloth} must have at least 2 samples to be split, has {len(groups)}", remedy="choose another cloth"
        )
    return groups


def _paper_split(
    cloth: str, samples: dict[int, tuple[int, ...]], sides: Sequence[str], generator: np.random.Generator | None
) -> Split:
    """The first row of every sample; test rows show the training row's face if the sample has it."""
    numbers = sorted(samples)
    train = numbers[0] if generator is None else int(generator.choice(numbers))
    if cloth in CLOTHS and CLOTHS[cloth].training_sample in samples:
        train = CLOTHS[cloth].training_sample
    side = sides[samples[train][0]]
    tests = [samples[number] for number in numbers if number != train]
    return Split(
        cloth,
        samples[train][:1],
        tuple(next((row for row in rows if sides[row] == side), rows[0]) for rows in tests),
    )


def _leave_one_out(cloth: str, samples: dict[int, tuple[int, ...]]) -> list[Split]:
    return [
        Split(cloth, tuple(row for number in samples if number != out for row in samples[number]), samples[out])
        for out in samples
    ]
