"""Places of element blocks in the global matrix, and of element vectors at the vertices."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from cusick_bench.sim.engine.triangles.elements import Elements


@dataclass(frozen=True, eq=False)
class BlockLayout:
    """The 3x3 block sparsity of the free vertices, and which element blocks add up in each slot.

    Attributes:
        indptr: Row pointers of the full symmetric block pattern (CSR).
        indices: Column of every slot, sorted within a row.
        diagonal: Slot of every diagonal block.
        contribution_ptr: Start of every slot's contributions.
        contributions: 9 f + 3 a + b for block (a, b) of face f; behind all faces 16 h + 4 a + b for hinge h.
    """

    indptr: Int[ndarray, "rows_plus_one"]
    indices: Int[ndarray, "slots"]
    diagonal: Int[ndarray, "rows"]
    contribution_ptr: Int[ndarray, "slots_plus_one"]
    contributions: Int[ndarray, "contributions"]


def block_layout(elements: Elements, free: Int[ndarray, "rows"], vertices: int) -> BlockLayout:
    """Lays out the block matrix of the free vertices; blocks that touch a fixed vertex are dropped.

    Args:
        elements: The mesh's elements.
        free: Indices of the free vertices, ascending; row r of the matrix is vertex free[r].
        vertices: Number of all vertices.

    Returns:
        The pattern, and where every element's blocks go.
    """
    row_of = np.full(vertices, -1)
    row_of[free] = np.arange(len(free))
    rows, columns = [], []
    for corners in (elements.faces, elements.hinges):
        count = corners.shape[1]
        rows.append(row_of[np.repeat(corners, count, axis=1)].ravel())
        columns.append(row_of[np.tile(corners, (1, count))].ravel())
    row, column = np.concatenate(rows), np.concatenate(columns)
    kept = np.flatnonzero((row >= 0) & (column >= 0))
    key = row[kept] * len(free) + column[kept]
    # A free vertex always has a face, hence a diagonal block.
    unique, slot = np.unique(key, return_inverse=True)
    order = np.argsort(slot, kind="stable")
    slot_row, slot_column = unique // len(free), unique % len(free)
    return BlockLayout(
        indptr=np.searchsorted(slot_row, np.arange(len(free) + 1)),
        indices=slot_column,
        diagonal=np.flatnonzero(slot_row == slot_column),
        contribution_ptr=np.searchsorted(slot[order], np.arange(len(unique) + 1)),
        contributions=kept[order],
    )


@dataclass(frozen=True, eq=False)
class GatherTables:
    """What every slot and every vertex sums up, for the kernels of `assembly`. `x_start[i] : x_start[i + 1]` is i's.

    Attributes:
        slots: Slots that the linear solver reads, ascending.
        vertex: Vertex whose diagonal block a slot is, or -1.
        face_start, face_terms: 16 f + 2 b + t for block b of face f, transposed where t = 1.
        hinge_start, hinge_terms: 1024 h + 128 first + 32 second + 2 b + t for block b, of corners first and second.
        face_corner_start, face_corners: 3 f + corner, for every vertex.
        hinge_corner_start, hinge_corners: 4 h + corner.
    """

    slots: Int[ndarray, "needed"]
    vertex: Int[ndarray, "needed"]
    face_start: Int[ndarray, "needed_and_end"]
    face_terms: Int[ndarray, "face_terms"]
    hinge_start: Int[ndarray, "needed_and_end"]
    hinge_terms: Int[ndarray, "hinge_terms"]
    face_corner_start: Int[ndarray, "vertices_and_end"]
    face_corners: Int[ndarray, "face_corners"]
    hinge_corner_start: Int[ndarray, "vertices_and_end"]
    hinge_corners: Int[ndarray, "hinge_corners"]


def _upper_blocks(corners: int) -> tuple[ndarray, ndarray]:
    """Number of the stored block of corners (a, b), and whether it is to be transposed."""
    block, turned = np.zeros((corners, corners), np.int64), np.zeros((corners, corners), np.int64)
    for number, (a, b) in enumerate(zip(*np.triu_indices(corners), strict=True)):
        block[a, b] = block[b, a] = number
        turned[b, a] = int(a != b)
    return block, turned


def gather_tables(
    elements: Elements, layout: BlockLayout, needed: Int[ndarray, "needed"], free: Int[ndarray, "rows"], vertices: int
) -> GatherTables:
    """Sorts all contributions by where they go.

    Args:
        elements: The mesh's elements.
        layout: The pattern.
        needed: Slots that the linear solver reads, ascending.
        free: Indices of the free vertices, ascending.
        vertices: Number of all vertices.

    Returns:
        For every slot and vertex, the elements that add to it.
    """
    counts = np.diff(layout.contribution_ptr)[needed]
    place = np.repeat(np.arange(len(needed)), counts)
    offset = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    source = layout.contributions[layout.contribution_ptr[needed][place] + offset]
    behind = 9 * len(elements.faces)
    of_face = source < behind
    face, pair = np.divmod(source[of_face], 9)
    block, turned = (table.ravel()[pair] for table in _upper_blocks(3))
    hinge, corners = np.divmod(source[~of_face] - behind, 16)
    hinge_block, hinge_turned = (table.ravel()[corners] for table in _upper_blocks(4))
    vertex = np.full(len(layout.indices), -1)
    vertex[layout.diagonal] = free
    ends = np.arange(len(needed) + 1)
    return GatherTables(
        slots=needed,
        vertex=vertex[needed],
        face_start=np.searchsorted(place[of_face], ends),
        face_terms=16 * face + 2 * block + turned,
        hinge_start=np.searchsorted(place[~of_face], ends),
        hinge_terms=1024 * hinge + 32 * corners + 2 * hinge_block + hinge_turned,
        **_corner_tables("face", elements.faces, vertices),
        **_corner_tables("hinge", elements.hinges, vertices),
    )


def _corner_tables(name: str, elements: Int[ndarray, "elements corners"], vertices: int) -> dict[str, ndarray]:
    corner = elements.ravel()
    order = np.argsort(corner, kind="stable")
    start = np.searchsorted(corner[order], np.arange(vertices + 1))
    return {f"{name}_corner_start": start, f"{name}_corners": order}
