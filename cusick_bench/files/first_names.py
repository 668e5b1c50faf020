"""Names in messages: the first few of many."""

from collections.abc import Sequence


def first_names(names: Sequence[str], most: int = 3) -> str:
    """The first of several names, as a list in words.

    Args:
        names: The names.
        most: Number of names that are shown.

    Returns:
        `a, b, c`, with `, ...` where there are more.
    """
    return ", ".join(names[:most]) + (", ..." if len(names) > most else "")
