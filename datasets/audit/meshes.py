"""Audit of meshes: missing, misplaced, turned, of another kind or size."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence

from cusick_bench.datasets.errors import DataError
from cusick_bench.datasets.files.layout import Layout
from cusick_bench.datasets.files.measure import content_hash
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.index import Survey
from cusick_bench.datasets.irregularity import Irregularity
from cusick_bench.datasets.pairing import MeshMatch, impossible_sizes


def check_meshes(
    layout: Layout, protocol: Protocol, found: Survey, matches: Sequence[MeshMatch]
) -> Iterator[Irregularity]:
    """Looks for faults of mesh files: missing, copied, damaged, turned, or of another capture.

    Args:
        layout: Files of the folder.
        protocol: Nominal values of the experiment.
        found: What `survey` found in the files.
        matches: Result of `pairing.match_meshes`.

    Yields:
        One item for each fault.
    """
    yield from _partners(layout)
    yield from _shapes(found, protocol)
    for match in matches:
        yield from _fit(match)
    yield from _copies(layout, matches)


def _partners(layout: Layout) -> Iterator[Irregularity]:
    images = {entry.key for entry in layout.silhouettes}
    meshes = {entry.key for entry in layout.meshes}
    equipped = {entry.cloth for entry in layout.meshes}
    for entry in layout.meshes:
        if entry.key not in images:
            yield Irregularity(entry.path, "no-silhouette", "mesh without silhouette")
    bare: dict[str, list[str]] = defaultdict(list)
    for entry in layout.silhouettes:
        if entry.is_named or entry.key in meshes:
            continue
        if entry.cloth in equipped:
            yield Irregularity(entry.path, "no-mesh", "silhouette without mesh")
        else:
            bare[entry.cloth].append(entry.path)
    for paths in bare.values():  # a fabric without any mesh: said once
        folder = paths[0].rpartition("/")[0].rpartition("/")[0] or "."
        yield Irregularity(folder, "no-mesh", f"no meshes at all for {len(paths)} silhouettes")


def _shapes(found: Survey, protocol: Protocol) -> Iterator[Irregularity]:
    counts = Counter((mesh.vertices, mesh.faces) for mesh in found.meshes.values())
    usual, number = counts.most_common(1)[0] if counts else ((0, 0), 0)
    for path, mesh in found.meshes.items():
        if 2 * number > counts.total() and (mesh.vertices, mesh.faces) != usual:
            detail = f"{mesh.vertices} vertices, {mesh.faces} faces; most have {usual[0]}, {usual[1]}"
            yield Irregularity(path, "mesh-topology", detail)
    for path, radius in impossible_sizes(found.outlines, protocol).items():
        yield Irregularity(path, "mesh-units", f"mean radius is {radius:g}, in metres? scale the mesh")


def _fit(match: MeshMatch) -> Iterator[Irregularity]:
    path = match.mesh.path
    rotation = match.own_rotation
    if match.belongs_elsewhere and match.best:
        rotation = match.best_rotation
        detail = (
            f"fits {match.best.path} ({_mm(match.best_rms)}), not the silhouette of its name ({_mm(match.own_rms)})"
        )
        yield Irregularity(path, "mesh-other-capture", detail)
    elif match.matches_none:
        detail = f"fits no silhouette of its sample; best {_mm(match.best_rms)}"
        yield Irregularity(path, "mesh-matches-none", detail)
    if rotation:
        yield Irregularity(path, "mesh-rotated", f"fits if turned by {rotation} deg about z")


def _mm(length: float) -> str:
    return f"{1e3 * length:.1f} mm rms" if length < 1e3 else "none"


def _copies(layout: Layout, matches: Sequence[MeshMatch]) -> Iterator[Irregularity]:
    """Identical mesh files; the one that fits its own silhouette counts as the original."""
    misplaced = {match.mesh.path for match in matches if not match.fits_own}
    groups: dict[str, list[str]] = defaultdict(list)
    for entry in layout.meshes:
        try:
            groups[content_hash(layout.root / entry.path)].append(entry.path)
        except DataError:  # already listed as unreadable
            continue
    for paths in groups.values():
        original = next((path for path in paths if path not in misplaced), paths[0])
        for path in paths:
            if path != original:
                yield Irregularity(path, "duplicate-mesh", f"identical to {original}")
