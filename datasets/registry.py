"""Data sets by name, and any folder in the same layout."""

import os
import re
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from cusick_bench.datasets.dataset import DrapeDataset
from cusick_bench.datasets.errors import BadTable, DataError, DataNotFound
from cusick_bench.datasets.fabrics import FILE as FABRICS_FILE
from cusick_bench.datasets.fabrics import read_fabrics
from cusick_bench.datasets.index import CORRECTIONS, Progress, build_index, survey
from cusick_bench.datasets.layout import scan
from cusick_bench.datasets.measure import content_hash
from cusick_bench.datasets.protocol import FILE as PROTOCOL_FILE
from cusick_bench.datasets.protocol import Protocol, read_json_object, read_protocol
from cusick_bench.datasets.published import CITATION, HOME

CHECKSUMS = "sha256.json"
DEFAULT_CORRECTIONS = ("pairing", "rotation", "side")


@dataclass(frozen=True)
class Registered:
    """A data set with a name.

    Attributes:
        folder: Where its files are on this machine; raises DataNotFound, with a remedy, where they are not.
        licence, citation, summary: For people.
        source: Where the files are from, or to be had.
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
        raise DataNotFound(
            "the public release has no licence and is not shipped",
            where="cusick",
            remedy=f"get it from its authors ({HOME}), "
            "then set CUSICK_DATA to its folder, or give the folder instead of a name",
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


def folder_of(name_or_path: str | Path) -> Path:
    """Folder of a registered name, or the path itself.

    Raises:
        DataNotFound: Neither a name nor a folder.
    """
    if str(name_or_path) in REGISTRY:
        return REGISTRY[str(name_or_path)].folder()
    folder = Path(name_or_path).expanduser()
    if not folder.exists():
        raise DataNotFound(
            "no such folder and no registered data set",
            where=str(name_or_path),
            remedy=f"give a folder, or one of {', '.join(REGISTRY)}",
        )
    return folder


def load(
    name_or_path: str | Path,
    *,
    correct: Collection[str] | bool = DEFAULT_CORRECTIONS,
    fabrics_csv: str | Path | None = None,
    strict: bool = False,
    progress: Progress | None = None,
) -> DrapeDataset:
    """Loads a data set.

    Args:
        name_or_path: `synthetic`, `cusick` (in the folder that the environment variable CUSICK_DATA names), or a
            folder in the public release's layout.
        correct: Which known faults to correct; each correction is noted in the index. `pairing`: meshes go to the
            silhouettes that they fit. `rotation`: meshes are turned by quarter turns. `side`: faces are unknown
            where meshes contradict the capture numbers. `centre`: off-centre images are moved, so that scores
            differ from the paper's; not by default. True means all, False none.
        fabrics_csv: Table of areal densities and thicknesses; by default `fabrics.csv` beside the data.
        strict: Whether an image or mesh that cannot be used is an error now rather than when it is sampled.
        progress: Called with (files done, files) while the files are measured.

    Raises:
        DataError: Nothing to load, a malformed table, a shipped file that was changed, or with `strict` a bad file.
    """
    root = folder_of(name_or_path)
    wanted = _corrections(correct)
    layout = scan(root)
    if str(name_or_path) == "synthetic":
        verify_checksums(layout.root)
    table = Path(fabrics_csv) if fabrics_csv else layout.beside(FABRICS_FILE)
    fabrics = read_fabrics(table) if table else {}
    described = layout.beside(PROTOCOL_FILE)
    protocol = read_protocol(described) if described else Protocol()
    verified = str(name_or_path) == "synthetic"  # its meshes lie where they belong
    found = survey(layout, protocol, measure=strict or bool(wanted and not verified), progress=progress)
    if strict and found.faults:
        raise next(iter(found.faults.values()))
    name = str(name_or_path) if str(name_or_path) in REGISTRY else layout.root.name
    applied = () if verified else wanted
    return DrapeDataset(
        name, layout.root, protocol, applied, build_index(name, layout, protocol, fabrics, found, applied)
    )


def _corrections(correct: Collection[str] | bool) -> tuple[str, ...]:
    if isinstance(correct, bool):
        return CORRECTIONS if correct else ()
    names = [correct] if isinstance(correct, str) else list(correct)
    unknown = [name for name in names if name not in CORRECTIONS]
    if unknown:
        raise DataError(f"unknown correction {', '.join(unknown)}", remedy=f"use some of {', '.join(CORRECTIONS)}")
    return tuple(name for name in CORRECTIONS if name in names)


def verify_checksums(root: Path) -> None:
    """Checks every file that `sha256.json` lists.

    Raises:
        BadTable: No such list, or a malformed one.
        DataError: A file is missing or differs.
    """
    for name, what in changed_files(root):
        raise DataError(what, where=root / name, remedy="reinstall the data set", kind="checksum")


def changed_files(root: Path) -> Iterator[tuple[str, str]]:
    """Files that are not as `sha256.json` says, and what is wrong.

    Raises:
        BadTable: No such list, or a malformed one.
    """
    path = root / CHECKSUMS
    for name, digest in read_json_object(path, "checksum").items():
        inside = PurePosixPath(name)
        well_formed = isinstance(digest, str) and re.fullmatch(r"[0-9a-f]{64}", digest)
        if not well_formed or inside.is_absolute() or ".." in inside.parts or "\\" in name:
            raise BadTable(f"bad entry {name[:80]!r}", where=path, remedy="reinstall the data set", kind="checksum")
        file = root / inside
        if not file.is_file():
            yield name, "is missing"
        elif content_hash(file) != digest:
            yield name, "differs from its SHA-256"
