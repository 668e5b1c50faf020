"""Moves a ring of vertices onto the plate's edge, in meshes that have none there.

The ring is the closed path of edges around the plate with the least cost. A vertex costs its squared distance from the
plate's circle in edge lengths, plus a constant, so that the path makes no detours; an edge costs the square of its
radial extent, so that the path does not change between rows of vertices without need. The vertices of the path are
moved onto the circle along their rays; the others follow by a harmonic displacement that vanishes on the rim.
"""

from functools import lru_cache

import numpy as np
import scipy.sparse as sparse
from numpy import ndarray
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import spsolve

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.errors import SimulationError

_KEPT = 32  # largest number of cached meshes
_VERTEX_COST = 0.1  # constant cost of every vertex of the path [squared edge lengths]
_STEP_COST = 1.0  # factor on the squared radial extent of an edge, in edge lengths
_SEARCHED = 1.5  # width of the band that is searched on either side of the circle [edge lengths]
_FLATTEST = 0.1  # least ratio of a face's new area to its old one


@lru_cache(maxsize=_KEPT)
def conformed(mesh: Mesh, plate_radius: float) -> Mesh:
    """The cloth with its nearest ring of vertices moved onto the plate's edge.

    Args:
        mesh: The cloth about the plate's axis, of one piece.
        plate_radius: Radius of the plate [m].

    Returns:
        The mesh with moved vertices and the same faces.

    Raises:
        SimulationError: Seams, no ring of edges near the plate's edge, or triangles that would fold.
    """
    remedy = "take a finer mesh, disc_mesh or ring_mesh"
    if mesh.pattern is not None:
        raise SimulationError("only cloth of one piece can be conformed to a plate, but the mesh has a pattern (seams)")
    ring = _nearest_ring(mesh, plate_radius)
    if ring is None:
        raise SimulationError(f"no closed path of edges runs along the plate's edge of {plate_radius:g} m; {remedy}")
    displacement = np.zeros((mesh.vertices, 2))
    distance = np.hypot(*mesh.material[ring].T)
    displacement[ring] = mesh.material[ring] * (plate_radius / distance - 1)[:, None]
    given = np.zeros(mesh.vertices, bool)
    given[ring] = given[mesh.boundary] = True
    material = mesh.material + _harmonic(mesh, displacement, given)
    material[ring] *= (plate_radius / np.hypot(*material[ring].T))[:, None]
    moved = material[mesh.faces]
    first, second = moved[:, 1] - moved[:, 0], moved[:, 2] - moved[:, 0]
    area = 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    worst = int(np.argmin(area / mesh.areas))
    if area[worst] < _FLATTEST * mesh.areas[worst]:
        raise SimulationError(
            f"face {worst} would keep {area[worst] / mesh.areas[worst]:.0%} of its area (at least {_FLATTEST:.0%}) "
            f"with a ring of vertices on the plate's edge of {plate_radius:g} m; {remedy}"
        )
    side = np.sign(np.hypot(*material.T) - plate_radius)
    side[ring] = 0
    if (crossing := np.flatnonzero(side[mesh.edges].prod(1) < 0)).size:
        start, end = mesh.edges[crossing[0]]
        raise SimulationError(
            f"edge {start}-{end} would still cross the plate's edge of {plate_radius:g} m, although a ring of vertices "
            f"lies there; {remedy}"
        )
    return Mesh(material, mesh.faces)


def _nearest_ring(mesh: Mesh, plate_radius: float) -> ndarray | None:
    """Vertices of the cheapest closed path of edges around the plate's axis, within some edges of its circle."""
    length = np.linalg.norm(np.diff(mesh.material[mesh.edges], axis=1), axis=2).mean()
    gap = (np.hypot(*mesh.material.T) - plate_radius) / length
    near = np.abs(gap) < _SEARCHED
    near[mesh.boundary] = False
    edges = mesh.edges[near[mesh.edges].all(1)]
    edges = np.concatenate([edges, edges[:, ::-1]])
    if not len(edges):
        return None
    x, y = mesh.material.T
    start, end = edges.T
    area = x[start] * y[end] - y[start] * x[end]
    upward, downward = (y[start] < 0) & (y[end] >= 0), (y[start] >= 0) & (y[end] < 0)
    # Two copies of the vertices: a way around the axis leads from the first to the second across the ray y = 0, x > 0.
    right = (x[start] * (y[end] - y[start]) - y[start] * (x[end] - x[start])) * np.sign(y[end] - y[start]) > 0
    forth, back = upward & right & (area > 0), downward & right
    cost = gap[end] ** 2 + _VERTEX_COST + _STEP_COST * (gap[end] - gap[start]) ** 2
    stay = ~forth & ~back
    count = mesh.vertices
    rows = np.concatenate([start[stay], start[stay] + count, start[forth]])
    columns = np.concatenate([end[stay], end[stay] + count, end[forth] + count])
    values = np.concatenate([cost[stay], cost[stay], cost[forth]])
    graph = sparse.csr_array((values, (rows, columns)), shape=(2 * count, 2 * count))
    origins = np.unique(end[forth])
    if not len(origins):
        return None
    costs, before = dijkstra(graph, indices=origins, return_predecessors=True)
    around = costs[np.arange(len(origins)), origins + count]
    best = int(np.argmin(around))
    if not np.isfinite(around[best]):
        return None
    path = [int(origins[best]) + count]
    while path[-1] != origins[best]:
        path.append(int(before[best, path[-1]]))
    return np.unique(np.array(path) % count)


def _harmonic(mesh: Mesh, displacement: ndarray, given: ndarray) -> ndarray:
    """The displacement that is given at some vertices and the mean of the neighbours' at the others."""
    start, end = mesh.edges.T
    ones = np.ones(len(start))
    adjacency = sparse.coo_array((ones, (start, end)), shape=(mesh.vertices, mesh.vertices))
    adjacency = sparse.csr_array(adjacency + adjacency.T)
    laplacian = sparse.csr_array(sparse.diags_array(adjacency.sum(1)) - adjacency)
    open_ones = np.flatnonzero(~given)
    if not len(open_ones):
        return displacement
    rows = laplacian[open_ones]
    right = -(rows[:, np.flatnonzero(given)] @ displacement[given])
    solved = displacement.copy()
    solved[open_ones] = spsolve(sparse.csc_array(rows[:, open_ones]), right)
    return solved
