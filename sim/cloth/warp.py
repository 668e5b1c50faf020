"""Meshes of a cloth that lies off centre or has another cut: material points are moved between plate's edge and rim.

Vertices on the plate's edge stay on it, so that the clamp stays a circle. Beyond it the relative position t in [0, 1]
of a point between the edge and the rim, along its ray from the plate's axis, says how far it follows the rim. On an
annulus this map is one-to-one as long as no part of the rim reaches the plate. The same mesh and numbers give the same
`Mesh` object, whose analysis is then shared.

The triangles are stretched, by 2 % for a millimetre, and hinges on stretched triangles are a little stiffer along the
stretch: the change of sag by a larger cloth or a smaller plate is 7 to 20 % smaller than on a mesh made for it (400 to
2400 vertices, 8 mm).
"""

import math
from functools import lru_cache

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.errors import SimulationError

_KEPT = 32  # largest number of cached meshes
_DIGITS = 12  # of metres


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


@lru_cache(maxsize=_KEPT)
def shifted(mesh: Mesh, held: float, x: float, y: float) -> Mesh:
    """The cloth laid down with its centre elsewhere; its mass stays, since the rim is moved as a whole.

    Args:
        mesh: The cloth about the plate's axis.
        held: Radius of the plate [m].
        x, y: By how much the centre moves [m].

    Returns:
        The mesh about the plate's axis, with the same faces.

    Raises:
        SimulationError: The cloth would no longer cover the plate's edge.
    """
    return _moved(mesh, held, _way_out(mesh, held)[:, None] * np.array([x, y]))


@lru_cache(maxsize=_KEPT)
def recut(mesh: Mesh, held: float, growth: float) -> Mesh:
    """The cloth cut with another radius.

    Args:
        mesh: The cloth about the plate's axis.
        held: Radius of the plate [m].
        growth: Growth of the cloth's radius [m].

    Returns:
        The mesh, with the same faces.

    Raises:
        SimulationError: The cloth would no longer cover the plate's edge.
    """
    outward = mesh.material - cloth_circle(mesh)[0]
    distance = np.maximum(np.hypot(*outward.T), 1e-12)
    return _moved(mesh, held, (growth * _way_out(mesh, held) / distance)[:, None] * outward)


@lru_cache(maxsize=_KEPT)
def on_plate(mesh: Mesh, held: float, radius: float) -> Mesh:
    """The same cloth with its vertices arranged for another plate; the rim stays.

    Args:
        mesh: The cloth about the plate's axis, with a ring of vertices at `held`.
        held: Radius of the plate that it was made for [m].
        radius: Radius of the other plate [m].

    Returns:
        The mesh with a ring of vertices at the other plate's edge, and the same faces.

    Raises:
        SimulationError: The cloth does not cover the other plate's edge.
    """
    distance = np.maximum(np.hypot(*mesh.material.T), 1e-12)
    inside = np.minimum(distance / held, 1.0)
    moved = (radius - held) * inside * (1 - _way_out(mesh, held))
    return _moved(mesh, radius, (moved / distance)[:, None] * mesh.material)


def _way_out(mesh: Mesh, held: float) -> Float[ndarray, "vertices"]:
    """Relative position of a point between plate edge (0) and rim (1), along its ray from the plate's axis."""
    centre, radius = cloth_circle(mesh)
    distance = np.hypot(*mesh.material.T)
    along = mesh.material @ centre / np.maximum(distance, 1e-12)
    rim = along + np.sqrt(np.maximum(radius**2 - centre @ centre + along**2, 0))
    return np.clip((distance - held) / np.maximum(rim - held, 1e-12), 0.0, 1.0)


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


def _moved(mesh: Mesh, held: float, displacement: Float[ndarray, "vertices 2"]) -> Mesh:
    """The mesh with its material points displaced, and its pattern with them."""
    material = mesh.material + displacement
    nearest = float(np.hypot(*material[mesh.boundary].T).min())
    if not (math.isfinite(nearest) and nearest > held):
        raise SimulationError(
            f"the cloth must reach beyond the plate of radius {held:g} m, but its rim comes as near as {nearest:g} m; "
            "take a smaller severity, plate or shift"
        )
    return Mesh(material, mesh.faces, moved_pattern(mesh, displacement))
