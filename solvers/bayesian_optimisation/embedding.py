"""Random embeddings: a few numbers y that move a point x of the box [-1, 1]^D.

`GaussianEmbedding`: x = clip(A y, -1, 1), A_ij ~ N(0, 1), y in [-sqrt(d), sqrt(d)]^d. `HashEmbedding`: x_i = s_i y_h(i)
with a random bin h(i) and a random sign s_i per coordinate, y in [-1, 1]^d. Nothing takes more than D x d numbers.

References:
    Wang, Hutter, Zoghi, Matheson, de Freitas, Bayesian Optimization in a Billion Dimensions via Random Embeddings,
    JAIR 55, 2016. Nayebi, Munteanu, Poloczek, A Framework for Bayesian Optimization in Embedded Subspaces, ICML 2019.
    Papenmeier, Nardi, Poloczek, Increasing the Scope as You Learn: Adaptive Bayesian Optimization in Nested Subspaces,
    NeurIPS 2022.
"""

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Int

from cusick_bench.solvers.base import SolverError
from cusick_bench.solvers.black_box.box import Point

Embedded = Float[np.ndarray, " embedded"]
Returned = TypeVar("Returned")


@dataclass(frozen=True)
class GaussianEmbedding:
    """Linear Gaussian embedding (Wang et al. 2016).

    Attributes:
        matrix: Random matrix A.
    """

    matrix: Float[np.ndarray, "dimension embedded"]

    def lift(self, point: Embedded) -> Point:
        """Maps a point of the subspace into the box.

        Args:
            point: y / sqrt(d), in [-1, 1]^d.

        Returns:
            The point x of the box.
        """
        return np.clip(self.matrix @ (math.sqrt(len(point)) * point), -1, 1)


@dataclass(frozen=True)
class HashEmbedding:
    """Hashed embedding: every number moves a bin of coordinates (Nayebi et al. 2019; Papenmeier et al. 2022).

    Attributes:
        bins: h, the number of y that moves each coordinate.
        signs: The sign s of each coordinate.
    """

    bins: Int[np.ndarray, " dimension"]
    signs: Float[np.ndarray, " dimension"]

    @property
    def embedded(self) -> int:
        """Dimension d of the subspace."""
        return int(self.bins.max()) + 1

    def lift(self, point: Embedded) -> Point:
        """Maps a point of the subspace into the box.

        Args:
            point: y, in [-1, 1]^d.

        Returns:
            The point x of the box.
        """
        return self.signs * point[self.bins]


def lifted(
    search: Generator[Embedded, float, Returned], lift: Callable[[Embedded], Point]
) -> Generator[Point, float, Returned]:
    """Runs a search of the subspace in the box.

    Args:
        search: Search of [-1, 1]^d.
        lift: Takes its points into the box [-1, 1]^D.

    Returns:
        What the search of y returns.
    """
    try:
        point = next(search)
        while True:
            point = search.send((yield lift(point)))
    except StopIteration as end:
        return end.value


def gaussian_embedding(dimension: int, embedded: int, generator: np.random.Generator) -> GaussianEmbedding:
    """Draws a linear Gaussian embedding of R^d into the box [-1, 1]^D (Wang et al. 2016).

    Args:
        dimension: Number of coordinates D of the box.
        embedded: Dimension d of the subspace.
        generator: Source of all randomness.

    Returns:
        The embedding.

    Raises:
        SolverError: d is not in 1 .. D.
    """
    _check(dimension, embedded)
    return GaussianEmbedding(generator.standard_normal((dimension, embedded)))


def hash_embedding(dimension: int, embedded: int, generator: np.random.Generator) -> HashEmbedding:
    """Draws a hashed embedding: every bin and sign independent, so that bins may differ in size or stay empty (Nayebi
    et al. 2019).

    Args:
        dimension: Number of coordinates D of the box.
        embedded: Dimension d of the subspace.
        generator: Source of all randomness.

    Returns:
        The embedding.

    Raises:
        SolverError: d is not in 1 .. D.
    """
    _check(dimension, embedded)
    return HashEmbedding(generator.integers(embedded, size=dimension), _signs(dimension, generator))


def balanced_embedding(dimension: int, embedded: int, generator: np.random.Generator) -> HashEmbedding:
    """Draws a hashed embedding whose bins differ in size by at most one (Papenmeier et al. 2022).

    Args:
        dimension: Number of coordinates D of the box.
        embedded: Dimension d of the subspace.
        generator: Source of all randomness.

    Returns:
        The embedding.

    Raises:
        SolverError: d is not in 1 .. D.
    """
    _check(dimension, embedded)
    bins = generator.permutation(np.arange(dimension) % embedded)
    return HashEmbedding(bins, _signs(dimension, generator))


def split(
    embedding: HashEmbedding, parts: int, generator: np.random.Generator
) -> tuple[HashEmbedding, Int[np.ndarray, " finer"]]:
    """Splits every bin at random into up to `parts` bins of about equal size; signs stay.

    Args:
        embedding: Embedding whose bins are split.
        parts: Most bins that are made of one.
        generator: Source of all randomness.

    Returns:
        The finer embedding and, for each of its bins, the bin it was part of: `finer.lift(y[parents])` equals
        `embedding.lift(y)`, so that what was evaluated before lies in the finer subspace too.
    """
    order = generator.permutation(len(embedding.bins))
    order = order[np.argsort(embedding.bins[order], kind="stable")]  # bin by bin, at random within each
    sizes = np.bincount(embedding.bins)
    rank = np.arange(len(order)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    part = embedding.bins[order] * parts + rank % parts
    _, first, inner = np.unique(part, return_index=True, return_inverse=True)
    bins = np.empty_like(embedding.bins)
    bins[order] = inner
    return HashEmbedding(bins, embedding.signs), embedding.bins[order][first]


def _signs(dimension: int, generator: np.random.Generator) -> Float[np.ndarray, " dimension"]:
    return generator.choice([-1.0, 1.0], size=dimension)


def _check(dimension: int, embedded: int) -> None:
    if not 1 <= embedded <= dimension:
        raise SolverError(f"an embedding into {dimension} coordinates has 1 to {dimension} of its own, got {embedded}")
