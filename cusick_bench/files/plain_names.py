"""Names of files and folders that stand for things with names of their own, such as a data set's cloths."""

import re
from collections.abc import Iterable


def plain_names(names: Iterable[str], *, trimmed: bool = False) -> dict[str, str]:
    """A name for the file or folder of each thing: its own, with `_` for what a path had better not hold.

    Things whose names differ in that alone get numbers, in their order, so that none overwrites another's file.

    Args:
        names: Names of all things of that kind, whichever of them are asked for: their numbers depend on it.
        trimmed: Whether names begin and end with a letter or digit, too.

    Returns:
        Name of the file or folder, by the thing's own.
    """
    safe = {name: re.sub(r"[^\w.-]+", "_", name) for name in names}
    plain = {name: (file.strip("._") if trimmed else file.lstrip(".")) or "unnamed" for name, file in safe.items()}
    found = {name: file for name, file in plain.items() if name == file}  # first of all what needs no change
    for name, file in plain.items():
        if name not in found:
            number, free = 1, file
            while free in found.values():
                number += 1
                free = f"{file}_{number}"
            found[name] = free
    return found
