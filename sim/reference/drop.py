"""The drop in plain torch: autograd through every step, sparse direct solves. The engine is benchmarked against it.

This is what a careful program without its own engine would do: forces and stiffness by torch, SuperLU of SciPy for
(M + h^2 K) v' = M v + h F, and autograd through all of it, for which the graph of every step is kept.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sparse
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.sparse.linalg import splu
from torch import Tensor

from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.first_derivatives import first_derivatives
from cusick_bench.sim.reference.laws import Reference, TorchParameters


@dataclass(frozen=True, eq=False)
class _SparsePattern:
    """Places of element matrices in the sparse matrix of the free coordinates (compressed columns)."""

    reference: Reference
    slot: Int[Tensor, "entries"] = field(init=False)
    kept: Int[Tensor, "entries"] = field(init=False)
    row: Int[ndarray, "numbers"] = field(init=False)
    column: Int[ndarray, "numbers"] = field(init=False)
    diagonal: Int[Tensor, "coordinates"] = field(init=False)
    size: int = field(init=False)

    def __post_init__(self) -> None:
        free, vertices = self.reference.free.cpu().numpy(), self.reference.system.mesh.vertices
        place = np.full((vertices, 3), -1)
        place[free] = np.arange(3 * len(free)).reshape(-1, 3)
        rows, columns = [], []
        for corners in (self.reference.faces, self.reference.hinges):
            coordinate = place[corners.cpu().numpy()].reshape(len(corners), -1)
            rows.append(np.repeat(coordinate, coordinate.shape[1], axis=1).ravel())
            columns.append(np.tile(coordinate, (1, coordinate.shape[1])).ravel())
        row, column = np.concatenate(rows), np.concatenate(columns)
        size = 3 * len(free)
        kept = np.flatnonzero((row >= 0) & (column >= 0))
        unique, slot = np.unique(column[kept] * size + row[kept], return_inverse=True)
        column, row = np.divmod(unique, size)
        for name, value in {
            "slot": torch.from_numpy(slot),
            "kept": torch.from_numpy(kept),
            "row": row,
            "column": column,
            "diagonal": torch.from_numpy(np.flatnonzero(row == column)),
            "size": size,
        }.items():
            object.__setattr__(self, name, value)

    def matrix(self, blocks: tuple[Tensor, Tensor], diagonal: Tensor) -> Float[Tensor, "numbers"]:
        """Numbers of the matrix: element matrices and a diagonal, summed."""
        entries = torch.cat([block.reshape(-1) for block in blocks])[self.kept]
        numbers = torch.zeros(len(self.row), dtype=entries.dtype).index_add(0, self.slot, entries)
        return numbers.index_add(0, self.diagonal, diagonal)


class _SparseSolve(torch.autograd.Function):
    """x = A^-1 b for symmetric A given by its numbers; dL/dA = -(A^-1 g) x^T on the pattern."""

    @staticmethod
    def forward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any, numbers: Tensor, right: Tensor, pattern: _SparsePattern
    ) -> Tensor:
        entries = (numbers.detach().numpy(), (pattern.row, pattern.column))
        factor = splu(sparse.csc_array(entries, shape=(pattern.size,) * 2), permc_spec="MMD_AT_PLUS_A",
                      diag_pivot_thresh=0.0, options={"SymmetricMode": True})  # fmt: skip
        solution = factor.solve(right.detach().numpy())
        ctx.kept = (factor, solution, pattern)
        ctx.save_for_backward(numbers, right)
        return torch.from_numpy(solution)

    @staticmethod
    @first_derivatives("a sparse solve")
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor, Tensor, None]:
        factor, solution, pattern = ctx.kept
        multiplier = factor.solve(grad_outputs[0].detach().numpy())
        by_numbers = -multiplier[pattern.row] * solution[pattern.column]
        return torch.from_numpy(by_numbers), torch.from_numpy(multiplier), None


def drop_reference(
    system: DrapeSystem,
    parameters: TorchParameters,
    initial: Float[Tensor, "vertices 3"],
    *,
    steps: int,
    step_seconds: float,
) -> Float[Tensor, "vertices 3"]:
    """Drops the cloth from rest by (M + h^2 K) v' = M v + h F, x' = x + h v', differentiated by autograd.

    Args:
        system: Cloth and support.
        parameters: Material, on the CPU.
        initial: Shape in which the cloth is laid down [m]; springs and fixed vertices hold on to it.
        steps: Number of steps.
        step_seconds: Step h [s].

    Returns:
        Last positions [m], with gradients to every parameter and to `initial`.
    """
    reference = Reference(system)
    pattern = _SparsePattern(reference)
    h, free = step_seconds, reference.free
    diagonal = (parameters.mass + h * h * reference.spring)[free].repeat_interleave(3)
    x, v = initial, torch.zeros_like(initial)
    for _ in range(steps):
        faces, hinges = reference.gauss_newton_blocks(x, parameters)
        numbers = pattern.matrix((h * h * faces, h * h * hinges), diagonal)
        right = parameters.mass[:, None] * v + h * reference.forces(x, initial, parameters)
        solved = _SparseSolve.apply(numbers, right[free].reshape(-1), pattern)
        v = torch.zeros_like(v).index_copy(0, free, solved.reshape(-1, 3))
        x = x + h * v
    return x
