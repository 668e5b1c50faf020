"""Sparse linear systems of 3x3 blocks with one fixed pattern, factorised again and again.

Every implicit step and every Newton step of the simulator solves A x = b, where A is symmetric positive
definite and couples the vertices of one mesh. The pattern is analysed once; afterwards only numbers change:

    linear = solver(BlockPattern.from_couplings(points, couplings))
    factor = linear.factorise(blocks)          # blocks: one 3x3 block per entry of the pattern
    x = factor.solve(b)

Backends share this interface; `multifrontal` (ours, in numba) is the default, others are found when
installed.
"""

import importlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from cusick_bench.sim.errors import SimulationError

BLOCK = 3
"""Unknowns of one vertex: its x, y and z."""


class NotPositiveDefinite(SimulationError, ArithmeticError):
    """The matrix has no Cholesky factor: add to its diagonal, or project its elements, and try again.

    Attributes:
        members: For a batch, which of its matrices.
    """

    def __init__(self, members: Bool[ndarray, " members"] | None = None) -> None:
        self.members = np.ones(1, bool) if members is None else members
        super().__init__("the matrix must be positive definite, and it is not; regularise it: add to its diagonal")


@dataclass(frozen=True, eq=False)
class BlockPattern:
    """Which vertices are coupled: a symmetric pattern of blocks, diagonal included, in compressed rows.

    Attributes:
        indptr: Start of every row in `indices`.
        indices: Columns, ascending within a row.
        points: Position of every vertex in the plane [any unit]; only guides the elimination order.
    """

    indptr: Int[ndarray, " rows_and_end"]
    indices: Int[ndarray, " slots"]
    points: Float[ndarray, "vertices 2"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "indptr", np.ascontiguousarray(self.indptr, np.int64))
        object.__setattr__(self, "indices", np.ascontiguousarray(self.indices, np.int64))
        object.__setattr__(self, "points", np.ascontiguousarray(self.points, np.float64))
        self._check()

    @classmethod
    def from_couplings(
        cls, points: Float[ndarray, "vertices 2"], couplings: Int[ndarray, "couplings 2"]
    ) -> "BlockPattern":
        """Pattern that joins each given pair of vertices, both ways, and each vertex with itself.

        Args:
            points: Position of every vertex in the plane.
            couplings: Pairs of vertices, in any order, repeated or not.

        Returns:
            The pattern, rows ascending.
        """
        vertices = len(points)
        pairs = np.asarray(couplings, np.int64).reshape(-1, 2)
        if pairs.size and (pairs.min() < 0 or pairs.max() >= vertices):
            raise SimulationError(
                f"couplings must name vertices 0 to {vertices - 1}, got {pairs.min()} to {pairs.max()}"
            )
        row = np.concatenate([pairs[:, 0], pairs[:, 1], np.arange(vertices)])
        column = np.concatenate([pairs[:, 1], pairs[:, 0], np.arange(vertices)])
        row, column = np.divmod(np.unique(row * vertices + column), max(vertices, 1))
        return cls(np.searchsorted(row, np.arange(vertices + 1)), column, points)

    @property
    def vertices(self) -> int:
        return len(self.indptr) - 1

    @property
    def slots(self) -> int:
        """Number of blocks."""
        return len(self.indices)

    @cached_property
    def rows(self) -> Int[ndarray, " slots"]:
        """Row of every block."""
        return np.repeat(np.arange(self.vertices), np.diff(self.indptr))

    def _check(self) -> None:
        if self.vertices < 1 or self.points.shape != (self.vertices, 2) or not np.isfinite(self.points).all():
            raise SimulationError(
                f"a pattern of n >= 1 rows needs n finite points in the plane, got {self.vertices} rows and "
                f"points of shape {self.points.shape}"
            )
        if self.indptr[0] != 0 or self.indptr[-1] != self.slots or (np.diff(self.indptr) < 0).any():
            raise SimulationError(f"indptr must rise from 0 to the number of blocks, {self.slots}")
        if self.indices.min(initial=0) < 0 or self.indices.max(initial=0) >= self.vertices:
            raise SimulationError(f"columns of the pattern must lie in 0 to {self.vertices - 1}")
        entry = self.rows * self.vertices + self.indices
        if (np.diff(entry) <= 0).any():
            raise SimulationError("columns must be ascending and unique within each row; sort them")
        if not np.array_equal(np.sort(self.indices * self.vertices + self.rows), entry):
            raise SimulationError("the pattern must be symmetric: list (i, j) and (j, i); see from_couplings")
        if np.count_nonzero(self.rows == self.indices) != self.vertices:
            raise SimulationError("the pattern must list every diagonal block; see from_couplings")


class Factor(ABC):
    """A matrix, or several, ready to solve with. It owns its storage and stays valid as long as it is kept.

    Attributes:
        vertices: Rows of blocks.
        members: Number of matrices of a batch, None for a single one.
    """

    def __init__(self, vertices: int, members: int | None = None) -> None:
        self.vertices, self.members = vertices, members

    @property
    @abstractmethod
    def nbytes(self) -> int:
        """Memory kept by the factor [bytes]."""

    def solve(self, right: Float[ndarray, "*shape"]) -> Float[ndarray, "*shape"]:
        """Solve A x = b.

        Args:
            right: One right-hand side (vertices, 3) or several (count, vertices, 3); one each for a batch.

        Returns:
            The solution, in the shape of `right`.

        Raises:
            SimulationError: `right` has another shape, or is not finite.
        """
        right = np.ascontiguousarray(right, np.float64)
        one = (self.vertices, BLOCK)
        single = self.members is None
        fits = right.shape in (one, (len(right), *one)) if single else right.shape == (self.members, *one)
        if not fits:
            expected = f"{one} or (count, {one[0]}, {BLOCK})" if single else (self.members, *one)
            raise SimulationError(f"right-hand side must have shape {expected}, got {right.shape}")
        if not np.isfinite(right).all():
            raise SimulationError("right-hand side must be finite, got NaN or infinity; check the forces")
        return self._solve(right.reshape(-1, *one)).reshape(right.shape)

    @abstractmethod
    def _solve(self, right: Float[ndarray, "several vertices 3"]) -> Float[ndarray, "several vertices 3"]: ...


class FactorBatch(Factor):
    """Factors one by one behind the interface of a batch, for backends that know no batches."""

    def __init__(self, factors: Sequence[Factor]) -> None:
        super().__init__(factors[0].vertices, len(factors))
        self.factors = list(factors)

    @property
    def nbytes(self) -> int:
        return sum(factor.nbytes for factor in self.factors)

    def _solve(self, right: Float[ndarray, "several vertices 3"]) -> Float[ndarray, "several vertices 3"]:
        return np.stack([factor.solve(one) for factor, one in zip(self.factors, right, strict=True)])


class LinearSolver(ABC):
    """Factorises matrices of one pattern; building it is the analysis.

    Attributes:
        name: As in `BACKENDS`.
        width: Matrices of a batch that one thread works on at a time.
    """

    name: str
    width: int = 1

    def __init__(self, pattern: BlockPattern) -> None:
        self.pattern = pattern
        self._spare: list[Factor] = []

    def recycle(self, factor: Factor, most: int) -> None:
        """Takes back the storage of a factor that nobody will solve with any more; fresh memory is slow to touch.

        Args:
            factor: The factor; do not solve with it afterwards.
            most: Number of factors whose storage is kept; that of a further one is given up.
        """
        if len(self._spare) < most:
            self._spare.append(factor)

    def _storage_left(self, members: int | None) -> Factor | None:
        """Recycled storage of as many members, if there is any."""
        if self._spare and self._spare[-1].members != members:
            self._spare.clear()
        return self._spare.pop() if self._spare else None

    @cached_property
    def needed_slots(self) -> Int[ndarray, " needed"]:
        """Blocks that are read, ascending; the others may hold anything."""
        return np.arange(self.pattern.slots)

    def factorise(self, blocks: Float[ndarray, "slots 3 3"], *, out: Factor | None = None) -> Factor:
        """Factorise one matrix.

        Args:
            blocks: The block of every entry of the pattern.
            out: An old factor whose storage is used again where it fits; do not solve with it afterwards.

        Returns:
            The factor.

        Raises:
            NotPositiveDefinite: The matrix is not positive definite.
            SimulationError: `blocks` has another shape, or is not finite.
        """
        return self._factorise(self._checked(blocks, ("slots",)), out or self._storage_left(None))

    def factorise_batch(self, blocks: Float[ndarray, "*members slots 3 3"], *, out: Factor | None = None) -> Factor:
        """Factorise several matrices of the pattern; arguments and errors as for `factorise`.

        Args:
            blocks: The block of every entry of the pattern, for every matrix.
            out: An old factor of as many matrices whose storage is used again where it fits.

        Returns:
            The factor of all.
        """
        checked = self._checked(blocks, ("members", "slots"))
        return self._factorise_batch(checked, out or self._storage_left(len(checked)))

    @abstractmethod
    def _factorise(self, blocks: Float[ndarray, "slots 3 3"], out: Factor | None) -> Factor: ...

    def _factorise_batch(self, blocks: Float[ndarray, "members slots 3 3"], out: Factor | None) -> Factor:
        fits = isinstance(out, FactorBatch) and out.members == len(blocks)
        old = out.factors if isinstance(out, FactorBatch) and fits else [None] * len(blocks)
        factors: list[Factor | None] = []
        for one, reuse in zip(blocks, old, strict=True):
            try:
                factors.append(self._factorise(one, reuse))
            except NotPositiveDefinite:
                factors.append(None)
        good = [factor for factor in factors if factor is not None]
        if len(good) < len(factors):
            raise NotPositiveDefinite(np.array([factor is None for factor in factors]))
        return FactorBatch(good)

    def _checked(self, blocks: ndarray, axes: tuple[str, ...]) -> ndarray:
        blocks = np.ascontiguousarray(blocks, np.float64)
        block = (self.pattern.slots, BLOCK, BLOCK)
        if blocks.ndim != len(axes) + 2 or blocks.shape[-3:] != block or not len(blocks):
            expected = ", ".join([*axes[:-1], *map(str, block)])
            raise SimulationError(f"blocks must have shape ({expected}), got {blocks.shape}")
        return blocks

    def _failure(
        self, blocks: Float[ndarray, "*members slots 3 3"], members: Bool[ndarray, " members"] | None = None
    ) -> SimulationError:
        """Why `blocks`, or those of some members, could not be factorised."""
        if np.isfinite(blocks[..., self.needed_slots, :, :]).all():
            return NotPositiveDefinite(members)
        return SimulationError("matrix must be finite, got NaN or infinity; check parameters and positions")


@dataclass(frozen=True)
class Backend:
    """Module of a backend, which is imported when it is first used, and the package that it needs."""

    module: str
    solver: str
    package: str


BACKENDS: dict[str, Backend] = {
    "multifrontal": Backend("cusick_bench.sim.linear.multifrontal", "MultifrontalSolver", "numba"),
    "lockstep": Backend("cusick_bench.sim.linear.lockstep", "LockstepSolver", "numba"),
    "splu": Backend("cusick_bench.sim.linear.backends", "SparseLuSolver", "scipy"),
    "pardiso": Backend("cusick_bench.sim.linear.backends", "PardisoSolver", "pypardiso"),
    "cholmod": Backend("cusick_bench.sim.linear.backends", "CholmodSolver", "cvxopt"),
}


def available_backends() -> list[str]:
    """Names of the backends whose package is installed, the default first."""
    return [name for name, backend in BACKENDS.items() if find_spec(backend.package) is not None]


def solver(pattern: BlockPattern, backend: str = "auto") -> LinearSolver:
    """Analyse a pattern.

    Args:
        pattern: The coupled vertices.
        backend: A name of `BACKENDS`; "auto" is always `multifrontal`, so that results do not depend on the
            optional packages installed.

    Returns:
        The solver, analysed.

    Raises:
        SimulationError: The backend is unknown or its package is missing.
    """
    name = "multifrontal" if backend == "auto" else backend
    if name not in BACKENDS:
        raise SimulationError(f"linear solver must be one of auto, {', '.join(BACKENDS)}, got {backend!r}")
    if name not in available_backends():
        package = BACKENDS[name].package
        raise SimulationError(f"linear solver {name!r} needs the package {package}; pip install {package}")
    found = BACKENDS[name]
    return getattr(importlib.import_module(found.module), found.solver)(pattern)
