"""Meshes of a cloth that lies off centre, has another cut or lies on another plate: their material points are moved.

Vertices on the plate's edge follow the edge, and those on the rim follow the rim. Between them a point follows both, in
the proportions 1 - t and t, where t in [0, 1] is its relative position in the mesh as it was made, along its ray from
the plate's axis. On an annulus this map is one-to-one as long as no part of the rim reaches the plate. Several moves
are one, in whichever order they come. The same mesh and numbers give the same `Mesh` object, whose analysis is then
shared.

The triangles are stretched, by 2 % for a millimetre, and hinges on stretched triangles are a little stiffer along the
stretch: the change of sag by a larger cloth or a smaller plate is 7 to 20 % smaller than on a mesh made for it (400 to
2400 vertices, 8 mm).
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.errors import SimulationError

_KEPT = 32  # largest number of cached meshes
_DIGITS = 12  # of metres
_SAME = 1e-12  # m: what rounding changes in coordinates


def cloth_circle(mesh: Mesh) -> tuple[Float[ndarray, "2"], float]:
    """Centre and radius of the rim [m]: its area's centroid, and the mean distance of its vertices from there.

    Args:
        mesh: The cloth.

    Returns:
        Centre and radius.
    """
    rim = mesh.material[mesh.boundary]
    following = np.roll(rim, -1, axis=0)
    twice = rim[:, 0] * following[:, 1] - rim[:, 1] * following[:, 0]
    centre = ((rim + following) * twice[:, None]).sum(0) / (3 * twice.sum())
    return centre, float(np.hypot(*(rim - centre).T).mean())


def about_centre(mesh: Mesh, points: Float[ndarray, "points 2"]) -> Float[ndarray, "points 2"]:
    """Material points seen from the cloth's centre, which may lie beside the plate's axis.

    Args:
        mesh: The cloth.
        points: Points about the plate's axis [m].

    Returns:
        Points about the cloth's centre [m]; the same numbers where the cloth lies centred.
    """
    return points - np.round(cloth_circle(mesh)[0], _DIGITS)  # 0 but for rounding where the cloth lies centred


@dataclass(frozen=True)
class Placing:
    """How a cloth lies on a plate, compared with the mesh that was made for it.

    Attributes:
        made: The mesh as it was made, about the plate's axis, with a ring of vertices at the plate's edge.
        held: Radius of the plate that it was made for [m].
        plate: Radius of the plate that it lies on [m].
        x, y: By how much the cloth's centre has moved [m].
        growth: By how much the cloth's radius has grown [m].
    """

    made: Mesh
    held: float
    plate: float
    x: float = 0.0
    y: float = 0.0
    growth: float = 0.0

    def displacement(self) -> Float[ndarray, "vertices 2"]:
        """By how much the material points of the made mesh have moved [m]."""
        points, way = self.made.material, _way_out(self.made, self.held)
        shift = way[:, None] * np.array([self.x, self.y])
        outward = points - cloth_circle(self.made)[0]
        growth = (self.growth * way / _distance(outward))[:, None] * outward
        distance = _distance(points)
        edge = (self.plate - self.held) * np.minimum(distance / self.held, 1.0) * (1 - way)
        return shift + growth + (edge / distance)[:, None] * points

    def is_of(self, mesh: Mesh, held: float) -> bool:
        """Whether a mesh lies as this says.

        Args:
            mesh: A mesh.
            held: Radius of its plate [m].

        Returns:
            Whether it has these material points and this plate.
        """
        points = self.made.material
        if held != self.plate or mesh.material.shape != points.shape:
            return False
        return bool(np.allclose(mesh.material, points + self.displacement(), rtol=0, atol=_SAME))


@lru_cache(maxsize=_KEPT)
def moved(mesh: Mesh, before: Placing, after: Placing) -> Mesh:
    """The mesh of a cloth that is laid elsewhere, cut with another radius, or laid on another plate.

    Its mass changes with its cut only, since a shift moves the rim as a whole.

    Args:
        mesh: The cloth about the plate's axis.
        before: How it lies.
        after: How it is to lie, compared with the same made mesh.

    Returns:
        The mesh about the plate's axis, with the same faces, and its pattern moved with it.

    Raises:
        SimulationError: The cloth would not reach beyond the plate's edge everywhere.
    """
    displacement = after.displacement() - before.displacement()
    material = mesh.material + displacement
    nearest = float(np.hypot(*material[mesh.boundary].T).min())
    why = (
        f"the cloth must reach beyond the plate of radius {after.plate:g} m, but its rim comes as near as "
        f"{nearest:g} m; take a smaller severity, plate or shift"
    )
    if not (math.isfinite(nearest) and nearest > after.plate):
        raise SimulationError(why)
    try:
        return Mesh(material, mesh.faces, moved_pattern(mesh, displacement))
    except SimulationError as error:  # the rim is a polygon: triangles turn over a little before it meets the plate
        raise SimulationError(why) from error


def moved_pattern(mesh: Mesh, displacement: Float[ndarray, "vertices 2"]) -> Float[ndarray, "faces 3 2"] | None:
    """The pattern of a mesh whose material points are displaced: each face's corners move in their own grain.

    Args:
        mesh: The cloth.
        displacement: Displacements of its material points [m].

    Returns:
        Material coordinates of every face's corners [m]; None where the mesh has no pattern of its own.
    """
    if mesh.pattern is None:
        return None
    first, own = mesh.material[mesh.faces], mesh.pattern
    sides, images = first[:, 1:] - first[:, :1], own[:, 1:] - own[:, :1]
    return own + displacement[mesh.faces] @ (np.linalg.inv(sides) @ images)


def _way_out(mesh: Mesh, held: float) -> Float[ndarray, "vertices"]:
    """Relative position of a point between plate edge (0) and rim (1), along its ray from the plate's axis."""
    centre, radius = cloth_circle(mesh)
    distance = np.hypot(*mesh.material.T)
    along = mesh.material @ centre / np.maximum(distance, 1e-12)
    rim = along + np.sqrt(np.maximum(radius**2 - centre @ centre + along**2, 0))
    return np.clip((distance - held) / np.maximum(rim - held, 1e-12), 0.0, 1.0)


def _distance(points: Float[ndarray, "points 2"]) -> Float[ndarray, "points"]:
    """Distance from the origin [m], never 0."""
    return np.maximum(np.hypot(*points.T), 1e-12)
