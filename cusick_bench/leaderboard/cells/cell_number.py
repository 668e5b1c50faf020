"""Numbers of cells among those of one method and cloth: the seed, and where samples are left out in turn, the split."""

from collections.abc import Sequence

import pandas as pd

SEEDS = 10**18
"""Numbers of the cells of one split, since seeds have 18 digits at most: number = seed + SEEDS x split."""

LEFT_OUT = "left_out"
"""Column of the number of the sample that was left out, where samples are left out in turn."""


def split_of(number: int) -> int:
    """Which of its cloth's splits a cell is of, where samples are left out in turn.

    Args:
        number: Number of the cell.

    Returns:
        The number of the split; 0 where a cloth has one split.
    """
    return number // SEEDS


def with_numbers(table: pd.DataFrame, numbers: Sequence[int]) -> pd.DataFrame:
    """A table of cells with their numbers.

    Args:
        table: A row a cell.
        numbers: The number of each row.

    Returns:
        The table with the column `repeat`, of Python's integers where some are too large for NumPy's.
    """
    return table.assign(repeat=pd.Series(numbers, table.index, dtype=object if max(numbers) >= SEEDS else int))
