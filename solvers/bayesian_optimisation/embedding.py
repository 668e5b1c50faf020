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
    """REMBO's.

    Attributes:
        matrix: A.
    """

    matrix: Float[np.ndarray, "dimension embedded"]

    def lift(self, point: Embedded) -> Point:
        """The x of y / sqrt(d) in [-1, 1]^d."""
        return np.clip(self.matrix @ (math.sqrt(len(point)) * point), -1, 1)


@dataclass(frozen=True)
class HashEmbedding:
    """HeSBO's, and that of BAxUS.

    Attributes:
        bins: h, the number of y that moves each coordinate.
        signs: s.
    """

    bins: Int[np.ndarray, " dimension"]
    signs: Float[np.ndarray, " dimension"]

    @property
    def embedded(self) -> int:
        """d."""
        return int(self.bins.max()) + 1

    def lift(self, point: Embedded) -> Point:
        """The x of a y in [-1, 1]^d."""
        return self.signs * point[self.bins]


def lifted(
    search: Generator[Embedded, float, Returned], lift: Callable[[Embedded], Point]
) -> Generator[Point, float, Returned]:
    """A search of y that asks for x, and returns what it returns."""
    try:
        point = next(search)
        while True:
            point = search.send((yield lift(point)))
    except StopIteration as end:
        return end.value


def gaussian_embedding(dimension: int, embedded: int, generator: np.random.Generator) -> GaussianEmbedding:
    """Draws REMBO's embedding of R^d into the box [-1, 1]^D.

    Raises:
        SolverError: d is not in 1 .. D.
    """
    _check(dimension, embedded)
    return GaussianEmbedding(generator.standard_normal((dimension, embedded)))


def hash_embedding(dimension: int, embedded: int, generator: np.random.Generator) -> HashEmbedding:
    """Draws HeSBO's embedding: every bin and sign independent, so that bins may differ in size or stay empty.

    Raises:
        SolverError: d is not in 1 .. D.
    """
    _check(dimension, embedded)
    return HashEmbedding(generator.integers(embedded, size=dimension), _signs(dimension, generator))


def balanced_embedding(dimension: int, embedded: int, generator: np.random.Generator) -> HashEmbedding:
    """Draws the embedding of BAxUS: a hash whose bins differ in size by at most one.

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
