"""Arithmetic on 3x3 tiles of several matrices at once: one lane of a vector register for each matrix.

The fronts of a cloth's matrix are small, and BLAS runs small matrices at a fraction of the speed of large ones. The
matrices of a batch have one pattern, so the same operation comes for all of them: a number of a tile is a vector of
LANES numbers, one of each matrix, and a tile is nine such vectors, column after column. The operations are written as
LLVM vector code, because compilers vectorise the innermost loop only, which here is not the loop over matrices.

A strip is the tiles of three rows side by side. Places are addresses [bytes]; an operation takes a tuple of them, and
all of it lies in arrays made by `vectors`. Every lane is computed alike, whatever the others hold, so a matrix has the
same factor to the bit in any batch and in any lane.

References:
    K. Kim, T. B. Costa, M. Deveci et al., "Designing vector-friendly compact BLAS and LAPACK kernels", SC17 (2017).
"""

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy import ndarray

from cusick_bench.sim.linear.interface import BLOCK

LANES = 8
"""Matrices that are worked on at once: a cache line, and a register of AVX-512 (two of AVX2, four of NEON)."""

VECTOR = 8 * LANES
"""Size of a vector [bytes]."""

TILE = BLOCK * BLOCK * VECTOR
"""Size of a tile [bytes]."""

_CACHE_LINE = 64  # [bytes]
_vector = ir.VectorType(ir.DoubleType(), LANES)
_integer = ir.IntType(64)
_AXES = range(BLOCK)


def vectors(arrays: int, count: int) -> Float[ndarray, "arrays numbers"]:
    """Arrays of vectors, none of which lies across two cache lines.

    Args:
        arrays: Number of arrays.
        count: Number of vectors in each.

    Returns:
        The arrays, not set.
    """
    storage = np.empty(arrays * count * LANES + _CACHE_LINE // 8)
    start = -storage.ctypes.data % _CACHE_LINE // 8
    return storage[start : start + arrays * count * LANES].reshape(arrays, count * LANES)


class _Code:
    """The code of an operation, while it is generated."""

    def __init__(self, builder: Any) -> None:
        self.builder = builder

    def load(self, place: Any, offset: int = 0) -> Any:
        return self.builder.load(self._address(place, offset), align=8)

    def store(self, value: Any, place: Any, offset: int = 0) -> None:
        self.builder.store(value, self._address(place, offset), align=8)

    def _address(self, place: Any, offset: int) -> Any:
        return self.builder.inttoptr(self.plus(place, offset * VECTOR), _vector.as_pointer())

    def plus(self, place: Any, more: Any) -> Any:
        return self.builder.add(place, _integer(more) if isinstance(more, int) else more)

    def add_product(self, total: Any, a: Any, b: Any) -> Any:
        """total + a b, rounded once."""
        return self._call("fma", a, b, total)

    def subtract_product(self, total: Any, a: Any, b: Any) -> Any:
        return self.add_product(total, self.builder.fneg(a), b)

    def inverse_root(self, value: Any) -> Any:
        """1 / sqrt(value)."""
        return self.builder.fdiv(ir.Constant(_vector, [1.0] * LANES), self._call("sqrt", value))

    def times(self, a: Any, b: Any) -> Any:
        return self.builder.fmul(a, b)

    def _call(self, name: str, *values: Any) -> Any:
        form = ir.FunctionType(_vector, [_vector] * len(values))
        function = cgutils.get_or_insert_function(self.builder.module, form, f"llvm.{name}.v{LANES}f64")
        return self.builder.call(function, values)

    def variable(self, value: Any) -> Any:
        """A vector that changes in a loop; LLVM keeps it in a register."""
        found = cgutils.alloca_once(self.builder, _vector)
        self.builder.store(value, found)
        return found

    def columns(self, count: Any) -> Any:
        """A loop over the columns of a strip; gives the distance of a column from the strip's start."""
        return cgutils.for_range(self.builder, count)

    def column(self, loop: Any) -> Any:
        return self.builder.mul(loop.index, _integer(BLOCK * VECTOR))


def _operation(generate: Callable[..., None]) -> Any:
    """Makes an operation for kernels, which takes a tuple of places, from the function that generates its code."""

    @intrinsic
    def operation(typing, places):
        def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            given = zip(cgutils.unpack_tuple(builder, arguments[0]), places, strict=True)
            generate(_Code(builder), *(context.cast(builder, value, kind, types.int64) for value, kind in given))
            return context.get_dummy_value()

        return types.void(places), code

    operation.__doc__ = generate.__doc__
    return operation


@_operation
def add_tile(_code, target, source):
    """C <- C + A.

    Args:
        target: C.
        source: A.
    """
    for number in range(BLOCK * BLOCK):
        _code.store(_code.builder.fadd(_code.load(target, number), _code.load(source, number)), target, number)


@_operation
def subtract_strips(_code, target, left, right, columns):
    """C <- C - A B^T, of a tile C and the first columns of two strips.

    Args:
        target: C.
        left: A.
        right: B.
        columns: Number of columns (not of tiles).
    """
    pairs = list(product(_AXES, _AXES))
    totals = {(i, j): _code.variable(_code.load(target, BLOCK * j + i)) for i, j in pairs}
    with _code.columns(columns) as loop:
        column = _code.column(loop)
        a, b = ([_code.load(_code.plus(strip, column), axis) for axis in _AXES] for strip in (left, right))
        for i, j in pairs:
            _code.builder.store(_code.subtract_product(_code.builder.load(totals[i, j]), a[i], b[j]), totals[i, j])
    for i, j in pairs:
        _code.store(_code.builder.load(totals[i, j]), target, BLOCK * j + i)


@_operation
def factorise_tile(_code, tile):
    """A <- L with L L^T = A, in the lower triangle; the diagonal receives its reciprocals.

    Args:
        tile: A.
    """
    a = {(i, j): _code.load(tile, BLOCK * j + i) for i, j in product(_AXES, _AXES) if i >= j}
    for j in _AXES:
        for k in range(j):
            for i in range(j, BLOCK):
                a[i, j] = _code.subtract_product(a[i, j], a[i, k], a[j, k])
        a[j, j] = _code.inverse_root(a[j, j])
        for i in range(j + 1, BLOCK):
            a[i, j] = _code.times(a[i, j], a[j, j])
    for (i, j), value in a.items():
        _code.store(value, tile, BLOCK * j + i)


@_operation
def divide_tile(_code, tile, triangle):
    """B <- B L^-T, of two tiles.

    Args:
        tile: B.
        triangle: L as `factorise_tile` leaves it.
    """
    low = _lower(_code, triangle)
    for i in _AXES:
        row = [_code.load(tile, BLOCK * j + i) for j in _AXES]
        for j, value in enumerate(_solved(_code, low, row)):
            _code.store(value, tile, BLOCK * j + i)


@_operation
def solve_tile(_code, x, triangle):
    """x <- L^-1 x.

    Args:
        x: Three vectors.
        triangle: L as `factorise_tile` leaves it.
    """
    for j, value in enumerate(_solved(_code, _lower(_code, triangle), [_code.load(x, j) for j in _AXES])):
        _code.store(value, x, j)


@_operation
def solve_transposed_tile(_code, x, triangle):
    """x <- L^-T x.

    Args:
        x: Three vectors.
        triangle: L as `factorise_tile` leaves it.
    """
    low, value = _lower(_code, triangle), [_code.load(x, j) for j in _AXES]
    for j in reversed(_AXES):
        for k in range(j + 1, BLOCK):
            value[j] = _code.subtract_product(value[j], low[k, j], value[k])
        value[j] = _code.times(value[j], low[j, j])
        _code.store(value[j], x, j)


@_operation
def subtract_strip_times(_code, target, strip, x, columns):
    """y <- y - A x, of the first columns of a strip.

    Args:
        target: y, three vectors.
        strip: A.
        x: A vector for each column.
        columns: Number of columns.
    """
    totals = [_code.variable(_code.load(target, i)) for i in _AXES]
    with _code.columns(columns) as loop:
        value = _code.load(_code.plus(x, _code.builder.mul(loop.index, _integer(VECTOR))))
        for i in _AXES:
            factor = _code.load(_code.plus(strip, _code.column(loop)), i)
            _code.builder.store(_code.subtract_product(_code.builder.load(totals[i]), factor, value), totals[i])
    for i in _AXES:
        _code.store(_code.builder.load(totals[i]), target, i)


@_operation
def subtract_transposed_strip_times(_code, target, strip, x, columns):
    """y <- y - A^T x, of the first columns of a strip.

    Args:
        target: y, a vector for each column.
        strip: A.
        x: Three vectors.
        columns: Number of columns.
    """
    values = [_code.load(x, i) for i in _AXES]
    with _code.columns(columns) as loop:
        place = _code.plus(target, _code.builder.mul(loop.index, _integer(VECTOR)))
        total = _code.load(place)
        for i in _AXES:
            total = _code.subtract_product(total, _code.load(_code.plus(strip, _code.column(loop)), i), values[i])
        _code.store(total, place)


def _lower(code: _Code, triangle: Any) -> dict[tuple[int, int], Any]:
    return {(i, j): code.load(triangle, BLOCK * j + i) for i, j in product(_AXES, _AXES) if i >= j}


def _solved(code: _Code, low: dict[tuple[int, int], Any], value: list[Any]) -> list[Any]:
    """L^-1 applied to three numbers."""
    for j in _AXES:
        for k in range(j):
            value[j] = code.subtract_product(value[j], low[j, k], value[k])
        value[j] = code.times(value[j], low[j, j])
    return value
