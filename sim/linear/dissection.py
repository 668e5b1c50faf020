"""Nested dissection: an elimination order with little fill, from the positions of the vertices.

A line cuts the mesh in two; the fewest vertices that touch every coupling across it are its separator. Both
sides are cut again until a piece is small. With pieces eliminated before their separators, the factor of a
plane mesh has O(n log n) numbers.

References:
    A. George, "Nested dissection of a regular finite element mesh", SIAM J. Numer. Anal. 10 (1973).
    J. R. Gilbert, G. L. Miller, S.-H. Teng, "Geometric mesh partitioning", SIAM J. Sci. Comput. 19 (1998).
    A. Pothen, C.-J. Fan, "Computing the block triangular form of a sparse matrix", ACM Trans. Math. Softw. 16
        (1990): separators from matchings.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.sparse.csgraph import maximum_bipartite_matching

from cusick_bench.sim.linear.interface import BlockPattern

DIRECTIONS = 32
"""Cuts tried at each level, evenly round the circle; opposite ones differ in the side that is judged."""

LEFT_SHARES = (0.42, 0.46, 0.5, 0.54, 0.58)
"""Shares of the vertices on the left that are tried; a somewhat uneven cut may have the smaller separator."""


@dataclass(frozen=True)
class Dissection:
    """Elimination order as a forest of fronts, children before parents.

    Attributes:
        order: Vertices in elimination order.
        start: First position in `order` of every front, and the end.
        parent: Front that is eliminated after this one, -1 at a root.
    """

    order: Int[ndarray, " vertices"]
    start: Int[ndarray, " fronts_and_end"]
    parent: Int[ndarray, " fronts"]


def dissect(pattern: BlockPattern, leaf: int) -> Dissection:
    """Order a pattern by nested dissection.

    Args:
        pattern: The coupled vertices with their positions.
        leaf: Pieces of at most this many vertices are not cut any more.

    Returns:
        The order, and the tree of separators.
    """
    entries = (np.ones(pattern.slots, np.float32), pattern.indices, pattern.indptr)
    graph = sparse.csr_array(entries, shape=(pattern.vertices, pattern.vertices))
    fronts: list[ndarray] = []
    parent: list[int] = []

    def cut(vertices: ndarray, graph: sparse.csr_array) -> list[int]:
        """Append the fronts of one piece; returns their roots (several where the piece falls apart)."""
        own, children = vertices, []
        if len(vertices) > leaf:
            left = _best_cut(pattern.points[vertices], graph)
            separator = _separator(left, graph)
            for side in (left & ~separator, ~left & ~separator):
                if side.any():
                    children += cut(vertices[side], graph[side][:, side])
            own = _along(vertices[separator], pattern.points)
        if not len(own):
            return children
        for child in children:
            parent[child] = len(fronts)
        fronts.append(own)
        parent.append(-1)
        return [len(fronts) - 1]

    cut(np.arange(pattern.vertices), graph)
    start = np.concatenate([[0], np.cumsum([len(own) for own in fronts])])
    return Dissection(np.concatenate(fronts), start, np.array(parent))


def _best_cut(points: Float[ndarray, "vertices 2"], graph: sparse.csr_array) -> Bool[ndarray, " vertices"]:
    """Left side of the straight cut where the fewest vertices on the left touch the right."""
    angles = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    heights = points @ np.stack([np.cos(angles), np.sin(angles)])
    rank = np.argsort(np.argsort(heights, axis=0, kind="stable"), axis=0)
    left = np.hstack([rank < max(1, int(share * len(points))) for share in LEFT_SHARES])
    touching = (left & (graph @ (~left).astype(np.float32) > 0)).sum(axis=0)
    unevenness = 1 + np.abs(np.repeat(LEFT_SHARES, DIRECTIONS) - 0.5)
    return left[:, np.argmin(touching * unevenness)]


def _separator(left: Bool[ndarray, " vertices"], graph: sparse.csr_array) -> Bool[ndarray, " vertices"]:
    """The fewest vertices, on either side, that touch every coupling across a cut.

    By Koenig's theorem they are as many as the largest matching of couplings across has: walk alternating
    paths from the unmatched vertices of the left; take the left vertices not reached and the right ones
    reached.
    """
    left_vertices, right_vertices = np.flatnonzero(left), np.flatnonzero(~left)
    across = sparse.csr_array(graph[left][:, ~left])
    partner = maximum_bipartite_matching(across, perm_type="column")
    matched = np.flatnonzero(partner >= 0)
    back = np.full(len(right_vertices), -1)
    back[partner[matched]] = matched
    reached_left = partner < 0
    while True:
        reached_right = across.T @ reached_left.astype(np.float32) > 0
        onwards = reached_left.copy()
        onwards[back[reached_right]] = True  # all have partners, or the matching could grow
        if np.array_equal(onwards, reached_left):
            break
        reached_left = onwards
    separator = np.zeros(len(left), bool)
    separator[left_vertices[~reached_left]] = True
    separator[right_vertices[reached_right]] = True
    return separator


def _along(vertices: Int[ndarray, " some"], points: Float[ndarray, "vertices 2"]) -> Int[ndarray, " some"]:
    """Vertices of a separator from one end to the other, so that neighbours lie side by side in memory."""
    if not len(vertices):
        return vertices
    centred = points[vertices] - points[vertices].mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    return vertices[np.argsort(centred @ axes[:, 1], kind="stable")]
