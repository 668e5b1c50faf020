"""Irregular meshes: the same cloth with its interior vertices moved at random.

They reveal discretisations that are only right because errors cancel between triangles of the same shape.
"""

import numpy as np
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.warp import moved_pattern
from cusick_bench.sim.constants import PLATE_RADIUS
from cusick_bench.sim.errors import SimulationError

LARGEST_JITTER = 0.4  # largest displacement over the spacing; near a half neighbours meet
_LEAST_AREA = 0.15  # least ratio of a face's new area to its old one; slimmer triangles have large errors of their own
_ON_EDGE = 1e-9  # [m]
_MOST_ROUNDS = 30


def jittered_mesh(mesh: Mesh, share: float, *, seed: int = 0, plate_radius: float = PLATE_RADIUS) -> Mesh:
    """Moves the vertices that lie neither on the rim nor on the plate's edge; triangles keep their corners.

    Moves are uniform in a disc of radius `share` times the mean spacing. Where a face would lose most of its area, the
    moves of its corners are halved until it does not.

    Args:
        mesh: The cloth.
        share: Largest move, as a share of the spacing; from 0 to 0.4.
        seed: Seed of the moves.
        plate_radius: Radius of the plate, whose edge stays a ring of vertices [m].

    Returns:
        The irregular mesh; the same one where the share is 0.

    Raises:
        SimulationError: The share is out of range.
    """
    if not 0 <= share <= LARGEST_JITTER:
        raise SimulationError(
            f"jitter must be from 0 to {LARGEST_JITTER} of the spacing of vertices, got {share:g}: beyond that "
            "triangles turn over"
        )
    if share == 0:
        return mesh
    generator = np.random.default_rng([seed, 4])
    length = share * np.sqrt(mesh.squared_spacing) * np.sqrt(generator.uniform(size=mesh.vertices))
    direction = generator.uniform(0, 2 * np.pi, mesh.vertices)
    move = length[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
    radius = np.hypot(*mesh.material.T)
    on_plate = radius <= plate_radius + _ON_EDGE
    move[mesh.boundary] = 0
    move[np.abs(radius - plate_radius) <= _ON_EDGE] = 0
    for _ in range(_MOST_ROUNDS):
        too_far = _spoiling(mesh, mesh.material + move, on_plate, plate_radius)
        if len(too_far) == 0:
            break
        move[too_far] *= 0.5
    return Mesh(mesh.material + move, mesh.faces, moved_pattern(mesh, move))


def _spoiling(mesh: Mesh, points: ndarray, on_plate: ndarray, plate_radius: float) -> ndarray:
    """Vertices that left their side of the plate's edge, and corners of faces that lost most of their area."""
    crossed = (np.hypot(*points.T) <= plate_radius + _ON_EDGE) != on_plate
    flat = _areas(points, mesh.faces) < _LEAST_AREA * mesh.areas
    return np.unique(np.concatenate([np.flatnonzero(crossed), mesh.faces[flat].ravel()]))


def _areas(points: ndarray, faces: ndarray) -> ndarray:
    a, b, c = (points[faces[:, k]] for k in range(3))
    (p, q), (r, s) = (b - a).T, (c - a).T
    return 0.5 * (p * s - q * r)
