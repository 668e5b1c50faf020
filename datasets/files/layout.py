"""Finds silhouettes and meshes in a folder with the public release's layout, or a part of it.

The root may be the release, its `data` folder, one fabric's folder or a folder in there, or hold one fabric. What its
files show is said by their names and folders (`entry`).
"""

import os
import re
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from cusick_bench.datasets.errors import DataError, DataNotFound
from cusick_bench.datasets.files import fabrics, image, protocol
from cusick_bench.datasets.files.entry import Entry, has_zero, is_home, parse_entry
from cusick_bench.datasets.irregularity import Irregularity
from cusick_bench.files.first_names import first_names
from cusick_bench.files.hidden import is_hidden
from cusick_bench.sim.cloth import obj

_DATA = "data"  # folder of the fabrics, in any case
_MAXIMUM_FILES = 200_000
_SIDE_FILES = re.compile(
    r"(readme|licen[cs]e|citation).*|fabrics\.csv|(protocol|sha256|croissant|truth|manifest)\.json|check_.*\.jpg|weights\.csv",
    re.I,
)
NUMBER_ZERO = "number-zero"


@dataclass(frozen=True)
class Layout:
    """Files of a folder.

    Attributes:
        root: The folder, resolved.
        silhouettes, meshes: Sorted by cloth, sample, capture, observation.
        unused: Other files, relative paths; tables too that lie elsewhere than `beside` looks.
        folders: Folders that hold silhouettes or meshes, or folders of these, relative paths.
        problems: What could not be looked at.
    """

    root: Path
    silhouettes: tuple[Entry, ...]
    meshes: tuple[Entry, ...]
    unused: tuple[str, ...]
    folders: tuple[str, ...]
    problems: tuple[Irregularity, ...]

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of `fabrics` (of named sets where there are no others), `samples` (a series over time counting for
        itself), `silhouettes` (copies in named sets left out) and `meshes` (files).
        """
        captures = [entry for entry in self.silhouettes if not entry.is_named] or self.silhouettes
        return {
            "fabrics": len({fabrics.fabric_name(entry.fabric, entry.cloth) for entry in captures}),
            "samples": len({(entry.cloth, entry.sample) for entry in captures}),
            "silhouettes": len(captures),
            "meshes": len(self.meshes),
        }

    def beside(self, name: str) -> Path | None:
        """Finds a table that belongs to the data, as the function `beside` does.

        Args:
            name: File name of the table, in lower case.

        Returns:
            Its path; None if there is none.
        """
        return beside(self.root, name)

    def path_of(self, name: str) -> str:
        """Where a table that belongs to the data lies.

        Args:
            name: File name of the table, in lower case.

        Returns:
            Its path, relative to the root where it lies within; its name where there is none.
        """
        found = self.beside(name)
        if found is None:
            return name
        return found.relative_to(self.root).as_posix() if found.is_relative_to(self.root) else str(found)


def beside(root: Path, name: str) -> Path | None:
    """Finds a table that belongs to the data: in the root, in its `data` folder, or above a data folder, a fabric's, or
    one of silhouettes, meshes or a sample.

    Args:
        root: Folder of the data set, resolved.
        name: File name of the table, in lower case. It and the folder's name are found in other cases too, as on file
            systems that know none.

    Returns:
        Its path; None if there is none.
    """
    places, top = [root, _in_any_case(root, _DATA)], root
    while top.name.lower() == _DATA or is_home(top.name):
        top = top.parent
        places.append(top)
    return next((found for place in places if place is not None and (found := _in_any_case(place, name))), None)


def _in_any_case(place: Path, name: str) -> Path | None:
    """A file or folder in a folder, by its name in lower case."""
    if os.path.lexists(place / name):
        return place / name
    with suppress(OSError):  # no such folder, or it may not be read
        return next((place / other for other in sorted(os.listdir(place)) if other.lower() == name), None)
    return None


def inside_root(root: Path, relative: str) -> Path:
    """Finds a file of the data set by its relative path.

    Args:
        root: Folder of the data set, resolved.
        relative: Path relative to it.

    Returns:
        The resolved path.

    Raises:
        DataError: The path leads out of the root.
    """
    path = (root / relative).resolve()
    if not path.is_relative_to(root):
        raise DataError(f"path must stay within {root}", where=relative, remedy="remove it", kind="outside-link")
    return path


def scan(root: str | Path) -> Layout:
    """Lists a folder's silhouettes and meshes; links are not followed out of it.

    Args:
        root: The folder.

    Returns:
        What lies in it.

    Raises:
        DataNotFound: No such folder, no permission, or nothing in it that looks like a silhouette.
    """
    try:
        folder = Path(root).expanduser().resolve()
    except (RuntimeError, OSError, ValueError) as error:  # no such home, a loop of links, a zero byte
        raise DataNotFound(
            f"no such folder ({error})", where=root, remedy="give the folder that holds `data`"
        ) from error
    if not folder.is_dir():
        what = "is a file, not a folder" if folder.exists() else "no such folder"
        raise DataNotFound(what, where=root, remedy="give the folder that holds `data` or `Fabric N`")
    if not os.access(folder, os.R_OK | os.X_OK):
        raise DataNotFound("may not be read", where=folder, remedy="change its mode", kind="no-permission")
    problems: list[Irregularity] = []
    silhouettes, meshes, unused, tables = [], [], [], []
    for path in _files(folder, problems):
        name = path.name.lower()
        known = name.endswith(image.SUFFIXES + obj.SUFFIXES)
        entry = parse_entry(folder, path) if known else None
        if known and has_zero(folder, path, entry):
            where = path.relative_to(folder).as_posix()
            problems.append(Irregularity(where, NUMBER_ZERO, "a number is 0, and numbers begin at 1"))
        elif entry is None:
            if name in (fabrics.FILE, protocol.FILE):
                tables.append(path)
            elif not _SIDE_FILES.fullmatch(path.name):
                unused.append(path.relative_to(folder).as_posix())
        elif name.endswith(image.SUFFIXES):
            silhouettes.append(entry)
        else:
            meshes.append(entry)
    if not silhouettes and not problems:
        raise _no_silhouettes(folder, unused)
    used = {parent for entry in (*silhouettes, *meshes) for parent in Path(entry.path).parents if parent.name}
    layout = Layout(
        folder,
        tuple(sorted(silhouettes, key=_order)),
        tuple(sorted(meshes, key=_order)),
        (),
        tuple(sorted(parent.as_posix() for parent in used)),
        tuple(problems),
    )
    for path in tables:
        read = layout.beside(path.name.lower())
        if read is None or read.parent != path.parent:
            unused.append(path.relative_to(folder).as_posix())
    return replace(layout, unused=tuple(sorted(unused)))


def _no_silhouettes(folder: Path, unused: list[str]) -> DataNotFound:
    """What is said of a folder without silhouettes; pictures that are not read for their format or name are named."""
    unread = sorted(path for path in unused if path.lower().endswith(image.UNREAD_SUFFIXES))
    if unread:
        formats = ", ".join(sorted({Path(path).suffix.lower() for path in unread}))
        return DataNotFound(
            f"holds no silhouettes in a format that is read, but pictures as {formats}: {first_names(unread)}",
            where=folder,
            remedy="save them as PNG, named e.g. `data/Fabric 2/silhouettes/Fabric_2_Sample_1_Capture_1.png`",
        )
    pictures = sorted(path for path in unused if path.lower().endswith(image.SUFFIXES))
    others = f", but pictures whose names and folders do not say so: {first_names(pictures)}"
    return DataNotFound(
        f"holds no silhouettes of numbered fabrics and samples{others}" if pictures else "holds no silhouettes",
        where=folder,
        remedy="expected e.g. `data/Fabric 2/silhouettes/Fabric_2_Sample_1_Capture_1.jpg`",
    )


def _files(folder: Path, problems: list[Irregularity]) -> list[Path]:
    """Files below a folder, hidden ones and links that lead out of it left aside."""

    def refused(error: OSError) -> None:
        where = Path(str(error.filename or folder))
        problems.append(Irregularity(where.relative_to(folder).as_posix(), "no-permission", "folder may not be read"))

    files: list[Path] = []
    for parent, folders, names in os.walk(folder, onerror=refused):
        for name in [name for name in folders if Path(parent, name).is_symlink()]:
            where = Path(parent, name).relative_to(folder).as_posix()
            problems.append(Irregularity(where, "outside-link", "linked folder is not followed"))
        folders[:] = sorted(name for name in folders if not is_hidden(name))
        for name in sorted(names):
            path = Path(parent, name)
            if name.startswith("."):
                continue
            if path.is_symlink() and not _inside(path, folder):
                where = path.relative_to(folder).as_posix()
                problems.append(Irregularity(where, "outside-link", "link leads out of the folder, or nowhere"))
            elif path.is_file():
                files.append(path)
        if len(files) > _MAXIMUM_FILES:
            raise DataNotFound(
                f"holds more than {_MAXIMUM_FILES} files", where=folder, remedy="give the folder of the data alone"
            )
    return files


def _inside(link: Path, folder: Path) -> bool:
    """Whether a link leads to a file in the folder; one that leads to itself does not."""
    try:
        return link.resolve(strict=True).is_relative_to(folder)
    except (OSError, RuntimeError):  # Python 3.11 tells of a loop of links as a RuntimeError
        return False


def _order(entry: Entry) -> tuple[bool, int, str, int, int, int, str]:
    return (
        entry.is_named,
        entry.fabric,
        entry.cloth,
        entry.sample,
        entry.capture,
        entry.observation,
        entry.path,
    )
