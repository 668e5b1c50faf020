"""Data sets by name: where their files are, or how to get them."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cusick_bench.datasets.errors import DataNotFound
from cusick_bench.datasets.published import CITATION, HOME
from cusick_bench.sim.errors import did_you_mean


@dataclass(frozen=True)
class Registered:
    """A data set with a name.

    Attributes:
        folder: Gives the folder of its files on this machine; raises DataNotFound, with a remedy, if there is none.
        licence, citation, summary: Texts for people to read.
        source: Address or command by which the files are had.
    """

    folder: Callable[[], Path]
    licence: str
    citation: str
    summary: str
    source: str


def _synthetic() -> Path:
    folder = Path(__file__).resolve().parent / "synthetic"
    if not folder.is_dir():
        raise DataNotFound(
            "the shipped set is missing", where=folder, remedy="reinstall cusick-bench, or make the set again"
        )
    return folder


def _cusick() -> Path:
    folder = os.environ.get("CUSICK_DATA", "")
    if not folder:
        here = "; the folder of that name here is given as ./cusick" if Path("cusick").is_dir() else ""
        raise DataNotFound(
            "the public release has no licence and is not shipped",
            where="cusick",
            remedy=f"get it from its authors ({HOME}), "
            f"then set CUSICK_DATA to its folder, or give the folder instead of a name{here}",
        )
    return Path(folder)


REGISTRY = {
    "synthetic": Registered(
        _synthetic,
        "Apache-2.0",
        "this project",
        "simulated cloths with known stiffness; the default",
        "shipped; `cusick-bench data synthetic --out FOLDER` makes it again",
    ),
    "cusick": Registered(
        _cusick,
        "none stated, all rights reserved: bring your own copy",
        CITATION,
        "real cloths; folder in CUSICK_DATA",
        f"its authors, {HOME}",
    ),
}


def is_name(name_or_path: str | Path) -> bool:
    """Whether a registered name is given: a `Path` is always a folder, even one of that name.

    Args:
        name_or_path: A name, or a folder.

    Returns:
        Whether it is one of `REGISTRY`.
    """
    return isinstance(name_or_path, str) and name_or_path in REGISTRY


def folder_of(name_or_path: str | Path) -> Path:
    """Folder of a registered name, or the path itself.

    Args:
        name_or_path: A registered name, or a folder.

    Returns:
        The folder.

    Raises:
        DataNotFound: Neither a name nor a folder.
    """
    if is_name(name_or_path):
        return REGISTRY[str(name_or_path)].folder()
    try:
        folder = Path(name_or_path).expanduser()
        found = bool(str(name_or_path).strip()) and folder.exists()
    except (RuntimeError, OSError, ValueError):  # no such home, a loop of links, a zero byte
        folder, found = Path(), False
    if not found:
        raise DataNotFound(
            "no such folder and no registered data set",
            where=str(name_or_path),
            remedy=f"{did_you_mean(str(name_or_path), REGISTRY)}give a folder, or one of {', '.join(REGISTRY)}",
        )
    return folder


def registered_in(root: Path) -> Registered | None:
    """The registered data set whose files are in a folder; a folder that only has the name of one is not it.

    Args:
        root: Folder of a loaded data set, resolved.

    Returns:
        What is known of it; None where it is somebody's own data.
    """
    for registered in REGISTRY.values():
        try:
            folder = registered.folder().expanduser().resolve()
        except (DataNotFound, RuntimeError, OSError, ValueError):  # none, no such home, a loop of links, a zero byte
            continue
        if folder == root:
            return registered
    return None


def is_shipped(root: Path) -> bool:
    """Whether a loaded data set is the one that comes with the package, whose files are known by their checksums.

    Args:
        root: Folder of its files, resolved.

    Returns:
        False for a folder of the same name elsewhere.
    """
    return registered_in(root) is REGISTRY["synthetic"]
