"""Sums element values into vertices or matrix blocks by gathers: a fixed order of summation, no atomic additions.

Targets are ranked by the number of their contributions, most first. Round n then adds the n-th contribution of every
target that has one, which are the first few targets: a gather and a sum over a slice.
"""

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor


class GatherSum:
    """Where the contributions of every target lie, on one device.

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
        order = np.argsort(target, kind="stable")
        count = np.bincount(target, minlength=targets)
        start = np.cumsum(count) - count
        ranked = np.argsort(-count, kind="stable")
        rank = np.empty_like(ranked)
        rank[ranked] = np.arange(targets)
        sources = source[order]
        self.rank = torch.as_tensor(rank, device=device)
        self.rounds = [
            torch.as_tensor(sources[start[ranked[count[ranked] > n]] + n], device=device)
            for n in range(int(count.max(initial=0)))
        ]

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
