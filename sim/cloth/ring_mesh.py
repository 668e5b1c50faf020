"""Meshes of the cloth disc in staggered rings of equal vertex number between the plate's edge and the rim.

Outside the plate every vertex has six neighbours, where Loop's surfaces are regular and errors fall smoothly with the
number of vertices. The rings stand closer at the clamp, where curvature is largest; inside the plate, where the cloth
only lies, there are as few vertices as decent triangles need.
"""

from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS
from cusick_bench.sim.errors import SimulationError

_MINIMUM_VERTICES = 60
_FEWEST_RINGS = 2  # least number of rings beyond the plate's edge
_GRADING = 0.12  # the distance of rings is 1 - this at the clamp and 1 + this at the rim, times the mean
_PER_RING = 13.0  # vertices of a ring over the number of rings beyond the plate's edge, for the nominal radii
_INSIDE = 0.5  # least number of vertices inside the plate, over that of a ring
_CROWDING = 0.3  # exponent of the radii inside; 0.5 would be even, smaller ones crowd vertices at the plate's edge
_INSIDE_GAP = 1.2  # distance of the outermost inner vertices from the plate's edge [edge lengths of the ring there]
_LARGEST_JITTER = 0.4  # largest displacement over the spacing
_GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


@lru_cache(maxsize=16)
def ring_mesh(
    vertices: int = 1205,
    *,
    seed: int = 0,
    radius: float = CLOTH_RADIUS,
    plate_radius: float = PLATE_RADIUS,
    jitter: float = 0.0,
) -> Mesh:
    """Meshes the cloth disc in staggered rings: regular outside the plate, finer at the clamp.

    Args:
        vertices: Number of vertices of the mesh, met exactly; at least 60.
        seed: Another seed turns the rings by another angle, and moves vertices otherwise where there is jitter.
        radius: Cloth radius [m].
        plate_radius: Plate radius [m], 0 < plate_radius < radius.
        jitter: Largest displacement of the vertices between the clamp and the rim along each axis, as a share of the
            distance to the next ring or vertex; from 0 to 0.4.

    Returns:
        The mesh; its first vertices are the rim, then the plate ring.

    Raises:
        SimulationError: Too few vertices, radii out of order, a plate too near the rim or too small, too much jitter.
    """
    if vertices < _MINIMUM_VERTICES:
        raise SimulationError(f"a disc needs at least {_MINIMUM_VERTICES} vertices, got {vertices}")
    if not 0 < plate_radius < radius < np.inf:
        raise SimulationError(f"radii must satisfy 0 < plate < cloth, got plate {plate_radius} m and cloth {radius} m")
    if not 0 <= jitter <= _LARGEST_JITTER:
        raise SimulationError(f"jitter must lie from 0 to {_LARGEST_JITTER} of the spacing, got {jitter}")
    rings, number = _ring_numbers(vertices, radius, plate_radius)
    generator = np.random.default_rng([seed, vertices])
    phase = generator.uniform(0, 2 * np.pi)
    share = np.arange(rings + 1) / rings
    radii = plate_radius + (radius - plate_radius) * share * (1 - _GRADING + _GRADING * share)
    angles = phase + 2 * np.pi * (np.arange(number) + 0.5 * (np.arange(rings + 1)[:, None] % 2)) / number
    points = np.stack([np.cos(angles), np.sin(angles)], axis=2) * radii[:, None, None]
    gap = np.minimum(np.diff(radii)[:-1], 2 * np.pi * radii[1:-1] / number)
    points[1:-1] += generator.uniform(-1, 1, (rings - 1, number, 2)) * (jitter * gap)[:, None, None]
    inside = _inside(vertices - points.shape[0] * number, plate_radius, number, phase)
    # The rim first, then the plate's ring, those inside, and the rings between.
    order = np.concatenate([[rings, 0], np.arange(1, rings)])
    place = np.empty((rings + 1, number), np.int64)
    place[order] = np.arange((rings + 1) * number).reshape(-1, number)
    place[1:-1] += len(inside)
    outer = points[order].reshape(-1, 2)
    material = np.concatenate([outer[: 2 * number], inside, outer[2 * number :]])
    held = np.arange(number, 2 * number + len(inside))
    faces = np.concatenate([_between(place), held[_plate_faces(material[held])]])
    try:
        return Mesh(material, faces)
    except SimulationError as error:  # a face that is clockwise or has no area
        if jitter:
            ring_mesh(vertices, seed=seed, radius=radius, plate_radius=plate_radius)  # or says that rings do not fit
            raise SimulationError(
                f"jitter of {jitter:g} turns triangles of this mesh over ({error}); take less of it, or another seed"
            ) from error
        remedy = "more vertices or a smaller plate" if plate_radius > radius / 2 else "a larger plate"
        raise SimulationError(
            f"no mesh of {rings + 1} rings of {number} vertices fits between a plate of {plate_radius:g} m and the rim "
            f"of a cloth of {radius:g} m ({error}); take {remedy}"
        ) from error


def _ring_numbers(vertices: int, radius: float, plate_radius: float) -> tuple[int, int]:
    """Number of rings beyond the plate's edge, and of vertices in each ring."""
    nominal = (CLOTH_RADIUS - PLATE_RADIUS) / (CLOTH_RADIUS + PLATE_RADIUS)
    wanted = _PER_RING * nominal * (radius + plate_radius) / (radius - plate_radius)
    rings = np.arange(_FEWEST_RINGS, max(_FEWEST_RINGS, int(np.sqrt(vertices))) + 1)
    number = (vertices / (rings + 1 + _INSIDE)).astype(int)
    best = int(np.argmin(np.abs(np.log(number / rings / wanted))))
    return int(rings[best]), int(number[best])


def _inside(count: int, plate_radius: float, number: int, phase: float) -> ndarray:
    """Vertices inside the plate on a spiral, denser towards its edge."""
    outermost = plate_radius * (1 - _INSIDE_GAP * 2 * np.pi / number)
    distance = outermost * ((np.arange(count) + 0.5) / (count - 0.5)) ** _CROWDING
    angle = phase + _GOLDEN_ANGLE * np.arange(count)
    return distance[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def _between(place: ndarray) -> ndarray:
    """Faces between consecutive rings; every second ring is turned by half a vertex."""
    faces = []
    for ring, (inner, outer) in enumerate(pairwise(place)):
        inner_next, outer_next = np.roll(inner, -1), np.roll(outer, -1)
        if ring % 2 == 0:  # the outer ring is ahead
            faces += [(inner, outer, inner_next), (outer, outer_next, inner_next)]
        else:
            faces += [(inner, outer, outer_next), (inner, outer_next, inner_next)]
    return np.concatenate([np.column_stack(corners) for corners in faces])


def _plate_faces(points: ndarray) -> ndarray:
    from scipy.spatial import Delaunay

    faces = Delaunay(points).simplices.astype(np.int64)
    first, second = points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    faces[area < 0] = faces[area < 0][:, ::-1]
    return faces
