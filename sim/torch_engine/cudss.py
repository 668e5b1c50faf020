"""cuDSS, NVIDIA's sparse direct solver, behind the interface of `torch_linear`; needs nvmath-python and CUDA.

Written from the documentation of `nvmath.sparse.advanced.DirectSolver`; NOT VERIFIED on a GPU yet. One plan
(reordering and symbolic factorisation) serves all batches of one size: numbers are updated in place and factorised
again. One factor is alive at a time, so the adjoint computes its factors again. cuDSS reports no failure per member:
a member counts as good where its solution is finite and its residual is small.

References:
    nvmath-python, nvmath.sparse.advanced.DirectSolver: implicit batching of CSR tensors, reset of operands in place.
"""

import importlib
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.sim.linear.interface import BLOCK, BlockPattern
from cusick_bench.sim.torch_engine.batched_solver import TorchFactor, TorchLinear

_RESIDUAL = 1e-6  # of the right-hand side, above which a member has failed


class CudssFactor(TorchFactor):
    """The solver's present factor; `good` is known only once it has solved."""

    def __init__(self, linear: "CudssTorch", members: int) -> None:
        self.linear = linear
        self.good = torch.ones(members, dtype=torch.bool, device=linear.device)

    def solve(self, right: Float[Tensor, "members vertices 3"]) -> Float[Tensor, "members vertices 3"]:
        """Solves with cuDSS, and notes in `good` whose residual is small."""
        linear = self.linear
        linear.right.copy_(right.flatten(1)[:, :, None])
        solution = linear.solver.solve().reshape(right.shape).clone()
        residual = (linear.product(solution) - right).abs().amax((1, 2))
        self.good.logical_and_(residual <= _RESIDUAL * right.abs().amax((1, 2)))  # NaN compares as false
        return solution


class CudssTorch(TorchLinear):
    """Batched symmetric positive definite systems in cuDSS; see the module."""

    keeps = False
    capturable = False

    def __init__(self, pattern: BlockPattern, device: str) -> None:
        self.pattern, self.device = pattern, torch.device(device)
        self.slots = np.arange(pattern.slots)
        entries = BLOCK**2 * pattern.slots
        self.factor_bytes = 4 * 8 * entries  # fill of a nested dissection, about
        self.work_bytes = 2 * 8 * entries
        self._lay_out()
        self.nvmath: Any = importlib.import_module("nvmath")
        self.solver: Any = None
        self.members = 0

    def _lay_out(self) -> None:
        """Scalar compressed rows of the block pattern, and the place of every number in the blocks."""
        axis, pattern = np.arange(BLOCK), self.pattern
        shape = (pattern.slots, BLOCK, BLOCK)
        row = np.broadcast_to((BLOCK * pattern.rows)[:, None, None] + axis[:, None], shape).ravel()
        column = np.broadcast_to((BLOCK * pattern.indices)[:, None, None] + axis, shape).ravel()
        places = np.lexsort((column, row))
        start = np.searchsorted(row[places], np.arange(BLOCK * pattern.vertices + 1))
        self.places = torch.as_tensor(places, device=self.device)
        self.start, self.column = (
            torch.as_tensor(index.astype(np.int32), device=self.device) for index in (start, column[places])
        )

    def _plan(self, members: int) -> None:
        """Operands of a batch, which keep their addresses, and the symbolic factorisation."""
        if self.solver is not None:
            self.solver.free()
        size = BLOCK * self.pattern.vertices
        self.values = torch.zeros((members, len(self.places)), dtype=torch.float64, device=self.device)
        index = (self.start.repeat(members, 1), self.column.repeat(members, 1))
        self.matrix = torch.sparse_csr_tensor(*index, self.values, size=(members, size, size), check_invariants=False)
        self.values = self.matrix.values()  # shares the storage
        # each member's right-hand side is a matrix of one column, columns first
        self.right = torch.zeros((members, 1, size), dtype=torch.float64, device=self.device).permute(0, 2, 1)
        advanced = self.nvmath.sparse.advanced
        options = advanced.DirectSolverOptions(sparse_system_type=advanced.DirectSolverMatrixType.SPD)
        self.solver = advanced.DirectSolver(self.matrix, self.right, options=options)
        self.solver.plan()
        self.members = members

    def factorise(self, blocks: Float[Tensor, "members needed 3 3"]) -> CudssFactor:
        """Factorises with cuDSS; its plan is kept for as many members."""
        if len(blocks) != self.members:
            self._plan(len(blocks))
        self.values.copy_(blocks.flatten(1)[:, self.places])
        self.solver.factorize()
        return CudssFactor(self, len(blocks))

    def product(self, x: Float[Tensor, "members vertices 3"]) -> Float[Tensor, "members vertices 3"]:
        """A x of the present matrices, for their residuals.

        Args:
            x: Vectors of all members.

        Returns:
            Products.
        """
        picked = x.flatten(1)[:, self.column.long()] * self.values
        lengths = torch.diff(self.start.long()).expand(len(x), -1)
        return torch.segment_reduce(picked, "sum", lengths=lengths.contiguous(), axis=1).reshape(x.shape)
