"""Shared parts of compiled kernels: compiler options, the division of elements into chunks, and 3-vectors as tuples."""

from collections.abc import Callable
from typing import Any

from cusick_bench.sim.kernel_cache import numba

CHUNKS = 16
"""Elements are divided into a fixed number of chunks, so that results do not depend on the number of threads."""


def kernel(*, parallel: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """Compiles a function: cached on disk, in IEEE arithmetic, where a division by zero is no error.

    Products and sums are not fused. Which ones a compiler fuses depends on what it has inlined, so that a gradient had
    other last digits in the process that compiled the kernels than in later ones, which load them.

    Args:
        parallel: Whether its `prange` loops run on all threads.

    Returns:
        A decorator.
    """
    return numba.njit(cache=True, parallel=parallel, error_model="numpy")


@kernel()
def dot(a, b):
    """Scalar product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel()
def cross(a, b):
    """Vector product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel()
def between(x, first, second):
    """x[first] - x[second]."""
    return x[first, 0] - x[second, 0], x[first, 1] - x[second, 1], x[first, 2] - x[second, 2]


@kernel()
def combine(p, a, q, b):
    """p a + q b."""
    return p * a[0] + q * b[0], p * a[1] + q * b[1], p * a[2] + q * b[2]
