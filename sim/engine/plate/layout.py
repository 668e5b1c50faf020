"""The control points on which every quadrature point of a shell depends, and the places of its terms in the matrix."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.shell.stencils import ShellStencils


@dataclass(frozen=True, eq=False)
class PointNodes:
    """Nodes of all points one behind another ("places"), those of the edges first.

    Attributes:
        start: First place of every point, and the end.
        nodes: Control point at every place.
        weights: Rows of the derivatives at every place, see `points`; zero beyond the second at vertices.
        point: Point of every place.
    """

    start: Int[ndarray, "points_and_end"]
    nodes: Int[ndarray, "places"]
    weights: Float[ndarray, "places 5"]
    point: Int[ndarray, "places"]

    @classmethod
    def of(cls, stencils: ShellStencils) -> "PointNodes":
        """Puts the nodes of a shell's points one behind another.

        Args:
            stencils: Its quadrature points.

        Returns:
            The nodes.
        """
        nodes, weights = [], []
        for padded, counts, rows in (
            (stencils.edge_nodes, stencils.edge_counts, stencils.edge_weights),
            (stencils.vertex_nodes, stencils.vertex_counts, stencils.vertex_weights),
        ):
            used = np.arange(padded.shape[1]) < counts[:, None]
            nodes.append(padded[used])
            own = np.zeros((len(nodes[-1]), 5))
            own[:, : rows.shape[1]] = rows.transpose(0, 2, 1)[used]
            weights.append(own)
        counts = np.concatenate([stencils.edge_counts, stencils.vertex_counts])
        point = np.repeat(np.arange(len(counts)), counts)
        return cls(_starts(counts), np.concatenate(nodes), np.concatenate(weights), point)

    def pairs(self) -> tuple[Int[ndarray, "pairs"], Int[ndarray, "pairs"]]:
        """Places of all pairs of nodes of a point, both ways and each with itself.

        Returns:
            First and second places; the first ascend, and so do the second of each.
        """
        counts = np.diff(self.start)[self.point]
        first = np.repeat(np.arange(len(self.nodes)), counts)
        within = np.arange(len(first)) - np.repeat(_starts(counts)[:-1], counts)
        return first, self.start[self.point[first]] + within


@dataclass(frozen=True, eq=False)
class ShellLayout:
    """Sparsity of the free control points, and what adds up where; names are those of `BlockLayout`.

    Attributes:
        indptr: Row pointers of the full symmetric block pattern (CSR).
        indices: Column of every slot, sorted within a row.
        diagonal: Slot of every diagonal block.
        row_start, row_places: Places whose node every row is.
    """

    indptr: Int[ndarray, "rows_plus_one"]
    indices: Int[ndarray, "slots"]
    diagonal: Int[ndarray, "rows"]
    row_start: Int[ndarray, "rows_plus_one"]
    row_places: Int[ndarray, "places"]


@dataclass(frozen=True, eq=False)
class MatrixTerms:
    """For every entry of `row_places`, the nodes of its point whose column the solver reads, and the slots.

    Attributes:
        start: First term of every entry, and the end.
        other: Place of the other node of every term.
        slots: Slot that the term adds to.
    """

    start: Int[ndarray, "places_and_end"]
    other: ndarray
    slots: ndarray

    @classmethod
    def of(cls, nodes: PointNodes, layout: ShellLayout, needed: Int[ndarray, "needed"]) -> "MatrixTerms":
        """Lists the terms of a matrix.

        Args:
            nodes: Nodes of the shell's points.
            layout: Pattern of the matrix.
            needed: Slots that the solver reads.

        Returns:
            The terms, by rows and then by points.
        """
        first, second = nodes.pairs()
        rows = len(layout.diagonal)
        of_slot = np.repeat(np.arange(rows), np.diff(layout.indptr)) * rows + layout.indices
        slot = np.searchsorted(of_slot, nodes.nodes[first] * rows + nodes.nodes[second])
        read = np.zeros(len(of_slot), bool)
        read[needed] = True
        rank = np.empty_like(layout.row_places)
        rank[layout.row_places] = np.arange(len(rank))
        kept = np.flatnonzero(read[slot])
        kept = kept[np.argsort(rank[first[kept]], kind="stable")]
        start = np.searchsorted(rank[first[kept]], np.arange(len(rank) + 1))
        # unsigned, so that kernels need not ask whether an index counts from the end
        return cls(start, second[kept].astype(np.uint32), slot[kept].astype(np.uint32))


def shell_layout(nodes: PointNodes, rows: int) -> ShellLayout:
    """Lays out the block matrix of a shell.

    Args:
        nodes: Nodes of its points.
        rows: Number of free control points.

    Returns:
        The pattern, and where every row's nodes are.
    """
    first, second = nodes.pairs()
    row, column = np.divmod(np.unique(nodes.nodes[first] * rows + nodes.nodes[second]), rows)
    by_row = np.argsort(nodes.nodes, kind="stable")
    return ShellLayout(
        indptr=np.searchsorted(row, np.arange(rows + 1)),
        indices=column,
        diagonal=np.flatnonzero(row == column),
        row_start=np.searchsorted(nodes.nodes[by_row], np.arange(rows + 1)),
        row_places=by_row,
    )


def _starts(counts: ndarray) -> ndarray:
    return np.concatenate([[0], np.cumsum(counts)])
