"""Builds the table of a data set: one row per silhouette, with its mesh, face, density and what was corrected."""

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import pandas as pd

from cusick_bench.datasets import named, pairing
from cusick_bench.datasets.errors import DataError
from cusick_bench.datasets.files.entry import NAMED_FACES, Entry
from cusick_bench.datasets.files.fabrics import Fabric, fabric_key
from cusick_bench.datasets.files.layout import Layout
from cusick_bench.datasets.files.measure import ImageMeasure, MeshMeasure, content_hash, measure_image, measure_mesh
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.profile import Profile
from cusick_bench.datasets.published import CITATION, CLOTHS, FINGERPRINTS

COLUMNS = (
    "dataset", "fabric", "cloth", "sample", "capture", "side", "observation", "image", "same_as", "mesh",
    "mesh_rotation_deg", "image_shift_columns_px", "image_shift_rows_px", "areal_density", "thickness", "notes",
)  # fmt: skip
OTHER_FACE = {"up": "down", "down": "up"}
"""By the face of a drape that is known, the other one."""
UNNUMBERED = "no capture number, taken as 1; side unknown"
"""Note of a picture whose name holds no number of a capture."""
CORRECTIONS = ("pairing", "rotation", "side", "centre")
Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Survey:
    """Everything that measuring the files of a layout tells.

    Attributes:
        silhouettes: What was measured, by image path.
        meshes: Outline and size by mesh path.
        hashes: SHA-256 by path, images only.
        faults: Files that could not be used, with the error.
    """

    silhouettes: dict[str, ImageMeasure] = field(default_factory=dict)
    meshes: dict[str, MeshMeasure] = field(default_factory=dict)
    hashes: dict[str, str] = field(default_factory=dict)
    faults: dict[str, DataError] = field(default_factory=dict)

    @property
    def images(self) -> dict[str, Profile]:
        """Image profiles by path."""
        return {path: image.profile for path, image in self.silhouettes.items()}

    @property
    def outlines(self) -> dict[str, Profile]:
        """Mesh profiles by path."""
        return {path: mesh.profile for path, mesh in self.meshes.items()}


def survey(layout: Layout, protocol: Protocol, *, measure: bool, progress: Progress | None = None) -> Survey:
    """Hashes all images and, if asked, measures every file; a file that cannot be used is noted, not raised.

    Args:
        layout: Files of the folder.
        protocol: Nominal values of the experiment.
        measure: Whether to measure profiles and meshes too; of images that are stored in several formats it is always
            seen which can be used.
        progress: Called with (files done, files).

    Returns:
        Hashes and measures by path, and what is wrong with files that cannot be used.
    """
    found = Survey()
    total = len(layout.silhouettes) + len(layout.meshes)
    formats = Counter(_without_suffix(entry) for entry in layout.silhouettes)
    for count, entry in enumerate((*layout.silhouettes, *layout.meshes), 1):
        path, is_image = layout.root / entry.path, count <= len(layout.silhouettes)
        try:
            if is_image:
                found.hashes[entry.path] = content_hash(path)
            if is_image and (measure or formats[_without_suffix(entry)] > 1):
                found.silhouettes[entry.path] = measure_image(path, protocol)
            elif measure:
                found.meshes[entry.path] = measure_mesh(path)
        except DataError as error:
            found.faults[entry.path] = error
        if progress:
            progress(count, total)
    return found


def build_index(
    name: str,
    layout: Layout,
    protocol: Protocol,
    fabrics: Mapping[str, Fabric],
    found: Survey,
    correct: Collection[str],
) -> pd.DataFrame:
    """One row per silhouette; of one that is stored in several formats the first usable one is taken.

    Args:
        name: Name of the data set.
        layout: Files.
        protocol: Nominal values.
        fabrics: Rows of `fabrics.csv`, by `fabric_key`.
        found: Result of `survey`.
        correct: Those of `CORRECTIONS` that are applied.

    Returns:
        Columns as in `DrapeDataset.index`.
    """
    copies = _stored_again(layout.silhouettes, found)
    left_out = {path for others in copies.values() for path in others}
    layout = replace(layout, silhouettes=tuple(entry for entry in layout.silhouettes if entry.path not in left_out))
    alike = named.twins(layout.silhouettes, found.hashes, found.images)
    assigned = assign_meshes(layout, protocol, found, alike, correct)
    origin = named.sources(layout.silhouettes, found.hashes)
    numbers = {entry.cloth: entry.fabric for entry in layout.silhouettes if not entry.is_named}
    doubtful = doubtful_sides(layout, protocol, found) if "side" in correct else set()
    recognised = recognised_cloths(layout, found)
    rows = []
    for entry in layout.silhouettes:
        source = origin.get(entry.cloth, entry.cloth)
        fabric = entry.fabric or numbers.get(source, 0)
        mesh = assigned[entry.path]
        side, side_note = _side(entry, protocol, source in doubtful)
        values = fabric_values(entry.cloth, source, fabrics, recognised)
        measured = found.silhouettes.get(entry.path)
        shift = measured.plate.shift if measured and "centre" in correct else (0.0, 0.0)
        copy_notes = [f"also stored as {path}; left out" for path in copies.get(entry.path, ())]
        notes = [*mesh.notes, *side_note, *_image_notes(entry, found, correct), *copy_notes]
        files = (entry.path, _identical(alike.get(entry.path)), mesh.mesh, mesh.rotation)
        known = (values.areal_density, values.thickness, "; ".join(notes))
        capture = (entry.sample, entry.capture or 1, side, entry.observation)
        rows.append((name, fabric, entry.cloth, *capture, *files, *shift, *known))
    return pd.DataFrame(rows, columns=pd.Index(COLUMNS))


def _without_suffix(entry: Entry) -> str:
    return entry.path.rpartition(".")[0]


def _stored_again(silhouettes: Sequence[Entry], found: Survey) -> dict[str, list[str]]:
    """Images that differ from an earlier, usable one by the suffix alone, by the path of that one."""
    groups: dict[str, list[str]] = defaultdict(list)
    for entry in silhouettes:
        groups[_without_suffix(entry)].append(entry.path)
    sorted_groups = (sorted(paths, key=lambda path: path in found.faults) for paths in groups.values())
    return {first: others for first, *others in sorted_groups if others}


def assign_meshes(
    layout: Layout, protocol: Protocol, found: Survey, alike: Mapping[str, named.Twin], correct: Collection[str]
) -> dict[str, pairing.Assignment]:
    """Assigns a mesh to every silhouette, corrected as asked; meshes that are measured and of no cloth's size to none.

    Args:
        layout: Files of the folder.
        protocol: Nominal values of the experiment.
        found: What `survey` found in the files.
        alike: Result of `named.twins`, by path.
        correct: Those of `CORRECTIONS` that are applied.

    Returns:
        Path of a silhouette -> its mesh.
    """
    captures = [entry for entry in layout.silhouettes if not entry.is_named]
    impossible = pairing.impossible_sizes(found.outlines, protocol) if correct else {}
    meshes = [mesh for mesh in layout.meshes if mesh.path not in impossible]
    assigned = pairing.assign_by_name(captures, layout.meshes, impossible)
    if "pairing" in correct or "rotation" in correct:
        matches = pairing.match_meshes(captures, meshes, found.images, found.outlines, protocol)
        assigned = pairing.correct_assignment(
            assigned, matches, pairing="pairing" in correct, rotation="rotation" in correct
        )
    return assigned | named.assign_meshes(
        layout.silhouettes, meshes, alike, found.images, found.outlines, assigned, protocol
    )


def doubtful_sides(layout: Layout, protocol: Protocol, found: Survey) -> set[str]:
    """Fabrics whose meshes mostly belong to captures of the other face: there capture numbers tell no face.

    A mesh that fits a capture of unknown face best says nothing of faces.

    Args:
        layout: Files of the folder.
        protocol: Nominal values of the experiment.
        found: What `survey` found in the files.

    Returns:
        Names of their sets.
    """
    captures = [entry for entry in layout.silhouettes if not entry.is_named]
    votes: dict[str, list[bool]] = defaultdict(list)
    for match in pairing.match_meshes(captures, layout.meshes, found.images, found.outlines, protocol):
        if match.best and (match.fits_own or match.belongs_elsewhere):
            sides = [protocol.captures.get(entry.capture, "") for entry in (match.mesh, match.best)]
            if all(sides):
                votes[match.mesh.cloth].append(sides[0] != sides[1])
    return {cloth for cloth, contradictions in votes.items() if 2 * sum(contradictions) > len(contradictions)}


def recognised_cloths(layout: Layout, found: Survey) -> dict[str, str]:
    """Finds sets that are known to be a published cloth.

    Args:
        layout: Files of the folder.
        found: What `survey` found in the files.

    Returns:
        Name of a set -> published cloth.
    """
    known = {entry.cloth: entry.cloth for entry in layout.silhouettes if entry.is_named and entry.cloth in CLOTHS}
    for entry in layout.silhouettes:
        if found.hashes.get(entry.path) in FINGERPRINTS and not entry.is_named:
            known[entry.cloth] = FINGERPRINTS[found.hashes[entry.path]]
    return known


def fabric_keys(cloth: str, source: str) -> tuple[str, ...]:
    """Rows of `fabrics.csv` that are about a set of captures.

    Args:
        cloth: Name of a set.
        source: The set of captures that a named set is taken from; else `cloth`.

    Returns:
        Their `fabric_key`, that of the set itself first.
    """
    return tuple(map(fabric_key, (cloth, source, source.removesuffix("_observations"))))


def fabric_values(cloth: str, source: str, fabrics: Mapping[str, Fabric], recognised: Mapping[str, str]) -> Fabric:
    """Looks up density and thickness: in the user's table first, by cloth, then by fabric; then in what is published.

    Args:
        cloth: Name of a set.
        source: The set of captures that a named set is taken from; else `cloth`.
        fabrics: Rows of `fabrics.csv`, by `fabric_key`.
        recognised: Result of `recognised_cloths`.

    Returns:
        Density and thickness, NaN where unknown.
    """
    given = [fabrics[key] for key in fabric_keys(cloth, source) if key in fabrics]
    if cloth in recognised:
        given.append(Fabric(areal_density=CLOTHS[recognised[cloth]].areal_density, source=CITATION))
    density = next((fabric for fabric in given if math.isfinite(fabric.areal_density)), Fabric())
    thickness = next((fabric.thickness for fabric in given if math.isfinite(fabric.thickness)), math.nan)
    return Fabric(density.areal_density, thickness, density.source)


def _side(entry: Entry, protocol: Protocol, doubtful: bool) -> tuple[str, list[str]]:
    if entry.capture == 0:
        return "", [UNNUMBERED]
    if entry.is_named:
        return NAMED_FACES[entry.capture], []
    if doubtful:
        return "", ["side unknown: meshes contradict the capture numbers"]
    side = protocol.captures.get(entry.capture, "")
    return side, [] if side else [f"side of capture {entry.capture} unknown"]


def _image_notes(entry: Entry, found: Survey, correct: Collection[str]) -> list[str]:
    if entry.path in found.faults:
        return [f"{found.faults[entry.path].kind}: {found.faults[entry.path].what}"]
    measured = found.silhouettes.get(entry.path)
    if measured is None or not measured.plate.fault:
        return []
    plate = measured.plate
    if plate.fault == "off-centre":
        done = "moved by" if "centre" in correct else "off-centre, to be moved by"
        return [f"image {done} {plate.shift[0]:g} columns, {plate.shift[1]:g} rows"]
    return [f"image shrunken: holds a circle of {plate.inscribed:.0f} px only"]


def _identical(twin: named.Twin | None) -> str:
    return twin.capture.path if twin and twin.capture and twin.difference == 0 else ""
