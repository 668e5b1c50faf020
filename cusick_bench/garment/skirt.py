"""Skirts: a circular one from a flat ring, an A-line one from two panels that are sewn together at their sides.

The wearer looks along -y. The circular skirt is one piece with one grain: it hangs on the warp in front and behind, on
the weft at the sides and on the bias in between. It starts flat at the height of the waist, as the cloth of a Cusick
test does.

An A-line panel is half the mantle of a truncated cone, unrolled: a sector of a ring, with its warp along the centre
line. Front and back share the vertices of the side seams, which have a place and a grain in either panel
(`Mesh.pattern`). The skirt starts as the cone, free of membrane strain.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from cusick_bench.garment.errors import GarmentError
from cusick_bench.garment.panel import Panel, Sector, doubled_areas, mesh_sector
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.shape import SmoothField

MINIMUM_VERTICES = 150
_ROUND_WAIST = 8  # least number of vertices of a waist that is to be round
_LEAST_AREA = 1e-12  # [m2] of a face in the plane
_LEAST_FLARE = 1e-4  # by which a cone's radius grows along its length; the apex of a narrower one is too far away
_FRONT = -np.pi / 2  # [rad] azimuth of the front panel's centre line


@dataclass(frozen=True)
class SkirtSize:
    """Measures of a skirt.

    Attributes:
        waist: Radius of the waist [m].
        length: From waist to hem along the cloth [m].
        hem: Radius of the hem of the A-line cone [m]; the circular skirt's is waist + length.

    Raises:
        GarmentError: A measure that is not positive and finite.
    """

    waist: float = 0.11
    length: float = 0.35
    hem: float = 0.22

    def __post_init__(self) -> None:
        for name in ("waist", "length", "hem"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise GarmentError(f"{name} must be > 0 m and finite, got {value}")


@dataclass(frozen=True, eq=False)
class Skirt:
    """A skirt before it falls.

    Attributes:
        kind: `circular` or `a-line`.
        size: Its measures.
        mesh: Cloth, with the material coordinates of its panels.
        start: Positions [m]; the waist in the plane z = 0 about the z axis.
        waist: Which vertices the waistband holds.
        hem: Vertices of the hem, counter-clockwise seen from above.
    """

    kind: str
    size: SkirtSize
    mesh: Mesh
    start: Float[ndarray, "vertices 3"]
    waist: Bool[ndarray, "vertices"]
    hem: Int[ndarray, "hem"]

    def measures(self) -> dict[str, float]:
        """Measures that the cut uses, by name [m]: the circular skirt has no hem of its own."""
        measures = asdict(self.size)
        return {name: measures[name] for name in measures if name != "hem" or self.kind != "circular"}

    def laid(self, field: SmoothField) -> Float[ndarray, "vertices 3"]:
        """The start with the cloth undulating across its surface; the undulation fades in below the waist.

        Args:
            field: Height of the undulation over the material [m].

        Returns:
            Positions [m].
        """
        fall = np.hypot(*(self.start[:, :2]).T) - self.size.waist
        ramp = np.clip(fall / max(fall.max(), 1e-9) / 0.2, 0, 1)
        return self.start + (field(self.mesh.material) * ramp * ramp * (3 - 2 * ramp))[:, None] * self._normal

    @property
    def _normal(self) -> Float[ndarray, "vertices 3"]:
        """Unit normals of the start: up for the ring, outwards and up for the cone."""
        if self.kind == "circular":
            return np.broadcast_to([0.0, 0.0, 1.0], self.start.shape)
        flare = (self.size.hem - self.size.waist) / self.size.length
        outwards = self.start[:, :2] / np.hypot(*self.start[:, :2].T)[:, None]
        return np.column_stack([np.sqrt(1 - flare**2) * outwards, np.full(len(self.start), flare)])


def _spacing(area: float, waist: float, vertices: int) -> float:
    """Distance between the vertices of an equilateral mesh [m]."""
    if vertices < MINIMUM_VERTICES:
        raise GarmentError(f"a skirt needs at least {MINIMUM_VERTICES} vertices, got {vertices}")
    spacing = float(np.sqrt(2 / np.sqrt(3) * area / vertices))
    narrowest = _ROUND_WAIST * spacing / (2 * np.pi)
    if waist < narrowest:
        raise GarmentError(
            f"a mesh of {vertices} vertices is too coarse for a waist of {waist:g} m in radius: with this length the "
            f"radius must be {narrowest:.2g} m or more; take a wider waist, a shorter skirt or more vertices"
        )
    return spacing


def circular_skirt(size: SkirtSize, vertices: int = 2500, *, seed: int = 0) -> Skirt:
    """Cuts a circular skirt.

    Args:
        size: Its measures.
        vertices: Size of the mesh; it has some more, 3 % at 2500, up to 20 % at 150 in a short skirt.
        seed: Seed of the mesh.

    Returns:
        The skirt.

    Raises:
        GarmentError: Too few vertices, at all or for the waist.
    """
    ring = Sector(size.waist, size.waist + size.length, 2 * np.pi)
    panel = mesh_sector(ring, _spacing(ring.area, size.waist, vertices), np.random.default_rng([seed, vertices]))
    mesh = Mesh(panel.points, panel.faces)
    start = np.column_stack([mesh.material[:, 1], -mesh.material[:, 0], np.zeros(mesh.vertices)])  # warp to the front
    return Skirt("circular", size, mesh, start, _marked(panel.inner, mesh.vertices), panel.outer)


def a_line_skirt(size: SkirtSize, vertices: int = 2500, *, seed: int = 0) -> Skirt:
    """Cuts and sews an A-line skirt of two panels.

    Args:
        size: Its measures.
        vertices: Size of the mesh; it has some more, 3 % at 2500, up to 20 % at 150 in a short skirt.
        seed: Seed of the mesh.

    Returns:
        The skirt.

    Raises:
        GarmentError: Too few vertices, at all or for so long and narrow a skirt, or a hem that is not wider than the
            waist, or so wide that the cone is flatter than a disc.
    """
    flare = (size.hem - size.waist) / size.length
    if not _LEAST_FLARE <= flare <= 1 - _LEAST_FLARE:
        raise GarmentError(
            f"the hem of an A-line skirt must be wider than its waist and narrower than waist + length, by "
            f"{_LEAST_FLARE * size.length:g} m at least, got waist {size.waist} m, hem {size.hem} m, length "
            f"{size.length} m; give radii, not girths"
        )
    opening = np.pi * (size.hem - size.waist) / size.length
    apex = size.waist * size.length / (size.hem - size.waist)  # slant from the cone's tip to the waist
    sector = Sector(apex, apex + size.length, opening)
    spacing = _spacing(2 * sector.area, size.waist, vertices)
    generator = np.random.default_rng([seed, vertices])
    front, back = (mesh_sector(sector, spacing, generator) for _ in range(2))
    numbers, count = _sew(front, back)
    pattern = np.concatenate([front.points[front.faces], back.points[back.faces]])
    faces = np.concatenate([front.faces, numbers[back.faces]])
    start = np.empty((count, 3))
    start[numbers] = _on_cone(back.points, sector, size, _FRONT + np.pi)
    start[: len(front.points)] = _on_cone(front.points, sector, size, _FRONT)
    mesh = Mesh(_unfolded(start, faces, size.waist), faces, pattern)
    waist = _marked(np.concatenate([front.inner, numbers[back.inner]]), count)
    hem = np.concatenate([front.outer, numbers[back.outer[1:-1]]])
    return Skirt("a-line", size, mesh, start, waist, hem)


KINDS: dict[str, Callable[..., Skirt]] = {"circular": circular_skirt, "a-line": a_line_skirt}


def _marked(chosen: ndarray, count: int) -> Bool[ndarray, "vertices"]:
    mark = np.zeros(count, bool)
    mark[chosen] = True
    return mark


def _sew(front: Panel, back: Panel) -> tuple[Int[ndarray, "back"], int]:
    """Numbers of the back's vertices in the whole skirt, left sides to right sides, and how many there are in all."""
    numbers = np.full(len(back.points), -1)
    numbers[back.right], numbers[back.left] = front.left, front.right
    own = np.flatnonzero(numbers < 0)
    numbers[own] = len(front.points) + np.arange(len(own))
    return numbers, len(front.points) + len(own)


def _unfolded(start: ndarray, faces: ndarray, waist: float) -> Float[ndarray, "vertices 2"]:
    """The cone in the plane without folds: from above, or as a flat ring of its length.

    From above, a cone hardly wider at its hem than at its waist is so narrow a ring that chords between vertices
    fall beyond the vertices of the next row.

    Raises:
        GarmentError: They do so in a flat ring, too.
    """
    above = start[:, :2]
    radius = np.hypot(*above.T)
    ring = above * (1 + (np.hypot(radius - waist, start[:, 2]) - (radius - waist)) / radius)[:, None]
    for plane in (above, ring):
        if (0.5 * doubled_areas(plane, faces) > _LEAST_AREA).all():
            return plane
    raise GarmentError(
        f"a mesh of {len(start)} vertices is too coarse for so long and narrow a skirt; take more vertices, a wider "
        "hem or a shorter skirt"
    )


def _on_cone(points: ndarray, sector: Sector, size: SkirtSize, centre: float) -> Float[ndarray, "vertices 3"]:
    """A panel rolled up to half a cone, its centre line at azimuth `centre` [rad]."""
    flare = (size.hem - size.waist) / size.length
    slant = np.hypot(*points.T) - sector.inner
    azimuth = centre + np.arctan2(points[:, 1], points[:, 0]) * np.pi / sector.opening
    radius = size.waist + flare * slant
    return np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), -np.sqrt(1 - flare**2) * slant])
