"""Audit of folders, file names, captures and tables."""

import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePosixPath

from cusick_bench.datasets import named
from cusick_bench.datasets.files.entry import Entry, is_fabric_folder, is_image_folder
from cusick_bench.datasets.files.fabrics import FILE, Fabric
from cusick_bench.datasets.files.layout import Layout
from cusick_bench.datasets.files.protocol import FILE as PROTOCOL
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.files.protocol_keys import NOTES
from cusick_bench.datasets.index import Survey, doubtful_sides, fabric_keys, fabric_values, recognised_cloths
from cusick_bench.datasets.irregularity import Irregularity
from cusick_bench.files.first_names import first_names

_SPELLINGS = (("sil", "silhouettes"), ("mesh", "meshes"))


def check_names(layout: Layout, protocol: Protocol) -> Iterator[Irregularity]:
    """Checks names of folders and files, and looks for captures that are too many or too few.

    Args:
        layout: Files of the folder.
        protocol: Nominal values of the experiment.

    Yields:
        One item for each fault.
    """
    yield from _folders(layout)
    yield from _unused(layout)
    for entry in (*layout.silhouettes, *layout.meshes):
        if entry.fabric and entry.file_fabric not in (0, entry.fabric):
            detail = f"named after Fabric {entry.file_fabric}, lies in Fabric {entry.fabric}"
            yield Irregularity(entry.path, "fabric-misnamed", detail)
        if entry.file_sample not in (0, entry.sample):
            detail = f"named after sample {entry.file_sample}, lies in sample {entry.sample}"
            yield Irregularity(entry.path, "sample-misnamed", detail)
    for files in (layout.silhouettes, layout.meshes):
        yield from _duplicates(files)
    yield from _spellings(layout)
    for cloth in dict.fromkeys(entry.cloth for entry in layout.silhouettes if not entry.is_named):
        yield from _captures([entry for entry in layout.silhouettes if entry.cloth == cloth], protocol)


def check_tables(
    layout: Layout, protocol: Protocol, fabrics: Mapping[str, Fabric] | None, found: Survey
) -> Iterator[Irregularity]:
    """Looks for densities and thicknesses that are missing, unused parts of tables, and faces that are not known.

    Args:
        layout: Files of the folder.
        protocol: Nominal values of the experiment.
        fabrics: Rows of `fabrics.csv`, by `fabric_key`; None where it is malformed.
        found: What `survey` found in the files.

    Yields:
        One item for each fault.
    """
    for key in protocol.extra.keys() - {NOTES}:
        yield Irregularity(layout.path_of(PROTOCOL), "protocol-unknown-key", f"{key} is kept but not used")
    origin = named.sources(layout.silhouettes, found.hashes)
    recognised = recognised_cloths(layout, found)
    doubtful = doubtful_sides(layout, protocol, found)
    used: set[str] = set()
    for cloth, folder in _homes(layout).items():
        source = origin.get(cloth, cloth)
        used.update(fabric_keys(cloth, source))
        if cloth in doubtful:
            yield Irregularity(folder, "side-unknown", "its meshes belong to captures of the other face")
        if fabrics is None:
            continue
        values = fabric_values(cloth, source, fabrics, recognised)
        if not math.isfinite(values.areal_density):
            yield Irregularity(folder, "density-missing", "add its areal density to fabrics.csv")
        if not math.isfinite(values.thickness):
            yield Irregularity(folder, "thickness-missing", "add its thickness to fabrics.csv")
    table = layout.beside(FILE)
    if fabrics is None or table is None or not table.is_relative_to(layout.root):
        return  # a table further up serves other fabrics too
    for key in fabrics:
        if key not in used:
            yield Irregularity(layout.path_of(FILE), "fabrics-unused", f"{key} is not among the data")
    columns = {column for fabric in fabrics.values() for column in fabric.extra}
    for column in sorted(columns):
        yield Irregularity(layout.path_of(FILE), "fabrics-unused", f"column {column} is not used")


def _homes(layout: Layout) -> dict[str, str]:
    """The folder of each cloth."""
    groups: dict[str, list[str]] = defaultdict(list)
    for entry in layout.silhouettes:
        groups[entry.cloth].append(entry.path)
    return {cloth: _common_folder(paths) for cloth, paths in groups.items()}


def _common_folder(paths: Sequence[str]) -> str:
    """Deepest folder that holds all files, above a folder of silhouettes."""
    parents = [PurePosixPath(path).parent.parts for path in paths]
    shared = []
    for parts in zip(*parents, strict=False):
        if len(set(parts)) > 1 or is_image_folder(parts[0]):
            break
        shared.append(parts[0])
    return "/".join(shared) or "."


def _folders(layout: Layout) -> Iterator[Irregularity]:
    siblings: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    files = [entry for entry in (*layout.silhouettes, *layout.meshes) if not entry.is_named]
    holders = {PurePosixPath(entry.path).parent.as_posix() for entry in files}
    for folder in layout.folders:
        path = PurePosixPath(folder)
        if " " in path.name and not is_fabric_folder(path.name):
            yield Irregularity(folder, "space-in-path", "folder name holds a space")
        for start, right in _SPELLINGS:
            if folder in holders and path.name.lower().startswith(start) and path.name.lower() != right:
                yield Irregularity(folder, "folder-misspelt", f"should be {right}")
        if match := re.fullmatch(r"(sample[^0-9]*)\d+", path.name, re.I):
            siblings[path.parent.as_posix()][match[1]].append(path.name)
    for parent, ways in siblings.items():
        if len(ways) > 1:
            detail = " but ".join(f"{len(names)} like `{names[0]}`" for names in ways.values())
            yield Irregularity(parent, "folder-inconsistent", f"sample folders: {detail}")


def _unused(layout: Layout) -> Iterator[Irregularity]:
    groups: dict[str, list[str]] = defaultdict(list)
    for path in layout.unused:
        groups[PurePosixPath(path).parent.as_posix()].append(PurePosixPath(path).name)
    for folder, names in groups.items():
        shown = first_names(names, 5)
        yield Irregularity(folder, "unused-file", f"{len(names)} files that are no part of the layout: {shown}")


def _duplicates(files: Sequence[Entry]) -> Iterator[Irregularity]:
    first: dict[tuple[str, int, int, int], str] = {}
    for entry in files:
        if entry.key in first:
            yield Irregularity(entry.path, "duplicate-name", f"same fabric, sample and capture as {first[entry.key]}")
        first.setdefault(entry.key, entry.path)


def _spelling(entry: Entry) -> str:
    """A file name with its numbers left out."""
    return re.sub(r"\d+", "N", PurePosixPath(entry.path).name.removesuffix(".gz").rsplit(".", 1)[0])


def _spellings(layout: Layout) -> Iterator[Irregularity]:
    meshes = {entry.key: entry for entry in layout.meshes}
    pairs: dict[str, set[tuple[str, str]]] = defaultdict(set)
    ways: dict[str, Counter[str]] = defaultdict(Counter)
    for entry in layout.silhouettes:
        if entry.is_named:
            continue
        ways[entry.cloth][_spelling(entry)] += 1
        mesh = meshes.get(entry.key)
        if mesh and _spelling(mesh) != _spelling(entry):
            pairs[PurePosixPath(entry.path).parent.parent.as_posix()].add((_spelling(entry), _spelling(mesh)))
    for folder, found in pairs.items():
        for image, mesh in sorted(found):
            yield Irregularity(folder, "file-inconsistent", f"images are named {image}, meshes {mesh}")
    homes = _homes(layout)
    for cloth, names in ways.items():
        if len(names) > 1:
            detail = " but ".join(f"{count} named {name}" for name, count in names.most_common())
            yield Irregularity(homes[cloth], "file-inconsistent", f"images: {detail}")


def _captures(entries: Sequence[Entry], protocol: Protocol) -> Iterator[Irregularity]:
    """Captures, or observations of a series, of one cloth."""
    series = any(entry.observation for entry in entries)
    numbers: dict[int, set[int]] = defaultdict(set)
    for entry in entries:
        numbers[entry.sample].add(entry.observation if series else entry.capture)
    home = _common_folder([entry.path for entry in entries])
    if not series and all(entry.capture == 0 for entry in entries):
        yield Irregularity(home, "no-capture-number", f"{len(entries)} files; captures are taken as 1, face unknown")
        yield Irregularity(home, "side-unknown", "no capture numbers")
        return
    counts = Counter(number for found in numbers.values() for number in found)
    usual = {number for number, count in counts.items() if 2 * count > len(numbers)}
    for entry in entries:
        number = entry.observation if series else entry.capture
        what = "observation" if series else "capture"
        if number == 0:
            yield Irregularity(entry.path, "no-capture-number", f"no {what} number in the name")
        elif number not in usual:
            yield Irregularity(entry.path, "extra-capture", f"most other samples have no {what} {number}")
        elif not series and number not in protocol.captures:
            known = ", ".join(map(str, sorted(protocol.captures))) or "none"
            detail = f"no face is known of capture {number}; `captures` in protocol.json says that of {known}"
            yield Irregularity(entry.path, "extra-capture", detail)
    for sample, found in numbers.items():
        if missing := sorted(usual - found):
            yield Irregularity(home, "missing-capture", f"sample {sample} lacks {', '.join(map(str, missing))}")
