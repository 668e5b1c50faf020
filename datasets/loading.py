"""Loads a data set by its registered name, or from any folder in the same layout."""

import logging
import re
from collections.abc import Collection
from pathlib import Path

import pandas as pd

from cusick_bench.datasets.dataset import DrapeDataset
from cusick_bench.datasets.errors import DataError, DataNotFound
from cusick_bench.datasets.files.checksums import verify_checksums
from cusick_bench.datasets.files.fabrics import FILE as FABRICS_FILE
from cusick_bench.datasets.files.fabrics import read_fabrics
from cusick_bench.datasets.files.image import SUFFIXES, UNREAD_SUFFIXES
from cusick_bench.datasets.files.layout import NUMBER_ZERO, Layout, scan
from cusick_bench.datasets.files.protocol import FILE as PROTOCOL_FILE
from cusick_bench.datasets.files.protocol import Protocol, read_protocol
from cusick_bench.datasets.index import CORRECTIONS, Progress, Survey, build_index, survey
from cusick_bench.datasets.registry import folder_of, is_name, is_shipped
from cusick_bench.files.first_names import first_names

_log = logging.getLogger(__name__)

_REMEDIES = {"outside-link": "copy into the folder what it leads to", "no-permission": "change its mode"}

_TABLE = re.compile(r"(fabrics?|protocol)\b.*\.(csv|json|xlsx?|ods)(\.txt)?", re.IGNORECASE)  # copies, too

DEFAULT_CORRECTIONS = ("pairing", "rotation", "side")


def load(
    name_or_path: str | Path,
    *,
    correct: Collection[str] | bool = DEFAULT_CORRECTIONS,
    fabrics_csv: str | Path | None = None,
    strict: bool = False,
    progress: Progress | None = None,
) -> DrapeDataset:
    """Loads a data set, as one of torch's too; see `read_dataset` for arguments and errors.

    Args:
        name_or_path: Name or folder.
        correct: Known faults that are corrected.
        fabrics_csv: Table of areal densities and thicknesses.
        strict: Whether a file that cannot be used is an error now.
        progress: Called with (files done, files).

    Returns:
        The data set.

    Raises:
        DataError: See `read_dataset`.
    """
    from cusick_bench.datasets.torch_dataset import TorchDrapeDataset  # here, as reading tables needs no torch

    read = read_dataset(name_or_path, correct=correct, fabrics_csv=fabrics_csv, strict=strict, progress=progress)
    return TorchDrapeDataset(read.name, read.root, read.protocol, read.corrected, read.table)


def read_dataset(
    name_or_path: str | Path,
    *,
    correct: Collection[str] | bool = DEFAULT_CORRECTIONS,
    fabrics_csv: str | Path | None = None,
    strict: bool = False,
    progress: Progress | None = None,
) -> DrapeDataset:
    """Loads a data set without torch, which takes longer to import than a table to read.

    Args:
        name_or_path: `synthetic`, `cusick` (in the folder that the environment variable CUSICK_DATA names), or a
            folder in the public release's layout. A `Path` is always a folder, even one of such a name.
        correct: Known faults that are corrected; each correction is noted in the index. `pairing`: meshes go to the
            silhouettes that they fit. `rotation`: meshes are turned by quarter turns. `side`: faces are unknown
            where meshes contradict the capture numbers. `centre`: off-centre images are moved, so that scores
            differ from the paper's; not by default. True means all, False none.
        fabrics_csv: Table of areal densities and thicknesses; by default `fabrics.csv` beside the data.
        strict: Whether an image or mesh that cannot be used is an error now rather than when it is sampled.
        progress: Called with (files done, files) while the files are measured.

    Returns:
        The data set.

    Raises:
        DataError: Nothing to load, or nothing that may be looked at, a malformed table, a shipped file that was
            changed or added, or with `strict` a bad file.
    """
    root = folder_of(name_or_path)
    wanted = _corrections(correct)
    layout = scan(root)
    name = str(name_or_path) if is_name(name_or_path) else layout.root.name
    _require_text(layout, name)
    _tell_problems(layout)
    if is_shipped(layout.root):
        verify_checksums(layout)
    table = Path(fabrics_csv) if fabrics_csv else layout.beside(FABRICS_FILE)
    fabrics = read_fabrics(table) if table else {}
    described = layout.beside(PROTOCOL_FILE)
    protocol = read_protocol(described) if described else Protocol()
    verified = name_or_path == "synthetic"  # its meshes lie where they belong
    found = survey(layout, protocol, measure=strict or bool(wanted and not verified), progress=progress)
    if strict and found.faults:
        raise next(iter(found.faults.values()))
    _tell_copies(layout, found)
    _tell_unread(layout)
    _tell_unread_tables(layout, [table, described])
    applied = () if verified else wanted
    dataset = DrapeDataset(
        name, layout.root, protocol, applied, build_index(name, layout, protocol, fabrics, found, applied)
    )
    _tell_same_numbers(layout.root, dataset.table, found)
    _log.debug(
        "data set %s in %s: %d silhouettes; %s; densities: %s; corrected: %s", name, layout.root, len(dataset),
        protocol, table or "published ones", ", ".join(applied) or "nothing",
    )  # fmt: skip
    return dataset


def _require_text(layout: Layout, name: str) -> None:
    """Refuses names with bytes that are no UTF-8, such as those of an old archive: the index cannot hold them."""
    paths = (layout.root / entry.path for entry in (*layout.silhouettes, *layout.meshes))
    for path, text in ((layout.root, name), *((path, path.relative_to(layout.root).as_posix()) for path in paths)):
        try:
            text.encode()
        except UnicodeEncodeError as error:
            raise DataError("name must be UTF-8", where=path, remedy="rename it") from error


def _tell_problems(layout: Layout) -> None:
    """Warns of what could not be looked at; an error where nothing else is there, or where numbers begin at 0."""
    for problem in layout.problems:
        where, remedy = layout.root / problem.path, _REMEDIES.get(problem.kind, "")
        if problem.kind == NUMBER_ZERO:
            raise DataError(problem.detail, where=where, remedy="rename the files", kind=problem.kind)
        if not layout.silhouettes:
            what = f"{problem.detail}, and there are no other silhouettes"
            raise DataNotFound(what, where=where, remedy=remedy, kind=problem.kind)
        _log.warning("%s: %s; %s", where, problem.detail, remedy)


def _tell_copies(layout: Layout, found: Survey) -> None:
    """Warns of pictures that are stored again as another sample or capture: they make drapes look too alike.

    No drape repeats to the last bit. Pictures of named sets are copies by design.
    """
    first: dict[str, str] = {}
    copies: list[tuple[str, str]] = []
    for entry in layout.silhouettes:
        digest = found.hashes.get(entry.path)
        if digest is None or entry.is_named:
            continue
        if digest in first:
            copies.append((entry.path, first[digest]))
        first.setdefault(digest, entry.path)
    if copies:
        number = "1 silhouette is" if len(copies) == 1 else f"{len(copies)} silhouettes are"
        _log.warning(
            "%s: %s a copy of another one, such as %s of %s, and count as drapes of their own; put the right "
            "pictures there, or remove the copies", layout.root, number, *copies[0],
        )  # fmt: skip


def _tell_same_numbers(root: Path, table: pd.DataFrame, found: Survey) -> None:
    """Warns of pictures of the same sample and capture: a foreign drape would count as a repeat of the sample's."""
    first: dict[tuple[object, ...], str] = {}
    again: list[tuple[str, str]] = []
    columns = ["image", "cloth", "sample", "capture", "observation"]
    for path, *numbers in table[columns].itertuples(index=False, name=None):
        if path in found.faults:
            continue
        earlier = first.setdefault(tuple(numbers), path)
        if earlier != path:
            again.append((path, earlier))
    if again:
        number = "1 silhouette has" if len(again) == 1 else f"{len(again)} silhouettes have"
        _log.warning(
            "%s: %s the same fabric, sample and capture as another one, such as %s and %s, and all of them count; give "
            "each the numbers of what it shows, or remove the wrong ones", root, number, *again[0],
        )  # fmt: skip


def _tell_unread(layout: Layout) -> None:
    """Warns of pictures that are no part of the layout: a misspelt name would make a capture go missing unnoticed."""
    read = {entry.path.rpartition(".")[0] for entry in layout.silhouettes}  # such as a capture in a second format
    pictures = [path for path in layout.unused if path.lower().endswith(SUFFIXES)]
    pictures += [
        path for path in layout.unused if path.lower().endswith(UNREAD_SUFFIXES) and path.rpartition(".")[0] not in read
    ]
    if pictures:
        number = "1 picture is" if len(pictures) == 1 else f"{len(pictures)} pictures are"
        _log.warning(
            "%s: %s not read, named, placed or stored otherwise than the layout has it: %s; `cusick-bench data audit` "
            "lists what is no part of the layout", layout.root, number, first_names(sorted(pictures)),
        )  # fmt: skip


def _tell_unread_tables(layout: Layout, read: Collection[Path | None]) -> None:
    """Warns of tables that are not where, or not called what, they have to be: other values are used without them."""
    tables = [path for path in layout.unused if _TABLE.fullmatch(path.rpartition("/")[2])]
    known = {path.resolve() for path in read if path is not None}  # a folder may be given by a link, or as `..`
    tables = [path for path in tables if (layout.root / path).resolve() not in known]
    if tables:
        _log.warning(
            "%s: %s: not read, so no weight, size or scale in there is used; %s and %s are looked for in the data "
            "set's folder, then in its folder `data`", layout.root, first_names(tables), FABRICS_FILE, PROTOCOL_FILE,
        )  # fmt: skip


def _corrections(correct: Collection[str] | bool) -> tuple[str, ...]:
    if isinstance(correct, bool):
        return CORRECTIONS if correct else ()
    names = [correct] if isinstance(correct, str) else list(correct)
    unknown = [name for name in names if name not in CORRECTIONS]
    if unknown:
        raise DataError(f"unknown correction {', '.join(unknown)}", remedy=f"use some of {', '.join(CORRECTIONS)}")
    return tuple(name for name in CORRECTIONS if name in names)
