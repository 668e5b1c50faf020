"""What the pictures of a folder show, by their names: drapes, the board on the plate, held boards, the bare plate."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cusick_bench.files.hidden import is_hidden
from cusick_bench.photographs.errors import BadPhotograph
from cusick_bench.photographs.reading import SUFFIXES, UNREAD_SUFFIXES

_NUMBERS = {
    name: re.compile(rf"{name}[ _-]*(\d{{1,18}})(?!\d)", re.IGNORECASE) for name in ("fabric", "sample", "capture")
}
_RULE = "Fabric_1_Sample_2_Capture_1.jpg, or Fabric 1/Sample_2_Capture_1.jpg"
_MOST_FILES = 20_000


@dataclass(frozen=True, order=True)
class DrapePicture:
    """A photograph of a drape.

    Attributes:
        fabric, sample, capture: Its numbers; capture 1 where its name has none of a capture.
        path: Its file.
    """

    fabric: int
    sample: int
    capture: int
    path: Path

    @property
    def name(self) -> str:
        """Name of its silhouette, without suffix."""
        return f"Fabric_{self.fabric}_Sample_{self.sample}_Capture_{self.capture}"


@dataclass(frozen=True)
class Pictures:
    """Photographs of a folder.

    Attributes:
        drapes: Sorted by fabric, sample, capture.
        board_on_plate: The board on the plate, None if there is none.
        boards_held: The board at other angles.
        plate: The bare plate, None if there is none.
    """

    drapes: tuple[DrapePicture, ...]
    board_on_plate: Path | None
    boards_held: tuple[Path, ...]
    plate: Path | None


def find_pictures(folder: Path) -> Pictures:
    """Sorts the pictures of a folder and its subfolders.

    Args:
        folder: The folder.

    Returns:
        What each picture shows.

    Raises:
        BadPhotograph: No folder, one that cannot be read or is a link, no pictures of drapes, a format that is not
            read, a name that says nothing or the same as another, or nothing to calibrate with.
    """
    if not folder.is_dir():
        raise BadPhotograph("is no folder", where=folder, remedy="give the folder of the photographs", kind="no-folder")
    drapes: dict[tuple[int, int, int], DrapePicture] = {}
    others: dict[str, list[Path]] = {"board-plane": [], "board": [], "plate": []}
    for path in _files(folder):
        stem = path.stem.lower().replace("_", "-").replace(" ", "-")
        kind = next((kind for kind in others if stem.startswith(kind)), None)
        if kind:
            others[kind].append(path)
            continue
        drape = _drape(path, folder)
        key = (drape.fabric, drape.sample, drape.capture)
        if key in drapes:
            raise BadPhotograph(
                f"is {drape.name}, as {drapes[key].path} is",
                where=path,
                remedy="give every picture its own fabric, sample and capture",
                kind="duplicate-name",
            )
        drapes[key] = drape
    if not drapes:
        raise BadPhotograph(
            "holds no photographs of drapes", where=folder, remedy=f"name them as {_RULE}", kind="no-pictures"
        )
    _require_ruler(folder, others)
    return Pictures(
        tuple(sorted(drapes.values())),
        next(iter(others["board-plane"]), None),
        tuple(others["board"]),
        next(iter(others["plate"]), None),
    )


def _require_ruler(folder: Path, others: Mapping[str, Sequence[Path]]) -> None:
    """Refuses a folder without a picture to calibrate with, or with several of one kind."""
    for kind in ("board-plane", "plate"):
        if len(others[kind]) > 1:
            raise BadPhotograph(
                f"{len(others[kind])} pictures are called {kind}",
                where=folder,
                remedy="keep one, and one folder for each place of the camera",
                kind="duplicate-name",
            )
    if others["board"] and not others["board-plane"]:
        raise BadPhotograph(
            "holds pictures of the board held at angles, but none of the board on the plate (board-plane.jpg), without "
            "which they are of no use",
            where=folder,
            remedy="take one with the camera where it was, or remove the others",
            kind="no-ruler",
        )
    if not others["board-plane"] and not others["plate"]:
        raise BadPhotograph(
            "holds no ruler: neither board-plane.jpg (the printed board on the plate) nor plate.jpg (the bare plate)",
            where=folder,
            remedy="take one with the camera where it was, see docs/drape-meter.md; silhouettes, which need none, "
            "must be square pictures",
            kind="no-ruler",
        )


def _files(folder: Path) -> list[Path]:
    found: list[Path] = []
    for place, folders, files in os.walk(folder, onerror=_refuse_unreadable):
        folders[:] = sorted(name for name in folders if not is_hidden(name))
        _require_no_links(Path(place), folders)
        shown = sorted(name for name in files if not name.startswith("."))  # macOS puts ._NAME beside NAME
        read = [name for name in shown if Path(name).suffix.lower() in SUFFIXES]
        _require_read(Path(place), shown, read)
        found += [Path(place) / name for name in read]
        if len(found) > _MOST_FILES:
            raise BadPhotograph(
                f"holds more than {_MOST_FILES} pictures", where=folder, remedy="give a smaller folder", kind="too-many"
            )
    return found


def _refuse_unreadable(error: OSError) -> None:
    """Refuses a folder that cannot be read, instead of leaving its pictures out."""
    raise BadPhotograph(
        f"folder cannot be read ({error.strerror})",
        where=error.filename,
        remedy="change its mode, or remove it",
        kind="no-permission",
    ) from error


def _require_no_links(place: Path, folders: Sequence[str]) -> None:
    """Refuses a link to a folder, whose pictures would be left out."""
    for name in folders:
        if (place / name).is_symlink():
            raise BadPhotograph(
                "is a link to a folder, which is not followed",
                where=place / name,
                remedy="copy the folder to this place, or remove the link",
                kind="outside-link",
            )


def _require_read(place: Path, shown: list[str], read: list[str]) -> None:
    """Refuses a picture of another format, unless one of the same name can be read, as cameras write beside it."""
    stems = {Path(name).stem for name in read}
    for name in shown:
        if Path(name).suffix.lower() in UNREAD_SUFFIXES and Path(name).stem not in stems:
            raise BadPhotograph(
                f"is a picture in the format {Path(name).suffix[1:].upper()}, which is not read",
                where=place / name,
                remedy="export it as JPEG or PNG, unscaled and not cropped; phones can be set to take JPEG",
                kind="unreadable-photograph",
            )


def _require_one_label(path: Path, folder: Path, found: Mapping[str, Sequence[str]]) -> None:
    """Refuses a picture that lies in the folder of another fabric or sample than its name says."""
    for name in ("fabric", "sample"):
        for part in path.relative_to(folder).parts[:-1]:
            number = _NUMBERS[name].fullmatch(part)
            if number and int(number[1]) != int(found[name][-1]):
                raise BadPhotograph(
                    f"lies in the folder of {name} {int(number[1])}, and its name says {name} {int(found[name][-1])}",
                    where=path,
                    remedy="move or rename it",
                    kind="unknown-name",
                )


def _drape(path: Path, folder: Path) -> DrapePicture:
    text = str(path.relative_to(folder))
    found = {name: pattern.findall(text) for name, pattern in _NUMBERS.items()}
    missing = [name for name in ("fabric", "sample") if not found[name]]
    if missing:
        raise BadPhotograph(
            f"its name does not say which {' and '.join(missing)} it shows",
            where=path,
            remedy=f"name it as {_RULE}; pictures of the board begin with board, of the bare plate with plate",
            kind="unknown-name",
        )
    _require_one_label(path, folder, found)
    numbers = (int(found["fabric"][-1]), int(found["sample"][-1]), int((found["capture"] or ["1"])[-1]))
    if 0 in numbers:
        raise BadPhotograph(
            "numbers of fabric, sample and capture begin at 1, got 0", where=path, remedy="rename the pictures",
            kind="unknown-name",
        )  # fmt: skip
    return DrapePicture(*numbers, path)
