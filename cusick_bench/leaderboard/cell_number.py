"""Numbers of cells among those of one method and cloth: the seed, and where samples are left out in turn, the split."""

SEEDS = 10**18
"""Numbers of the cells of one split, since seeds have 18 digits at most: number = seed + SEEDS x split."""


def split_of(number: int) -> int:
    """Which of its cloth's splits a cell is of, where samples are left out in turn.

    Args:
        number: Number of the cell.

    Returns:
        The number of the split; 0 where a cloth has one split.
    """
    return number // SEEDS
