"""Sums element values into vertices or matrix blocks by gathers: a fixed order of summation, no atomic additions.

Targets are ranked by the number of their contributions, most first. Round n then adds the n-th contribution of every
target that has one, which are the first few targets: a gather and a sum over a slice.
"""

from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.sparse import csr_array
from torch import Tensor


def _rounds(target: ndarray, targets: int) -> tuple[ndarray, list[ndarray]]:
    """Place of every target in rank order, and the links of every round."""
    order = np.argsort(target, kind="stable")
    count = np.bincount(target, minlength=targets)
    start = np.cumsum(count) - count
    ranked = np.argsort(-count, kind="stable")
    rank = np.empty_like(ranked)
    rank[ranked] = np.arange(targets)
    return rank, [order[start[ranked[count[ranked] > n]] + n] for n in range(int(count.max(initial=0)))]


class GatherSum:
    """Places of the contributions to every target, on one device.

    Attributes:
        rounds: Sources of the n-th contribution, for the first targets in rank order.
        rank: Place of every target in rank order.
    """

    def __init__(self, target: Int[ndarray, "links"], source: Int[ndarray, "links"], targets: int, device: str) -> None:
        """Lays out the rounds.

        Args:
            target: Target of every link; any order.
            source: Its source.
            targets: Number of targets.
            device: Where the index tables live.
        """
        rank, rounds = _rounds(target, targets)
        self.rank = torch.as_tensor(rank, device=device)
        self.rounds = [torch.as_tensor(source[links], device=device) for links in rounds]

    def __call__(self, values: Float[Tensor, "members sources *inner"]) -> Float[Tensor, "members targets *inner"]:
        """Sums the sources of every target."""
        total = values.new_zeros((len(values), len(self.rank), *values.shape[2:]))
        for index in self.rounds:
            total[:, : len(index)] += values[:, index]
        return total[:, self.rank]


class GatherOuter(GatherSum):
    """Sums outer products of corner vectors without storing each: source c^2 e + c a + b names l_ea r_eb^T, c corners.

    Attributes:
        left: Place of l_ea in every round, corners of all elements one after the other.
        right: Place of r_eb.
    """

    def __init__(
        self, target: Int[ndarray, "links"], source: Int[ndarray, "links"], targets: int, corners: int, device: str
    ) -> None:
        """Lays out the rounds.

        Args:
            target: Target of every link.
            source: corners^2 e + corners a + b.
            targets: Number of targets.
            corners: Corners of an element.
            device: Where the index tables live.
        """
        super().__init__(target, source, targets, device)
        element = [index.div(corners**2, rounding_mode="floor") for index in self.rounds]
        inside = [index % corners**2 for index in self.rounds]
        self.left = [
            corners * e + ab.div(corners, rounding_mode="floor") for e, ab in zip(element, inside, strict=True)
        ]
        self.right = [corners * e + ab % corners for e, ab in zip(element, inside, strict=True)]

    def outer(
        self, left: Float[Tensor, "members corners 3"], right: Float[Tensor, "members corners 3"]
    ) -> Float[Tensor, "members targets 3 3"]:
        """Sums the outer products of every target; corners are those of all elements, one after the other.

        Args:
            left: Left factors.
            right: Right factors.

        Returns:
            Sums.
        """
        total = left.new_zeros((len(left), len(self.rank), 3, 3))
        for a, b in zip(self.left, self.right, strict=True):
            total[:, : len(a)].addcmul_(left[:, a].unsqueeze(3), right[:, b].unsqueeze(2))
        return total[:, self.rank]


class GatherProducts:
    """Sums products of node values: link (target, left, right) adds sum_r l_left,r r_right,r^T, r over some terms.

    Attributes:
        left, right: Nodes of the n-th link, for the first targets in rank order.
        rank: Place of every target in rank order.
    """

    def __init__(
        self, target: Int[ndarray, "links"], left: Int[ndarray, "links"], right: Int[ndarray, "links"], targets: int,
        device: str,
    ) -> None:  # fmt: skip
        """Lays out the rounds.

        Args:
            target: Target of every link.
            left, right: Its nodes.
            targets: Number of targets.
            device: Where the index tables live.
        """
        rank, rounds = _rounds(target, targets)
        self.rank = torch.as_tensor(rank, device=device)
        self.left, self.right = (
            [torch.as_tensor(node[links], device=device) for links in rounds] for node in (left, right)
        )

    def outer(
        self, left: Float[Tensor, "members nodes terms 3"], right: Float[Tensor, "members nodes terms 3"]
    ) -> Float[Tensor, "members targets 3 3"]:
        """Sums outer products of vectors.

        Args:
            left: Left factors.
            right: Right factors.

        Returns:
            Sums.
        """
        total = left.new_zeros((len(left), len(self.rank), 3, 3))
        for a, b in zip(self.left, self.right, strict=True):
            terms = zip(left[:, a].unbind(2), right[:, b].unbind(2), strict=True)
            for one, other in terms:  # matrices this small are slow in a product of matrices, see `small_products`
                total[:, : len(a)].addcmul_(one.unsqueeze(3), other.unsqueeze(2))
        return total[:, self.rank]

    def inner(
        self, left: Float[Tensor, "nodes terms"], right: Float[Tensor, "members nodes terms"]
    ) -> Float[Tensor, "members targets"]:
        """Sums inner products.

        Args:
            left: Left factors, the same for all members.
            right: Right factors.

        Returns:
            Sums.
        """
        total = right.new_zeros((len(right), len(self.rank)))
        for a, b in zip(self.left, self.right, strict=True):
            total[:, : len(a)] += (left[a] * right[:, b]).sum(2)
        return total[:, self.rank]


class _WeightedSum:
    """A sparse matrix times vectors, by rounds."""

    def __init__(self, matrix: csr_array, device: str) -> None:
        entries = matrix.tocoo()
        rank, rounds = _rounds(entries.row, len(matrix.indptr) - 1)
        self.rank = torch.as_tensor(rank, device=device)
        self.rounds = [
            tuple(torch.as_tensor(part[links], device=device) for part in (entries.col.astype(np.int64), entries.data))
            for links in rounds
        ]

    def __call__(self, values: Tensor) -> Tensor:
        total = values.new_zeros((len(values), len(self.rank), *values.shape[2:]))
        for column, weight in self.rounds:
            total[:, : len(column)] += weight.reshape(-1, *[1] * (values.ndim - 2)) * values[:, column]
        return total[:, self.rank]


class _Product(torch.autograd.Function):
    """A constant sparse matrix times every member's array; the way back is by the transposed."""

    @staticmethod
    def forward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any, values: Tensor, matrix: "SparseMatrix"
    ) -> Tensor:
        ctx.matrix = matrix
        return matrix.forward(values)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor, None]:
        return ctx.matrix.transposed(grad_outputs[0]), None


class SparseMatrix:
    """A constant sparse matrix on one device; products are differentiable, and their order of summation is fixed.

    Attributes:
        forward, transposed: The matrix and its transposed times every member's array.
    """

    def __init__(self, matrix: csr_array, device: str) -> None:
        """Lays out both directions.

        Args:
            matrix: The matrix.
            device: Where it lives.
        """
        self.forward = _WeightedSum(matrix, device)
        self.transposed = _WeightedSum(csr_array(matrix.T), device)

    def __call__(self, values: Float[Tensor, "members columns *inner"]) -> Float[Tensor, "members rows *inner"]:
        """The matrix times every member's array, along its first axis."""
        product = _Product.apply(values, self)
        assert isinstance(product, Tensor)
        return product
