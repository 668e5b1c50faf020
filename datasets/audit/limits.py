"""Silhouettes that no cloth on the plate can show, and whose results would look like any others.

An audit lists everything irregular; this is the part of it that stops a fit or a diagnosis. The limits lie beyond what
effects of the laboratory reach (a camera's scale that is off by 20 %, a cloth 30 mm off its place) and beyond every
picture of the public release (grey .0003, farthest reach 1.03 of the flat cloth, .91 of the plate covered, 16 mm off
centre, no hole), so real irregularities remain something to be listed or diagnosed.
"""

from collections.abc import Iterator
from math import hypot

from cusick_bench.datasets.files.measure import ImageMeasure
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.irregularity import Irregularity

GREY = 0.01  # largest grey area away from the outline, over that of the cloth: a point of drape coefficient or so
HOLE = 0.001  # largest hole, over the area of the cloth
BEYOND = 1.2  # largest reach of a silhouette over the flat radius
UNCOVERED = 0.75  # least radius that must fit into the silhouette, over that of the plate
OFF_CENTRE = 0.25  # largest distance of the middle of the cloth from the plate's axis, over the flat radius
UNREADABLE = ("empty-image", "full-image", "inverted-image", "two-blobs")
"""Kinds of `BadImage` that say that a picture shows no single cloth; other kinds are faults of the file."""
UNMEASURED = (*UNREADABLE, "shrunken-image")
"""Kinds of faults of pictures that statistics leave out; those with another one alone are measured all the same."""


def impossible_faults(path: str, image: ImageMeasure, protocol: Protocol) -> Iterator[Irregularity]:
    """Faults that make a silhouette impossible.

    Args:
        path: Its path below the data set's root.
        image: What was measured.
        protocol: Nominal values of the experiment.

    Yields:
        One item for each fault: what was found, and the limit.
    """
    small, cloth = image.blemishes, 1e3 * protocol.cloth_radius_m
    if small.grey > GREY:
        detail = f"not black and white: {small.grey:.1%} of the cloth's size is grey away from its outline"
        yield Irregularity(path, "image-grey", f"{detail}, at most {GREY:.0%} may be")
    if small.largest_hole > HOLE * small.cloth:
        yield Irregularity(path, "hole", f"a hole of {small.largest_hole} px in a cloth of {small.cloth} px")
    if small.touches_border:
        yield Irregularity(path, "touches-border", "the cloth is cut by the image's border")
    inscribed = image.plate.inscribed / protocol.px_per_m / protocol.plate_radius_m
    if inscribed < UNCOVERED:
        detail = f"does not cover the plate: holds a circle of {inscribed:.0%} of its radius, at least {UNCOVERED:.0%}"
        yield Irregularity(path, "shrunken-image", f"{detail} must fit")
    reach = 1e3 * float(image.profile.radii.max())
    if reach > BEYOND * cloth:
        detail = f"reaches {reach:.0f} mm, {reach / cloth:.2f} times the flat cloth's {cloth:.0f} mm"
        yield Irregularity(path, "radius-beyond-cloth", f"{detail}; at most {BEYOND:g} times")
    column, row = (middle - centre for middle, centre in zip(small.centroid, protocol.centre_px, strict=True))
    distance = 1e3 * hypot(column, row) / protocol.px_per_m
    if distance > OFF_CENTRE * cloth:
        detail = f"the cloth lies {distance:.0f} mm ({column:+.0f} columns, {row:+.0f} rows) off centre_px"
        yield Irregularity(path, "far-off-centre", f"{detail}, at most {OFF_CENTRE * cloth:.0f} mm may be")
