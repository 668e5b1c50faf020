"""Named sets (`bnn_image_gt/<cloth>`): which fabric's captures their images are, and which meshes belong to them."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cusick_bench.datasets.files.entry import Entry
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.pairing import FIT_LIMIT, Assignment, best_turn
from cusick_bench.datasets.profile import Profile
from cusick_bench.datasets.published import CLOTHS


@dataclass(frozen=True)
class Twin:
    """The capture that a named image equals or comes nearest to.

    Attributes:
        capture: None if its fabric is not there.
        difference: Root-mean-square difference of the profiles [m]; 0 for identical files.
    """

    capture: Entry | None = None
    difference: float = float("inf")


def sources(silhouettes: Sequence[Entry], hashes: Mapping[str, str]) -> dict[str, str]:
    """Finds the set of captures that each named set is taken from: by identical images, else as published.

    Args:
        silhouettes: Silhouette files.
        hashes: SHA-256 by path.

    Returns:
        Name of a named set -> name of the set of captures.
    """
    owners = {hashes[entry.path]: entry.cloth for entry in silhouettes if not entry.is_named and entry.path in hashes}
    present = set(owners.values())
    votes: dict[str, Counter[str]] = {entry.cloth: Counter() for entry in silhouettes if entry.is_named}
    for entry in silhouettes:
        if entry.is_named and hashes.get(entry.path) in owners:
            votes[entry.cloth][owners[hashes[entry.path]]] += 1
    found = {cloth: count.most_common(1)[0][0] for cloth, count in votes.items() if count}
    for cloth in votes.keys() - found.keys():
        if cloth in CLOTHS and CLOTHS[cloth].source in present:
            found[cloth] = CLOTHS[cloth].source
    return found


def twins(
    silhouettes: Sequence[Entry],
    hashes: Mapping[str, str],
    images: Mapping[str, Profile],
) -> dict[str, Twin]:
    """Finds the capture that each named image equals or, within its sample, comes nearest to.

    Args:
        silhouettes: Silhouette files.
        hashes: SHA-256 by path.
        images: Profiles by path.

    Returns:
        Path of a named image -> its twin.
    """
    origin = sources(silhouettes, hashes)
    samples: dict[tuple[str | None, int], list[Entry]] = defaultdict(list)
    for entry in silhouettes:
        samples[entry.cloth, entry.sample].append(entry)
    found: dict[str, Twin] = {}
    for entry in (entry for entry in silhouettes if entry.is_named):
        captures = samples.get((origin.get(entry.cloth), entry.sample), [])
        same = [other for other in captures if hashes.get(other.path) == hashes.get(entry.path, "")]
        near = [other for other in captures if other.path in images and entry.path in images]
        if same:
            found[entry.path] = Twin(same[0], 0.0)
        elif near:
            rms = {other: images[entry.path].rms(images[other.path]) for other in near}
            nearest = min(rms, key=lambda other: rms[other])
            found[entry.path] = Twin(nearest, rms[nearest])
        else:
            found[entry.path] = Twin()
    return found


def assign_meshes(
    silhouettes: Sequence[Entry],
    meshes: Sequence[Entry],
    found: Mapping[str, Twin],
    images: Mapping[str, Profile],
    outlines: Mapping[str, Profile],
    assigned: Mapping[str, Assignment],
    protocol: Protocol,
) -> dict[str, Assignment]:
    """Assigns meshes to named images: the identical capture's, else the one of its sample that fits best.

    Args:
        silhouettes: Silhouette files.
        meshes: Mesh files.
        found: Result of `twins`.
        images: Profiles of silhouettes by path; without them only identical images get a mesh.
        outlines: Profiles of meshes by path.
        assigned: Meshes of the captures.
        protocol: Gives the size of the cloth, by which differences are judged.

    Returns:
        Path of a named image -> its mesh.
    """
    result = {}
    for entry in (entry for entry in silhouettes if entry.is_named):
        twin = found[entry.path].capture
        if twin is not None and found[entry.path].difference == 0:
            known = assigned[twin.path]
            result[entry.path] = Assignment(known.mesh, known.rotation, (f"= {twin.path}", *known.notes))
            continue
        fits = {
            mesh.path: best_turn(images[entry.path], outlines[mesh.path])
            for mesh in meshes
            if twin and (mesh.cloth, mesh.sample) == (twin.cloth, twin.sample) and mesh.path in outlines
        }
        best = min(fits, key=lambda path: fits[path][0], default="")
        if best and fits[best][0] <= FIT_LIMIT * protocol.cloth_scale:
            result[entry.path] = Assignment(best, fits[best][1], ("identical to no capture; mesh by outline",))
        else:
            result[entry.path] = Assignment(notes=("no mesh: resembles no capture of its sample",))
    return result
