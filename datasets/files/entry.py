"""What the path of a silhouette or mesh says, in the public release's layout: fabric, sample, capture, observation.

Known: `data/Fabric N/{silhouettes,meshes}/Fabric_N_Sample_S_Capture_C.*`; `data/Fabric N Observations/Sample S/...`
with `Obs_K` or `Observation_K`; named sets `bnn_image_gt/<cloth>/...sample_S_Upward_Drape_D.*`. What a file is called
decides its capture; its folder decides its fabric and sample. Folders above the data decide nothing.
"""

import re
import unicodedata
from dataclasses import dataclass
from pathlib import Path

from cusick_bench.sim.cloth import obj

NAMED_SETS = "bnn_image_gt"
NAMED_FACES = {1: "up", 2: "up", 3: "down", 4: "down"}
"""Face that lies up in each capture of a named set: that of its file's name, whatever a protocol says of captures."""
_DIGITS = r"(\d{1,18})(?!\d)"  # of a number in a name, which may be a date; all of them, within 64 bits
_FABRIC_FOLDER = re.compile(rf"fabric[ _-]*{_DIGITS}(?P<series>[ _-]*obs\w*)?", re.I)
_IMAGE_FOLDER = re.compile(r"sil(s|h\w*|ou\w*)?", re.I)  # however silhouettes are spelt, but not a folder of silk
_MESH_FOLDER = re.compile(r"mesh\w*", re.I)
_FABRIC = re.compile(rf"fabric[ _-]*{_DIGITS}", re.I)
_SAMPLE = re.compile(rf"sample[ _-]*{_DIGITS}", re.I)
_CAPTURE = re.compile(rf"capture[ _-]*{_DIGITS}", re.I)
_OBSERVATION = re.compile(rf"obs(?:ervation)?[ _-]*{_DIGITS}", re.I)
_FACE = re.compile(r"(up|down)ward", re.I)
_DRAPE = re.compile(rf"drape[ _-]*{_DIGITS}", re.I)
_ZERO = re.compile(r"((?:fabric|sample|capture|obs(?:ervation)?)[ _-]*)0+(?!\d)", re.I)
_HOMES = (_IMAGE_FOLDER, _MESH_FOLDER, _FABRIC_FOLDER, _SAMPLE)  # folders that may hold the files
_PATTERNS = {"fabric": _FABRIC, "sample": _SAMPLE, "capture": _CAPTURE, "observation": _OBSERVATION}


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


def _deciding_folders(root: Path, path: Path) -> tuple[str, ...]:
    """Names of the folders that decide what a file shows: those below the root, and its own and its parent's where the
    root is a part of a data set rather than the folder of one.
    """
    below = path.relative_to(root).parts[:-1]
    if any(_FABRIC_FOLDER.fullmatch(name) for name in below):
        return below
    in_fabric = any(pattern.fullmatch(root.name) for pattern in (_IMAGE_FOLDER, _MESH_FOLDER, _SAMPLE))
    if in_fabric or root.parent.name.lower() == NAMED_SETS:
        return root.parent.name, root.name, *below
    return root.name, *below


def _numbered_from_1(name: str) -> str:
    """A path with 1 for each number of 0 in it."""
    return _ZERO.sub(r"\g<1>1", name)


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


def is_home(name: str) -> bool:
    """Whether a folder may hold silhouettes and meshes itself: a fabric's, a sample's, one of images or of meshes.

    Args:
        name: Name of the folder.

    Returns:
        True for such a name.
    """
    return any(pattern.fullmatch(name) for pattern in _HOMES)


def parse_entry(root: Path, path: Path) -> Entry | None:
    """What the path of a file says.

    Args:
        root: Folder of the data set, resolved.
        path: A silhouette or a mesh in it.

    Returns:
        The entry; None if the file is not part of the layout.
    """
    inside = _deciding_folders(root, path)
    lower = [part.lower() for part in inside]
    stem = path.name.lower().removesuffix(".gz").rsplit(".", 1)[0]
    number = {name: _first(pattern, stem) for name, pattern in _PATTERNS.items()}
    sample_folder = next((m for part in reversed(inside) if (m := _SAMPLE.fullmatch(part))), None)
    sample = int(sample_folder[1]) if sample_folder else number["sample"]
    if NAMED_SETS in lower[:-1]:
        cloth = lower[lower.index(NAMED_SETS) + 1]
        return _named(path, root, unicodedata.normalize("NFC", cloth), stem, number)  # as keyboards write accents
    fabric_folder = next((m for part in reversed(inside) if (m := _FABRIC_FOLDER.fullmatch(part))), None)
    home = path.parent == root or is_home(inside[-1])
    fabric = int(fabric_folder[1]) if fabric_folder else number["fabric"]
    if not (home and fabric and sample):
        return None
    series = bool(fabric_folder and fabric_folder["series"])
    return Entry(
        path.relative_to(root).as_posix(),
        f"fabric_{fabric}_observations" if series else f"fabric_{fabric}",
        fabric,
        sample,
        number["capture"] or int(series),
        number["observation"],
        number["fabric"],
        number["sample"],
    )


def has_zero(root: Path, path: Path, entry: Entry | None) -> bool:
    """Whether a file would be another entry, or one at all, if numbers of 0 in its name and folders were 1.

    Args:
        root: Folder of the data set, resolved.
        path: A silhouette or a mesh in it.
        entry: What `parse_entry` says of it.

    Returns:
        True where a 0 changes what the file is taken for.
    """
    other_root = root.parent.parent / _numbered_from_1(root.parent.name) / _numbered_from_1(root.name)
    other = parse_entry(other_root, other_root / _numbered_from_1(path.relative_to(root).as_posix()))
    if other is None or entry is None:
        return other is not entry
    return (other.fabric, *other.key[1:]) != (entry.fabric, *entry.key[1:])
