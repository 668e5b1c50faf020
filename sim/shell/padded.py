"""Stencils of unequal size in rectangular arrays, padded with node 0 and weight 0."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Bool, Float, Int
from numpy import ndarray


@dataclass(frozen=True, eq=False)
class Padded:
    """Weights of nodes at points, several rows a point.

    Attributes:
        nodes: Nodes of every point's stencil, ascending, then zeros.
        counts: Number of nodes of every point's stencil.
        weights: Weights of the nodes in every row of a point; zero in the padding.
    """

    nodes: Int[ndarray, "points width"]
    counts: Int[ndarray, "points"]
    weights: Float[ndarray, "points rows width"]

    @property
    def used(self) -> Bool[ndarray, "points width"]:
        """Whether a place holds a node (not padding)."""
        return np.arange(self.nodes.shape[1]) < self.counts[:, None]

    def matrix(self, columns: int, row: int = 0) -> sparse.csr_array:
        """One row of every point as a sparse matrix.

        Args:
            columns: Number of nodes in all.
            row: Index of the row.

        Returns:
            Matrix of shape (points, columns).
        """
        used = self.used
        starts = np.append(0, np.cumsum(self.counts))
        return sparse.csr_array(
            (self.weights[:, row][used], self.nodes[used], starts), shape=(len(self.counts), columns)
        )

    def extended(self, extension: sparse.csr_array) -> "Padded":
        """The same rows by other unknowns.

        Args:
            extension: The nodes as combinations of the other unknowns; shape (nodes, unknowns).

        Returns:
            The rows by the unknowns.
        """
        used = self.used
        node = self.nodes[used]
        lengths = np.diff(extension.indptr)[node]
        entry = np.repeat(np.arange(len(node)), lengths)
        first = np.repeat(extension.indptr[node] - (np.cumsum(lengths) - lengths), lengths)
        place = first + np.arange(len(entry))
        point = np.repeat(np.arange(len(self.counts)), self.counts)
        factors = extension.data[place]
        return accumulated(
            point[entry],
            extension.indices[place],
            [self.weights[:, row][used][entry] * factors for row in range(self.weights.shape[1])],
            len(self.counts),
        )


def accumulated(
    point: Int[ndarray, "entries"],
    node: Int[ndarray, "entries"],
    weights: list[Float[ndarray, "entries"]],
    points: int,
) -> Padded:
    """Adds up entries with the same point and node.

    Args:
        point: The point of every entry.
        node: The node of every entry.
        weights: The weights of every entry, a list of rows.
        points: Number of points in all.

    Returns:
        The stencils.
    """
    nodes, counts, slot = pattern(point, node, points)
    rows = [np.bincount(slot, row, nodes.size).reshape(nodes.shape) for row in weights]
    return Padded(nodes, counts, np.stack(rows, axis=1))


def pattern(
    point: Int[ndarray, "entries"], node: Int[ndarray, "entries"], points: int
) -> tuple[Int[ndarray, "points width"], Int[ndarray, "points"], Int[ndarray, "entries"]]:
    """The nodes of every point, each once.

    Args:
        point: The point of every entry.
        node: The node of every entry.
        points: Number of points in all.

    Returns:
        Padded nodes, their numbers, and the place of every entry in the flattened array of nodes.
    """
    columns = int(node.max()) + 1
    keys, inverse = np.unique(point * columns + node, return_inverse=True)
    owner, member = np.divmod(keys, columns)
    counts = np.bincount(owner, minlength=points)
    width = int(counts.max())
    place = owner * width + np.arange(len(keys)) - (np.cumsum(counts) - counts)[owner]
    nodes = np.zeros(points * width, np.int64)
    nodes[place] = member
    return nodes.reshape(points, width), counts, place[inverse]


def entries(matrix: sparse.csr_array) -> tuple[Int[ndarray, "entries"], Int[ndarray, "entries"]]:
    """Rows and columns of a sparse matrix's entries.

    Args:
        matrix: The matrix.

    Returns:
        Rows, ascending, and columns.
    """
    lengths = np.diff(matrix.indptr)
    return np.repeat(np.arange(len(lengths)), lengths), matrix.indices.astype(np.int64)
