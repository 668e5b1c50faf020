"""Counts edges of a cloth that pierce its triangles, to find out whether it passes through itself.

An edge pq pierces the triangle abc if the tetrahedra abcp and abcq have volumes of opposite sign and the line through p
and q passes all three sides of abc on the same side. Edges and triangles that share a vertex are not tested, and those
in one plane do not count: on a sloping plate rounding may put the ends of an edge on opposite sides of a triangle. The
test is independent of how contacts are computed, so that it can be used to check them.

References:
    Segura, Feito. Algorithms to test ray-triangle intersection: comparative study. WSCG 2001 (signed volumes).
"""

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.kernel_cache import numba

_IN_PLANE = 1e-12  # [m] height over a triangle's plane that counts as rounding


@numba.njit(cache=True)
def _volume(a, b, c, d):
    """Six times the signed volume of a tetrahedron."""
    x0, y0, z0 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    x1, y1, z1 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    x2, y2, z2 = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    return x0 * (y1 * z2 - z1 * y2) + y0 * (z1 * x2 - x1 * z2) + z0 * (x1 * y2 - y1 * x2)


@numba.njit(cache=True)
def _pierces(p, q, a, b, c):
    """Whether the edge pq passes through the triangle abc, its sides included."""
    of_p, of_q = _volume(a, b, c, p), _volume(a, b, c, q)
    if of_p * of_q >= 0:
        return False
    longest = max(((a - b) ** 2).sum(), ((b - c) ** 2).sum(), ((c - a) ** 2).sum())
    if max(abs(of_p), abs(of_q)) <= _IN_PLANE * longest:
        return False
    past_ab, past_bc, past_ca = _volume(p, q, a, b), _volume(p, q, b, c), _volume(p, q, c, a)
    return (past_ab >= 0 and past_bc >= 0 and past_ca >= 0) or (past_ab <= 0 and past_bc <= 0 and past_ca <= 0)


@numba.njit(cache=True)
def _piercings(x, edges, faces, edge_low, order, reach, found):
    """Writes the pairs (edge, face) that intersect to `found` while there is room; returns how many there are.

    Edges come sorted by their lowest x: those that can touch a face are neighbours in that order.
    """
    count = 0
    sorted_low = edge_low[order]
    for face in range(faces.shape[0]):
        a, b, c = faces[face]
        low, high = np.empty(3), np.empty(3)
        for axis in range(3):
            low[axis] = min(x[a, axis], x[b, axis], x[c, axis])
            high[axis] = max(x[a, axis], x[b, axis], x[c, axis])
        first = np.searchsorted(sorted_low, low[0] - reach)
        for place in range(first, order.shape[0]):
            if sorted_low[place] > high[0]:
                break
            edge = order[place]
            p, q = edges[edge]
            if p in (a, b, c) or q in (a, b, c):
                continue
            apart = False
            for axis in range(3):
                if max(x[p, axis], x[q, axis]) < low[axis] or min(x[p, axis], x[q, axis]) > high[axis]:
                    apart = True
            if not apart and _pierces(x[p], x[q], x[a], x[b], x[c]):
                if count < found.shape[0]:
                    found[count, 0], found[count, 1] = edge, face
                count += 1
    return count


def piercing_pairs(mesh: Mesh, x: Float[ndarray, "vertices 3"]) -> Int[ndarray, "pairs 2"]:
    """All pairs (row of `mesh.edges`, row of `mesh.faces`) that intersect.

    Args:
        mesh: The cloth.
        x: Positions [m].

    Returns:
        The pairs.

    Raises:
        SimulationError: Positions of another mesh, or not finite.
    """
    x = checked_positions(mesh, x)
    edges = mesh.edges
    along = x[edges, 0]
    low = along.min(1)
    order = np.argsort(low, kind="stable")
    reach = float((along.max(1) - low).max())
    found = np.empty((0, 2), np.int64)
    while (count := _piercings(x, edges, mesh.faces, low, order, reach, found)) > len(found):
        found = np.empty((count, 2), np.int64)
    return found


def intersections(mesh: Mesh, x: Float[ndarray, "vertices 3"]) -> int:
    """Number of pairs of an edge and a triangle that intersect; 0 if the cloth nowhere passes through itself.

    Args:
        mesh: The cloth.
        x: Positions [m].

    Returns:
        Number of pairs.
    """
    return len(piercing_pairs(mesh, x))


def checked_positions(mesh: Mesh, x: Float[ndarray, "vertices 3"]) -> Float[ndarray, "vertices 3"]:
    """Positions as the kernels take them.

    Args:
        mesh: The cloth.
        x: Positions [m].

    Returns:
        The same positions, contiguous, in double precision.

    Raises:
        SimulationError: Positions of another mesh, or not finite.
    """
    x = np.ascontiguousarray(x, dtype=np.float64)
    if x.shape != (mesh.vertices, 3) or not np.isfinite(x).all():
        raise SimulationError(f"positions must be finite with shape ({mesh.vertices}, 3), got shape {x.shape}")
    return x
