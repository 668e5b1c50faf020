"""Solvers of other packages with the interface of `cusick_bench.sim.linear.interface`: for tests, and as extras."""

import importlib
import sys
from typing import Any

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float
from numpy import ndarray
from scipy.sparse.linalg import SuperLU, splu

from cusick_bench.sim.linear.interface import BLOCK, BlockPattern, Factor, LinearSolver, NotPositiveDefinite


class SparseLuSolver(LinearSolver):
    """SuperLU of SciPy, always there but slow: it keeps no analysis, each factorisation starts afresh."""

    name = "splu"

    def _factorise(self, blocks: Float[ndarray, "slots 3 3"], out: Factor | None) -> Factor:
        if not np.isfinite(blocks).all():
            raise self._failure(blocks)
        entries = (blocks, self.pattern.indices, self.pattern.indptr)
        matrix = sparse.bsr_array(entries, shape=(BLOCK * self.pattern.vertices,) * 2).tocsc()
        symmetric = {"SymmetricMode": True}
        try:
            factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric)
        except RuntimeError as error:  # exactly singular
            raise NotPositiveDefinite from error
        # Pivots on the diagonal: U = D L^T, and the signs of D are those of the eigenvalues (Sylvester).
        if not np.array_equal(factor.perm_r, factor.perm_c) or (factor.U.diagonal() <= 0).any():
            raise NotPositiveDefinite
        return SparseLuFactor(factor, self.pattern.vertices)


class SparseLuFactor(Factor):
    """A factor of SuperLU."""

    def __init__(self, factor: SuperLU, vertices: int) -> None:
        super().__init__(vertices)
        self.factor = factor

    @property
    def nbytes(self) -> int:
        return self.factor.nnz * (8 + 4)  # a number and its row

    def _solve(self, right: Float[ndarray, "several vertices 3"]) -> Float[ndarray, "several vertices 3"]:
        return self.factor.solve(right.reshape(len(right), -1).T).T.reshape(right.shape)


class UpperTriangle:
    """The upper triangle of a block pattern as a scalar matrix in compressed rows.

    Read the other way round, it is the lower triangle in compressed columns.
    """

    def __init__(self, pattern: BlockPattern) -> None:
        axis = np.arange(BLOCK)
        shape = (pattern.slots, BLOCK, BLOCK)
        row = np.broadcast_to((BLOCK * pattern.rows)[:, None, None] + axis[:, None], shape).ravel()
        column = np.broadcast_to((BLOCK * pattern.indices)[:, None, None] + axis, shape).ravel()
        place = np.flatnonzero(row <= column)
        size = (BLOCK * pattern.vertices,) * 2
        matrix: Any = sparse.coo_array((place, (row[place], column[place])), shape=size).tocsr()
        matrix.sort_indices()
        self.indptr, self.indices, self.places, self.shape = matrix.indptr, matrix.indices, matrix.data, size
        self.slots = np.flatnonzero(pattern.rows <= pattern.indices)

    def numbers(self, blocks: Float[ndarray, "slots 3 3"]) -> Float[ndarray, " numbers"]:
        """The triangle's numbers, in the order of the scalar pattern.

        Args:
            blocks: The block of every entry of the pattern.

        Returns:
            The numbers.
        """
        return np.take(blocks, self.places)


class TriangleSolver(LinearSolver):
    """A backend that reads the upper triangle; its factors hold the analysis, so reusing them is cheap."""

    factor_type: type["TriangleFactor"]

    def __init__(self, pattern: BlockPattern) -> None:
        super().__init__(pattern)
        self.triangle = UpperTriangle(pattern)
        self.needed_slots = self.triangle.slots

    def _factorise(self, blocks: Float[ndarray, "slots 3 3"], out: Factor | None) -> Factor:
        if not np.isfinite(blocks[self.needed_slots]).all():
            raise self._failure(blocks)
        fits = isinstance(out, self.factor_type) and out.triangle is self.triangle
        factor = out if isinstance(out, TriangleFactor) and fits else self.factor_type(self.triangle)
        factor.update(self.triangle.numbers(blocks))
        return factor


class TriangleFactor(Factor):
    """A factor of a package that is given the upper triangle in compressed rows."""

    def __init__(self, triangle: UpperTriangle) -> None:
        super().__init__(triangle.shape[0] // BLOCK)
        self.triangle = triangle

    def update(self, numbers: Float[ndarray, " numbers"]) -> None:
        """Factorises new numbers in the same pattern.

        Args:
            numbers: The triangle's numbers, as `UpperTriangle.numbers` returns them.

        Raises:
            NotPositiveDefinite: The matrix is not positive definite.
        """
        raise NotImplementedError


class PardisoFactor(TriangleFactor):
    """Symmetric positive definite PARDISO."""

    SYMMETRIC_POSITIVE_DEFINITE, ANALYSE, FACTORISE, SOLVE, RELEASE = 2, 11, 22, 33, -1
    KILOBYTES_OF_FACTOR, ZERO_PIVOT_ERROR = 17, -4

    def __init__(self, triangle: UpperTriangle) -> None:
        super().__init__(triangle)
        entries = (np.ones(len(triangle.indices)), triangle.indices, triangle.indptr)
        self.matrix: Any = sparse.csr_array(entries, shape=triangle.shape)
        self.wrapper: Any = importlib.import_module("pypardiso.pardiso_wrapper")
        self.pardiso = self.wrapper.PyPardisoSolver(mtype=self.SYMMETRIC_POSITIVE_DEFINITE)
        self._call(self.ANALYSE)

    def _call(self, phase: int, right: ndarray | None = None) -> ndarray:
        self.pardiso.set_phase(phase)
        right = np.zeros((self.triangle.shape[0], 1)) if right is None else right
        return self.pardiso._call_pardiso(self.matrix, right)

    def update(self, numbers: Float[ndarray, " numbers"]) -> None:
        """Factorises with PARDISO; its analysis is kept."""
        self.matrix.data = numbers
        try:
            self._call(self.FACTORISE)
        except self.wrapper.PyPardisoError as error:
            if error.value == self.ZERO_PIVOT_ERROR:
                raise NotPositiveDefinite from error
            raise

    @property
    def nbytes(self) -> int:
        return 1024 * int(self.pardiso.get_iparm(self.KILOBYTES_OF_FACTOR))

    def _solve(self, right: Float[ndarray, "several vertices 3"]) -> Float[ndarray, "several vertices 3"]:
        columns = np.asfortranarray(right.reshape(len(right), -1).T)
        return self._call(self.SOLVE, columns).T.reshape(right.shape)

    def __del__(self) -> None:
        if hasattr(self, "pardiso") and not sys.is_finalizing():
            self._call(self.RELEASE)


class PardisoSolver(TriangleSolver):
    """Intel MKL PARDISO through pypardiso."""

    name = "pardiso"
    factor_type = PardisoFactor


class CholmodFactor(TriangleFactor):
    """Supernodal Cholesky of SuiteSparse."""

    def __init__(self, triangle: UpperTriangle) -> None:
        super().__init__(triangle)
        self.cvxopt: Any = importlib.import_module("cvxopt")
        self.cholmod: Any = importlib.import_module("cvxopt.cholmod")
        column = np.repeat(np.arange(triangle.shape[0]), np.diff(triangle.indptr))
        self.matrix = self.cvxopt.spmatrix(1.0, triangle.indices.tolist(), column.tolist(), triangle.shape)
        self.factor = self.cholmod.symbolic(self.matrix)

    def update(self, numbers: Float[ndarray, " numbers"]) -> None:
        """Factorises with CHOLMOD; its analysis is kept."""
        self.matrix.V = self.cvxopt.matrix(numbers)
        try:
            self.cholmod.numeric(self.matrix, self.factor)
        except ArithmeticError as error:
            raise NotPositiveDefinite from error

    @property
    def nbytes(self) -> int:
        return len(self.cholmod.getfactor(self.factor)) * (8 + 8)  # a number and its row

    def _solve(self, right: Float[ndarray, "several vertices 3"]) -> Float[ndarray, "several vertices 3"]:
        columns = self.cvxopt.matrix(right.reshape(len(right), -1).T)
        self.cholmod.solve(self.factor, columns)
        return np.array(columns).T.reshape(right.shape)


class CholmodSolver(TriangleSolver):
    """CHOLMOD through cvxopt."""

    name = "cholmod"
    factor_type = CholmodFactor
