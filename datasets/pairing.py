"""Which mesh belongs to which silhouette, found by comparing their outlines.

In the public release some meshes lie under another capture's name, and some are turned by 90 or 180 degrees about z.
Every mesh is compared, in its four quarter turns, with every silhouette of its sample; the root-mean-square
difference of the radius-angle profiles decides. A mesh keeps its own silhouette unless that is clearly wrong and
another clearly right: captures of one drape resemble each other.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.files.entry import Entry
from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.profile import Profile

FIT_LIMIT = 0.0042  # [m] of a 30 cm cloth, 3 px of the release: right pairs differ by 0.3 to 2.6 px, wrong ones by 3.5
_SIZES = (0.5, 2.0)  # a drape's mean radius lies between half the plate's and twice the cloth's
_TIE = 0.25  # [px] lead below which the silhouette of the same name counts as the best
_ROTATION_GAIN = 0.75  # largest ratio of the difference after a turn to that before


@dataclass(frozen=True)
class MeshMatch:
    """How a mesh fits the silhouettes of its sample.

    Attributes:
        mesh: The mesh file.
        own: The silhouette of the same name, if there is one that can be read.
        own_rms, own_rotation: Its profile difference [m] at the best quarter turn [degrees about z] of the mesh.
        best: The silhouette that fits best; `own` in a tie.
        best_rms, best_rotation: Its difference [m] and turn [degrees].
        fits: Difference and turn for every silhouette of the sample, by path.
        limit: Difference up to which a mesh fits [m].
    """

    mesh: Entry
    own: Entry | None
    own_rms: float
    own_rotation: int
    best: Entry | None
    best_rms: float
    best_rotation: int
    fits: dict[str, tuple[float, int]] = field(repr=False, compare=False)
    limit: float = FIT_LIMIT

    @property
    def fits_own(self) -> bool:
        """Whether the mesh fits the silhouette of its name."""
        return self.own_rms <= self.limit

    @property
    def belongs_elsewhere(self) -> bool:
        """Whether the mesh fits another silhouette and not its own."""
        return not self.fits_own and self.best_rms <= self.limit

    @property
    def matches_none(self) -> bool:
        """Whether no silhouette of the sample fits."""
        return self.best is not None and not self.fits_own and self.best_rms > self.limit


def quarter_turns(image: Profile, mesh: Profile) -> Float[ndarray, "4"]:
    """Compares a silhouette with a mesh in its four quarter turns about z.

    Args:
        image: Profile of the silhouette.
        mesh: Profile of the mesh.

    Returns:
        Root-mean-square differences [m] with the mesh turned by 0, 90, 180, 270 degrees.
    """
    return np.array([image.rms(mesh.rotated(90 * turn)) for turn in range(4)])


def best_turn(image: Profile, mesh: Profile) -> tuple[float, int]:
    """Finds the quarter turn of a mesh that fits a silhouette best; a turn must clearly help.

    Args:
        image: Profile of the silhouette.
        mesh: Profile of the mesh.

    Returns:
        Root-mean-square difference [m] and turn [degrees].
    """
    rms = quarter_turns(image, mesh)
    turn = int(rms.argmin())
    turn = turn if rms[turn] < _ROTATION_GAIN * rms[0] else 0
    return float(rms[turn]), 90 * turn


def match_meshes(
    silhouettes: Sequence[Entry],
    meshes: Sequence[Entry],
    images: Mapping[str, Profile],
    outlines: Mapping[str, Profile],
    protocol: Protocol = RELEASE,
) -> list[MeshMatch]:
    """Compares every mesh with the silhouettes of its sample.

    Args:
        silhouettes: Silhouette files.
        meshes: Mesh files.
        images: Profiles of silhouettes by path; files without one are left out.
        outlines: Profiles of meshes by path, likewise.
        protocol: Gives scale and size of the cloth, by which differences are judged.

    Returns:
        One match a mesh.
    """
    samples: dict[tuple[str, int], list[Entry]] = defaultdict(list)
    for entry in silhouettes:
        if entry.path in images:
            samples[entry.cloth, entry.sample].append(entry)
    return [
        _match(mesh, samples[mesh.cloth, mesh.sample], images, outlines[mesh.path], protocol)
        for mesh in meshes
        if mesh.path in outlines
    ]


def _match(
    mesh: Entry, candidates: list[Entry], images: Mapping[str, Profile], outline: Profile, protocol: Protocol
) -> MeshMatch:
    fits = {entry.path: best_turn(images[entry.path], outline) for entry in candidates}
    own = next((entry for entry in candidates if entry.key == mesh.key), None)
    best = min(candidates, key=lambda entry: fits[entry.path][0], default=None)
    none = (float("inf"), 0)
    own_fit, best_fit = (fits[entry.path] if entry else none for entry in (own, best))
    if own_fit[0] - best_fit[0] < _TIE / protocol.px_per_m:
        best, best_fit = own, own_fit
    return MeshMatch(mesh, own, *own_fit, best, *best_fit, fits, FIT_LIMIT * protocol.cloth_scale)


@dataclass(frozen=True)
class Assignment:
    """The mesh of one silhouette.

    Attributes:
        mesh: Relative path, "" for none.
        rotation: Turn about z [degrees] that aligns it.
        notes: What was corrected or is in doubt.
    """

    mesh: str = ""
    rotation: int = 0
    notes: tuple[str, ...] = ()


def impossible_sizes(outlines: Mapping[str, Profile], protocol: Protocol) -> dict[str, float]:
    """Finds meshes that are of no cloth's size: those in millimetres, centimetres or inches.

    Args:
        outlines: Profiles of meshes by path.
        protocol: Gives radii of plate and cloth.

    Returns:
        Path of such a mesh -> its mean radius [m].
    """
    radii = {path: float(outline.radii.mean()) for path, outline in outlines.items()}
    least, most = _SIZES[0] * protocol.plate_radius_m, _SIZES[1] * protocol.cloth_radius_m
    return {path: radius for path, radius in radii.items() if not least < radius < most}


def assign_by_name(
    silhouettes: Sequence[Entry], meshes: Sequence[Entry], impossible: Mapping[str, float] | None = None
) -> dict[str, Assignment]:
    """Assigns to each silhouette the mesh of the same name.

    Args:
        silhouettes: Silhouette files.
        meshes: Mesh files.
        impossible: Result of `impossible_sizes`: meshes that are left out, which is noted.

    Returns:
        Path of a silhouette -> its mesh.
    """
    impossible = impossible or {}
    named = {mesh.key: Assignment(mesh.path) for mesh in reversed(meshes) if mesh.path not in impossible}
    for mesh in meshes:
        if mesh.path in impossible:
            note = f"mesh left out: mean radius {impossible[mesh.path]:.3g} m, not in metres; scale it"
            named.setdefault(mesh.key, Assignment(notes=(note,)))
    return {entry.path: named.get(entry.key, Assignment(notes=("no mesh",))) for entry in silhouettes}


def correct_assignment(
    assigned: dict[str, Assignment], matches: Sequence[MeshMatch], *, pairing: bool, rotation: bool
) -> dict[str, Assignment]:
    """Applies what the comparison found; every change is noted.

    Args:
        assigned: Result of `assign_by_name`.
        matches: Result of `match_meshes`.
        pairing: Give meshes to the silhouettes that they fit.
        rotation: Turn meshes.

    Returns:
        The corrected assignment.
    """
    corrected = dict(assigned)
    strays = {match.mesh.path: match for match in matches if pairing and match.belongs_elsewhere}
    for match in matches:
        if match.own is None or assigned[match.own.path].mesh != match.mesh.path:
            continue
        if match.mesh.path in strays:
            assert match.best is not None
            corrected[match.own.path] = Assignment(notes=(f"no mesh: {match.mesh.path} fits {match.best.path}",))
        else:
            notes = (f"mesh fits no silhouette of the sample ({_mm(match.best_rms)})",) if match.matches_none else ()
            corrected[match.own.path] = _turned(match.mesh.path, match.own_rotation, notes, rotation)
    near = ((match, path, fit) for match in strays.values() for path, fit in match.fits.items())
    offers = [(*fit, path, match.mesh) for match, path, fit in near if fit[0] <= match.limit]
    placed: set[str] = set()
    for rms, degrees, path, mesh in sorted(offers, key=lambda offer: offer[0]):
        if not corrected[path].mesh and mesh.path not in placed:
            note = f"mesh re-paired: named {mesh.path.rsplit('/', 1)[-1]} ({_mm(rms)})"
            corrected[path] = _turned(mesh.path, degrees, (note,), rotation)
            placed.add(mesh.path)
    return corrected


def _turned(mesh: str, degrees: int, notes: tuple[str, ...], rotation: bool) -> Assignment:
    if not (rotation and degrees):
        return Assignment(mesh, 0, notes)
    return Assignment(mesh, degrees, (*notes, f"mesh turned by {degrees} deg about z"))


def _mm(length: float) -> str:
    return f"{1e3 * length:.1f} mm rms"
