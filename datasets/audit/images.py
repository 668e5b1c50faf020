"""Audit of silhouettes: blemishes, position on the plate, copies, named sets."""

from collections import defaultdict
from collections.abc import Iterator, Mapping

import numpy as np

from cusick_bench.datasets.audit.limits import impossible_faults
from cusick_bench.datasets.files.entry import NAMED_FACES
from cusick_bench.datasets.files.layout import Layout
from cusick_bench.datasets.files.measure import ImageMeasure
from cusick_bench.datasets.files.protocol import FILE, Protocol
from cusick_bench.datasets.index import Survey
from cusick_bench.datasets.irregularity import Irregularity
from cusick_bench.datasets.named import Twin
from cusick_bench.datasets.pairing import FIT_LIMIT

_FEWEST = 3  # least number of pictures from which a fault of the protocol is told from faults of single pictures
_OFF_AXIS = 1 / 30  # largest common offset over the flat radius; in the public release it is 1/65
_TOO_LARGE = 1.08  # largest reach of most silhouettes over the flat radius; in the public release up to 1.03
_ONLY_IMPOSSIBLE = ("image-grey", "far-off-centre")  # the other kinds are listed below those limits too


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
        yield from (fault for fault in impossible_faults(path, image, protocol) if fault.kind in _ONLY_IMPOSSIBLE)
    first: dict[str, str] = {}
    for entry in layout.silhouettes:
        digest = found.hashes.get(entry.path)
        if digest is None or entry.is_named:
            continue
        if digest in first:
            yield Irregularity(entry.path, "duplicate-image", f"identical to {first[digest]}")
        first.setdefault(digest, entry.path)


def check_frame(layout: Layout, protocol: Protocol, found: Survey) -> Iterator[Irregularity]:
    """Holds the protocol's centre and scale against the pictures: what most of them share is no slip of one.

    Args:
        layout: Files of the folder.
        protocol: Nominal values of the experiment.
        found: What `survey` found in the files.

    Yields:
        An item for a centre, and one for a scale, that do not suit the pictures.
    """
    images = list(found.silhouettes.values())
    if len(images) < _FEWEST:
        return
    offsets = np.array([image.blemishes.centroid for image in images]) - protocol.centre_px
    middle = np.median(offsets, axis=0)
    spread = 1.4826 * np.median(np.abs(offsets - middle), axis=0)
    error = 1.2533 * float(np.hypot(*spread)) / np.sqrt(len(images))  # standard error of a median
    distance, least = float(np.hypot(*middle)), _OFF_AXIS * protocol.cloth_radius_m * protocol.px_per_m
    if distance > max(least, 4 * error):
        right = protocol.centre_px + middle
        detail = f"the middles of most silhouettes lie {middle[0]:+.1f} columns, {middle[1]:+.1f} rows off it"
        yield Irregularity(layout.path_of(FILE), "protocol-centre", f"{detail}; near [{right[0]:.1f}, {right[1]:.1f}]?")
    reach = float(np.median([image.profile.radii.max() for image in images])) / protocol.cloth_radius_m
    if reach > _TOO_LARGE:
        detail = f"most silhouettes reach {reach:.2f} times the flat cloth's radius"
        yield Irregularity(layout.path_of(FILE), "protocol-scale", f"{detail}; the scale may be that much too small")
    elif 2 * sum(image.plate.fault == "shrunken-image" for image in images) > len(images):
        detail = "the plate fits into less than half of the silhouettes, wherever it is put"
        yield Irregularity(layout.path_of(FILE), "protocol-scale", f"{detail}; the scale may be too large")


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


def check_named_sets(layout: Layout, protocol: Protocol, twins: Mapping[str, Twin]) -> Iterator[Irregularity]:
    """Tells which captures named images copy, and which sets mix faces or observations.

    Args:
        layout: Files of the folder.
        protocol: Gives the size of the cloth, by which differences are judged.
        twins: Result of `named.twins`, by path.

    Yields:
        One item for each fault.
    """
    limit = FIT_LIMIT * protocol.cloth_scale
    for path, twin in twins.items():
        if twin.capture is None:
            continue
        if twin.difference == 0:
            yield Irregularity(path, "named-copy", f"= {twin.capture.path}")
        else:
            kind = "named-near-copy" if twin.difference <= limit else "named-unmatched"
            detail = f"nearest is {twin.capture.path}, {1e3 * twin.difference:.1f} mm rms away"
            yield Irregularity(path, kind, detail)
    faces: dict[str, set[str]] = defaultdict(set)
    observations: dict[str, set[int]] = defaultdict(set)
    folders: dict[str, str] = {}
    for entry in layout.silhouettes:
        if entry.is_named:
            folders[entry.cloth] = entry.path.rpartition("/")[0] or "."
            faces[entry.cloth].add(NAMED_FACES.get(entry.capture, "unknown"))
            observations[entry.cloth].add(entry.observation)
    for cloth, folder in folders.items():
        if len(faces[cloth]) > 1:
            yield Irregularity(folder, "mixed-faces", f"faces {', '.join(sorted(faces[cloth]))} in one set")
        if len(observations[cloth]) > 1:
            numbers = ", ".join(map(str, sorted(observations[cloth])))
            yield Irregularity(folder, "mixed-observations", f"observations {numbers} in one set")
