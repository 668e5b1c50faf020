"""Names of the folders in which documents and pages of a data set's fabrics lie."""

import re
from collections.abc import Sequence


def folder_names(cloths: Sequence[str]) -> dict[str, str]:
    """A folder for each cloth: its name, with `_` for what a path had better not hold.

    Cloths whose names differ in that alone get numbers, the same whichever of them are asked for.

    Args:
        cloths: All cloths of the data set.

    Returns:
        Name of the folder, by cloth.
    """
    plain = {name: re.sub(r"[^\w.-]+", "_", name) for name in cloths}
    names = {name: folder for name, folder in plain.items() if name == folder}  # first of all what needs no change
    for name, folder in plain.items():
        if name not in names:
            number, free = 1, folder
            while free in names.values():
                number += 1
                free = f"{folder}_{number}"
            names[name] = free
    return names
