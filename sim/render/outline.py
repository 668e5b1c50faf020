"""Outline of the union of projected triangles, by a sweep along y through every row of pixels.

1. The number of triangles over a point changes only across *candidate* edges: boundary edges, and contour edges, whose
   two faces are projected with opposite orientation. The signed change ("jump") follows from the faces' orientations
   alone, so the jumps along any horizontal line add up to zero, however roundings fall.
2. Levels cut a row at every end of an edge and at every crossing of two edges. Between two levels the edges keep their
   order in x, and the running sum of jumps tells where the union begins and ends: there lies its outline.

A mistaken order of two edges that nearly coincide moves the outline by no more than their distance, so cloth seen
edge-on, folded onto itself or with collapsed triangles needs no special care.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.kernel_cache import numba

_ON_LEVEL = 1e-12  # a crossing nearer to a level than this fraction of the slab's height is taken to lie on it


@dataclass(frozen=True, eq=False)
class Topology:
    """Edges of a triangle list; an edge may belong to any number of faces.

    Attributes:
        edges: Vertices of each edge, smaller index first.
        face_edges: Edges of each face.
        face_directions: +1 where the face runs along the edge, -1 where against it.
    """

    edges: Int[ndarray, "edges 2"]
    face_edges: Int[ndarray, "faces 3"]
    face_directions: Int[ndarray, "faces 3"]


@lru_cache(maxsize=32)
def _topology(faces: bytes) -> Topology:
    triangles = np.frombuffer(faces, dtype=np.int64).reshape(-1, 3)
    sides = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1)
    edges, index = np.unique(np.sort(sides.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    directions = np.where(sides[..., 0] < sides[..., 1], 1, -1)
    return Topology(edges, index.reshape(-1, 3), directions)


def topology(faces: Int[ndarray, "faces 3"]) -> Topology:
    """Edges of a triangle list, remembered by content.

    Args:
        faces: Vertex indices.

    Returns:
        Its edges and their faces.
    """
    return _topology(np.ascontiguousarray(faces, dtype=np.int64).tobytes())


class Outline(NamedTuple):
    """Pieces of the outline of the union; none crosses the border of a row of pixels.

    Attributes:
        row: Row of pixels of each piece.
        ends: Lower and upper vertex (in y) of the edge that each piece lies on.
        span: From where to where in y each piece reaches [px].
        sign: +1 where the union begins to the right of the piece, -1 where it ends.
    """

    row: Int[ndarray, "pieces"]
    ends: Int[ndarray, "pieces 2"]
    span: Float[ndarray, "pieces 2"]
    sign: Int[ndarray, "pieces"]


@numba.njit(cache=True, nogil=True)
def _candidates(points, faces, edges, face_edges, face_directions):
    """Edges across which the number of covering faces changes: (lower vertex, upper vertex), jump towards +x."""
    jump = np.zeros(len(edges), np.int64)
    for f in range(len(faces)):
        a, b, c = points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        orientation = 1 if area > 0 else (-1 if area < 0 else 0)
        for side in range(3):
            # A positively oriented face lies to the left of its rising sides.
            jump[face_edges[f, side]] -= orientation * face_directions[f, side]
    ends = np.empty((len(edges), 2), np.int64)
    jumps = np.empty(len(edges), np.int64)
    count = 0
    for e in range(len(edges)):
        first, second = edges[e]
        rise = points[second, 1] - points[first, 1]
        if jump[e] != 0 and rise != 0:
            ends[count, 0], ends[count, 1] = (first, second) if rise > 0 else (second, first)
            jumps[count] = jump[e] if rise > 0 else -jump[e]
            count += 1
    return ends[:count], jumps[:count]


@numba.njit(cache=True, nogil=True)
def _edges_by_row(low, high, rows):
    """Candidates that reach into each row of pixels: CSR offsets and edges, by rising lower end within a row."""
    offset = np.zeros(rows + 1, np.int64)
    first, last = np.empty(len(low), np.int64), np.empty(len(low), np.int64)
    for e in range(len(low)):
        first[e] = int(min(max(np.floor(low[e]), 0), rows))
        last[e] = int(min(max(np.ceil(high[e]), 0), rows))
        for row in range(first[e], last[e]):
            offset[row + 1] += 1
    offset = np.cumsum(offset)
    member = np.empty(offset[-1], np.int64)
    filled = offset[:-1].copy()
    for e in np.argsort(low, kind="mergesort"):
        for row in range(first[e], last[e]):
            member[filled[row]] = e
            filled[row] += 1
    return offset, member


@numba.njit(cache=True, nogil=True)
def _sort(order, count, key, jump):
    """Insertion sort of nearly sorted edges by key; of equals, the one that enters a face comes first (no hole)."""
    for i in range(1, count):
        e = order[i]
        k = i
        while k > 0 and (key[order[k - 1]] > key[e] or (key[order[k - 1]] == key[e] and jump[order[k - 1]] < jump[e])):
            order[k] = order[k - 1]
            k -= 1
        order[k] = e


@numba.njit(cache=True, nogil=True)
def _crossings(order, count, at_bottom, at_top, fraction):
    """Bubbles edges from their order at the bottom to that at the top; each exchange is a crossing."""
    found = 0
    for i in range(1, count):
        e = order[i]
        k = i
        while k > 0 and at_top[order[k - 1]] > at_top[e]:
            other = order[k - 1]
            before, after = at_bottom[e] - at_bottom[other], at_top[other] - at_top[e]
            s = before / (before + after)
            if _ON_LEVEL < s < 1 - _ON_LEVEL:
                if found == len(fraction):
                    fraction = np.append(fraction, np.empty(found))
                fraction[found] = s
                found += 1
            order[k] = other
            k -= 1
        order[k] = e
    return np.sort(fraction[:found]), fraction


@numba.njit(cache=True, nogil=True)
def _replace(order, count, here, started, bottom, low, high):
    """Drops the edges that end at a level and adds those that start there; returns how many are in and have started."""
    kept = 0
    for i in range(count):
        if high[order[i]] > bottom:
            order[kept] = order[i]
            kept += 1
    while started < len(here) and low[here[started]] <= bottom:
        order[kept] = here[started]
        kept += 1
        started += 1
    return kept, started


@numba.njit(cache=True, nogil=True)
def _mark(order, count, jump, y, row, sign, since, pieces):
    """Finds where the union begins and ends along the order; an edge whose part in it changes leaves a piece."""
    covering = 0
    for i in range(count):
        e = order[i]
        outside = covering <= 0
        covering += jump[e]
        now = int(outside) - int(covering <= 0)
        if now != sign[e]:
            if sign[e] != 0:
                pieces.append((row, int(e), float(since[e]), float(y), int(sign[e])))
            sign[e], since[e] = now, y


@numba.njit(cache=True, nogil=True)
def _sweep(points, ends, jump, rows):
    """Pieces (row, edge, from y, to y, sign) of the outline; see the module's docstring."""
    edges = len(ends)
    low, high = points[ends[:, 0], 1], points[ends[:, 1], 1]
    start = points[ends[:, 0], 0]
    slope = (points[ends[:, 1], 0] - start) / (high - low)
    offset, member = _edges_by_row(low, high, rows)
    at_bottom, at_top, between = np.empty(edges), np.empty(edges), np.empty(edges)
    order = np.empty(edges, np.int64)
    sign, since = np.zeros(edges, np.int64), np.empty(edges)
    fraction = np.empty(64)
    pieces = [(0, 0, 0.0, 0.0, 0) for _ in range(0)]  # so that the compiler knows the type
    for row in range(rows):
        here = member[offset[row] : offset[row + 1]]
        level = np.concatenate((np.maximum(low[here], row), np.minimum(high[here], row + 1)))
        level.sort()
        active, started = 0, 0
        for k in range(len(level) - 1):
            bottom, top = level[k], level[k + 1]
            if bottom == top:
                continue
            active, started = _replace(order, active, here, started, bottom, low, high)
            for e in order[:active]:
                at_bottom[e] = start[e] + (bottom - low[e]) * slope[e]
                at_top[e] = start[e] + (top - low[e]) * slope[e]
            _sort(order, active, at_bottom, jump)
            crossing, fraction = _crossings(order, active, at_bottom, at_top, fraction)
            below = 0.0
            for above in np.append(crossing, 1.0):
                middle = 0.5 * (below + above)
                for e in order[:active]:
                    between[e] = (1 - middle) * at_bottom[e] + middle * at_top[e]
                _sort(order, active, between, jump)
                _mark(order, active, jump, bottom + below * (top - bottom), row, sign, since, pieces)
                below = above
            for e in order[:active]:
                if sign[e] != 0 and top >= min(high[e], row + 1):
                    pieces.append((row, int(e), float(since[e]), float(top), int(sign[e])))
                    sign[e] = 0
    return pieces


@numba.njit(cache=True, nogil=True)
def _trace(points, faces, edges, face_edges, face_directions, rows):
    """Kernel of `outline`."""
    ends, jump = _candidates(points, faces, edges, face_edges, face_directions)
    pieces = _sweep(points, ends, jump, rows)
    row, sign = np.empty(len(pieces), np.int64), np.empty(len(pieces), np.int64)
    vertices, span = np.empty((len(pieces), 2), np.int64), np.empty((len(pieces), 2))
    for i, piece in enumerate(pieces):
        row[i], sign[i] = piece[0], piece[4]
        vertices[i] = ends[piece[1]]
        span[i, 0], span[i, 1] = piece[2], piece[3]
    return row, vertices, span, sign


def outline(points: Float[ndarray, "vertices 2"], faces: Int[ndarray, "faces 3"], rows: int) -> Outline:
    """Outline of the union of triangles within 0 <= y <= rows.

    Args:
        points: Vertices (x, y) [px]; pixel (row, column) covers [column, column + 1] x [row, row + 1].
        faces: Vertex indices, oriented either way.
        rows: Height of the image [px].

    Returns:
        The outline, holes included, cut into pieces.
    """
    t = topology(faces)
    return Outline(*_trace(points, faces, t.edges, t.face_edges, t.face_directions, rows))
