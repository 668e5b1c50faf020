"""Names of files and folders that stand for things with names of their own, such as a data set's cloths.

And of files that are being written: each process has its own, so that none writes into another one's.
"""

import os
import platform
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

_OF_MACHINE = re.compile(r"@[^@]*\.part")  # how the name of a part ends that says which machine writes it


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


def part_of(path: Path) -> Path:
    """The file in which this process writes what another one is to hold; it is then renamed to that.

    Args:
        path: The file that is to appear whole.

    Returns:
        A file beside it, whose name has the number of this process and the name of this machine.
    """
    return path.with_name(f"{path.name}.{os.getpid()}{_end_here()}")


def parts_left(folder: Path) -> Iterator[Path]:
    """Files that were left half written, in a folder into which no other process of this machine writes.

    Args:
        folder: The folder.

    Yields:
        Every part but those of other machines, which may be writing: locks need not hold across machines.
    """
    for path in folder.glob("*.part"):
        end = _OF_MACHINE.search(path.name)
        if end is None or end[0] == _end_here():
            yield path


def _end_here() -> str:
    return f"@{re.sub(r'[^0-9A-Za-z-]', '_', platform.node())}.part"
