"""Audit of silhouettes: blemishes, position on the plate, copies, named sets."""

from collections import defaultdict
from collections.abc import Iterator, Mapping

from cusick_bench.datasets.files.layout import Layout
from cusick_bench.datasets.files.measure import ImageMeasure
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.index import Survey
from cusick_bench.datasets.irregularity import Irregularity
from cusick_bench.datasets.named import Twin
from cusick_bench.datasets.pairing import FIT_LIMIT


def check_images(layout: Layout, protocol: Protocol, found: Survey) -> Iterator[Irregularity]:
    """Looks for faults of single silhouettes, and for identical files.

    Args:
        layout: Files of the folder.
        protocol: Nominal values of the experiment.
        found: What `survey` found in the files.

    Yields:
        One item for each fault.
    """
    for path, image in found.silhouettes.items():
        yield from _blemishes(path, image)
        yield from _on_plate(path, image, protocol)
    first: dict[str, str] = {}
    for entry in layout.silhouettes:
        digest = found.hashes.get(entry.path)
        if digest is None or entry.is_named:
            continue
        if digest in first:
            yield Irregularity(entry.path, "duplicate-image", f"identical to {first[digest]}")
        first.setdefault(digest, entry.path)


def _blemishes(path: str, image: ImageMeasure) -> Iterator[Irregularity]:
    small = image.blemishes
    if image.coloured:
        yield Irregularity(path, "image-colour", "colour channels differ; read as grey")
    if small.specks:
        yield Irregularity(path, "specks", f"{small.specks} objects of up to {small.largest_speck} px beside the cloth")
    if small.holes:
        yield Irregularity(path, "hole", f"{small.holes} holes of up to {small.largest_hole} px in the cloth")
    if small.touches_border:
        yield Irregularity(path, "touches-border", "the cloth reaches the image's border")


def _on_plate(path: str, image: ImageMeasure, protocol: Protocol) -> Iterator[Irregularity]:
    plate, radii = image.plate, image.profile.radii
    if plate.fault == "off-centre":
        detail = f"holds the plate only if moved by {plate.shift[0]:g} columns, {plate.shift[1]:g} rows"
        yield Irregularity(path, plate.fault, detail)
    elif plate.fault:
        needed = protocol.plate_radius_m * protocol.px_per_m
        detail = f"largest circle inside has a radius of {plate.inscribed:.1f} px, the plate has {needed:.1f} px"
        yield Irregularity(path, plate.fault, detail)
    if radii.max() > protocol.cloth_radius_m:
        detail = f"reaches {1e3 * radii.max():.1f} mm, the flat cloth {1e3 * protocol.cloth_radius_m:.0f} mm"
        yield Irregularity(path, "radius-beyond-cloth", detail)


def check_named_sets(layout: Layout, found: Survey, twins: Mapping[str, Twin]) -> Iterator[Irregularity]:
    """Tells which captures named images copy, and which sets mix faces or observations.

    Args:
        layout: Files of the folder.
        found: What `survey` found in the files.
        twins: Result of `named.twins`, by path.

    Yields:
        One item for each fault.
    """
    for path, twin in twins.items():
        if twin.capture is None:
            continue
        if twin.difference == 0:
            yield Irregularity(path, "named-copy", f"= {twin.capture.path}")
        else:
            kind = "named-near-copy" if twin.difference <= FIT_LIMIT else "named-unmatched"
            detail = f"nearest is {twin.capture.path}, {1e3 * twin.difference:.1f} mm rms away"
            yield Irregularity(path, kind, detail)
    faces: dict[str, set[str]] = defaultdict(set)
    observations: dict[str, set[int]] = defaultdict(set)
    folders: dict[str, str] = {}
    for entry in layout.silhouettes:
        if entry.is_named:
            folders[entry.cloth] = entry.path.rpartition("/")[0] or "."
            faces[entry.cloth].add({1: "up", 2: "up", 3: "down", 4: "down"}.get(entry.capture, "unknown"))
            observations[entry.cloth].add(entry.observation)
    for cloth, folder in folders.items():
        if len(faces[cloth]) > 1:
            yield Irregularity(folder, "mixed-faces", f"faces {', '.join(sorted(faces[cloth]))} in one set")
        if len(observations[cloth]) > 1:
            numbers = ", ".join(map(str, sorted(observations[cloth])))
            yield Irregularity(folder, "mixed-observations", f"observations {numbers} in one set")
