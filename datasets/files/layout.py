"""Finds silhouettes and meshes in a folder with the public release's layout, or a part of it.

Known: `data/Fabric N/{silhouettes,meshes}/Fabric_N_Sample_S_Capture_C.*`; `data/Fabric N Observations/Sample S/...`
with `Obs_K` or `Observation_K`; named sets `bnn_image_gt/<cloth>/...sample_S_Upward_Drape_D.*`. The root may be the
release, its `data` folder, one fabric's folder or a folder in there, or hold one fabric. What a file is called decides
its capture; its folder decides its fabric and sample. Folders above the data decide nothing.
"""

import os
import re
import unicodedata
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from cusick_bench.datasets.errors import DataError, DataNotFound
from cusick_bench.datasets.files import fabrics, image, protocol
from cusick_bench.datasets.irregularity import Irregularity
from cusick_bench.files.first_names import first_names
from cusick_bench.sim.cloth import obj

NAMED_SETS = "bnn_image_gt"
NAMED_FACES = {1: "up", 2: "up", 3: "down", 4: "down"}
"""Face that lies up in each capture of a named set: that of its file's name, whatever a protocol says of captures."""
_DATA = "data"  # folder of the fabrics, in any case
_MAXIMUM_FILES = 200_000
_SIDE_FILES = re.compile(
    r"(readme|licen[cs]e|citation).*|fabrics\.csv|(protocol|sha256|croissant|truth|manifest)\.json|check_.*\.jpg|weights\.csv",
    re.I,
)
_DIGITS = r"(\d{1,18})(?!\d)"  # of a number in a name, which may be a date; all of them, within 64 bits
_FABRIC_FOLDER = re.compile(rf"fabric[ _-]*{_DIGITS}(?P<series>[ _-]*obs\w*)?", re.I)
_SAMPLE_FOLDER = re.compile(rf"sample[ _-]*{_DIGITS}", re.I)
_IMAGE_FOLDER = re.compile(r"sil(s|h\w*|ou\w*)?", re.I)  # however silhouettes are spelt, but not a folder of silk
_MESH_FOLDER = re.compile(r"mesh\w*", re.I)
_FABRIC = re.compile(rf"fabric[ _-]*{_DIGITS}", re.I)
_SAMPLE = re.compile(rf"sample[ _-]*{_DIGITS}", re.I)
_CAPTURE = re.compile(rf"capture[ _-]*{_DIGITS}", re.I)
_OBSERVATION = re.compile(rf"obs(?:ervation)?[ _-]*{_DIGITS}", re.I)
_FACE = re.compile(r"(up|down)ward", re.I)
_DRAPE = re.compile(rf"drape[ _-]*{_DIGITS}", re.I)
_ZERO = re.compile(r"((?:fabric|sample|capture|obs(?:ervation)?)[ _-]*)0+(?!\d)", re.I)
NUMBER_ZERO = "number-zero"


@dataclass(frozen=True)
class Entry:
    """One silhouette or mesh file, and what its folder and name say.

    Attributes:
        path: Relative to the root, with forward slashes.
        cloth: The set that it belongs to: `fabric_2`, `fabric_1_observations`, or the name of a named set.
        fabric: Fabric number; 0 in a named set.
        sample: Sample number.
        capture: Capture number; 0 if the name holds none. Named sets: 1, 2 upward, 3, 4 downward drape 1, 2.
        observation: Number within a series over time, else 0.
        file_fabric, file_sample: What the file's own name says; 0 if nothing.
    """

    path: str
    cloth: str
    fabric: int
    sample: int
    capture: int
    observation: int
    file_fabric: int
    file_sample: int

    @property
    def key(self) -> tuple[str, int, int, int]:
        """Key that image and mesh of one drape share."""
        return self.cloth, self.sample, self.capture, self.observation

    @property
    def is_named(self) -> bool:
        """Whether it belongs to a named set (images only) rather than to a fabric."""
        return self.fabric == 0


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
    while top.name.lower() == _DATA or any(pattern.fullmatch(top.name) for pattern in _HOMES):
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


def is_fabric_folder(name: str) -> bool:
    """Whether a folder is named as the layout names fabrics: `Fabric 7`, `Fabric 1 Observations`.

    Args:
        name: Name of the folder.

    Returns:
        True for such a name.
    """
    return re.fullmatch(r"Fabric \d+( Observations)?", name) is not None


def is_image_folder(name: str) -> bool:
    """Whether a folder is named as those of silhouettes are, however that is spelt.

    Args:
        name: Name of the folder.

    Returns:
        True for such a name, but not for `silk`.
    """
    return _IMAGE_FOLDER.fullmatch(name) is not None


def is_hidden(folder: str) -> bool:
    """Whether nothing in a folder belongs to the data: hidden ones, `__MACOSX`, and thumbnails of a Synology disk.

    Args:
        folder: Its name.

    Returns:
        True for such a folder.
    """
    return folder.startswith((".", "__")) or folder == "@eaDir"


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
        entry = _parse(folder, path) if known else None
        if known and _has_zero(folder, path, entry):
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
    """What is said of a folder without silhouettes; pictures in formats that are not read are named."""
    unread = sorted(path for path in unused if path.lower().endswith(image.UNREAD_SUFFIXES))
    if unread:
        formats = ", ".join(sorted({Path(path).suffix.lower() for path in unread}))
        return DataNotFound(
            f"holds no silhouettes in a format that is read, but pictures as {formats}: {first_names(unread)}",
            where=folder,
            remedy="save them as PNG, named e.g. `data/Fabric 2/silhouettes/Fabric_2_Sample_1_Capture_1.png`",
        )
    return DataNotFound(
        "holds no silhouettes",
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


def _parse(root: Path, path: Path) -> Entry | None:
    """Labels from a path, or None if it is not part of the layout."""
    inside = _deciding_folders(root, path)
    lower = [part.lower() for part in inside]
    stem = path.name.lower().removesuffix(".gz").rsplit(".", 1)[0]
    number = {name: _first(pattern, stem) for name, pattern in _PATTERNS.items()}
    sample_folder = next((m for part in reversed(inside) if (m := _SAMPLE_FOLDER.fullmatch(part))), None)
    sample = int(sample_folder[1]) if sample_folder else number["sample"]
    if NAMED_SETS in lower[:-1]:
        cloth = lower[lower.index(NAMED_SETS) + 1]
        return _named(path, root, unicodedata.normalize("NFC", cloth), stem, number)  # as keyboards write accents
    fabric_folder = next((m for part in reversed(inside) if (m := _FABRIC_FOLDER.fullmatch(part))), None)
    home = path.parent == root or any(pattern.fullmatch(inside[-1]) for pattern in _HOMES)
    fabric = int(fabric_folder[1]) if fabric_folder else number["fabric"]
    if not (home and fabric and sample):
        return None
    series = bool(fabric_folder and fabric_folder["series"])
    return Entry(
        path.relative_to(root).as_posix(),
        f"fabric_{fabric}_observations" if series else f"fabric_{fabric}",
        fabric,
        sample,
        1 if series else number["capture"],
        number["observation"],
        number["fabric"],
        number["sample"],
    )


def _deciding_folders(root: Path, path: Path) -> tuple[str, ...]:
    """Names of the folders that decide what a file shows: those below the root, and its own and its parent's where the
    root is a part of a data set rather than the folder of one.
    """
    below = path.relative_to(root).parts[:-1]
    if any(_FABRIC_FOLDER.fullmatch(name) for name in below):
        return below
    in_fabric = any(pattern.fullmatch(root.name) for pattern in (_IMAGE_FOLDER, _MESH_FOLDER, _SAMPLE_FOLDER))
    if in_fabric or root.parent.name.lower() == NAMED_SETS:
        return root.parent.name, root.name, *below
    return root.name, *below


def _has_zero(root: Path, path: Path, entry: Entry | None) -> bool:
    """Whether a file would be another entry, or one at all, if numbers of 0 in its name and folders were 1."""
    other_root = root.parent.parent / _one(root.parent.name) / _one(root.name)
    other = _parse(other_root, other_root / _one(path.relative_to(root).as_posix()))
    if other is None or entry is None:
        return other is not entry
    return (other.fabric, *other.key[1:]) != (entry.fabric, *entry.key[1:])


def _one(name: str) -> str:
    return _ZERO.sub(r"\g<1>1", name)


_HOMES = (_IMAGE_FOLDER, _MESH_FOLDER, _FABRIC_FOLDER, _SAMPLE_FOLDER)  # folders that may hold the files
_PATTERNS = {"fabric": _FABRIC, "sample": _SAMPLE, "capture": _CAPTURE, "observation": _OBSERVATION}


def _named(path: Path, root: Path, cloth: str, stem: str, number: dict[str, int]) -> Entry | None:
    face, drape = _FACE.search(stem), _first(_DRAPE, stem)
    if not number["sample"] or path.name.lower().endswith(obj.SUFFIXES):
        return None
    capture = drape + 2 * (face[1] == "down") if face and drape in (1, 2) else 0
    where = path.relative_to(root).as_posix()
    return Entry(where, cloth, 0, number["sample"], capture, number["observation"], 0, number["sample"])


def _first(pattern: re.Pattern[str], text: str) -> int:
    match = pattern.search(text)
    return int(match[1]) if match else 0


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
