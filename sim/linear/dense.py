"""Dense linear algebra inside numba kernels: SciPy's BLAS and LAPACK, on matrices stored by columns.

A kernel cached on disk must not hold an address of the process that compiled it. Each routine therefore
gets a symbol of our own, registered with LLVM at import, and kernels refer to it by name.

Matrices are given by a flat array that starts at their first number, and by their stride: the distance
between the starts of two columns.
"""

import ctypes
import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import llvmlite.binding
import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import get_cython_function_address, intrinsic
from threadpoolctl import ThreadpoolController

from cusick_bench.sim.kernel_cache import numba


def _routine(library: str, name: str, arguments: int) -> Any:
    """Numba's handle of `scipy.linalg.<library>.<name>`; all arguments are pointers, as in Fortran."""
    symbol = f"cusick_bench_{name}"
    llvmlite.binding.add_symbol(symbol, get_cython_function_address(f"scipy.linalg.{library}", name))
    return types.ExternalFunction(symbol, types.void(*[types.voidptr] * arguments))


_potrf = _routine("cython_lapack", "dpotrf", 5)
_trsm = _routine("cython_blas", "dtrsm", 11)
_syrk = _routine("cython_blas", "dsyrk", 10)
_gemm = _routine("cython_blas", "dgemm", 13)
_trsv = _routine("cython_blas", "dtrsv", 8)
_gemv = _routine("cython_blas", "dgemv", 11)


def _on_stack(as_type: Any) -> Any:
    """Function for kernels that puts a number on the stack and gives its address."""

    @intrinsic
    def address(context, number):
        def generate(target, builder, signature, arguments):
            value = target.cast(builder, arguments[0], signature.args[0], as_type)
            return builder.bitcast(cgutils.alloca_once_value(builder, value), cgutils.voidptr_t)

        return types.voidptr(number), generate

    return address


_integer: Any = _on_stack(types.int32)
_real: Any = _on_stack(types.float64)
_letter: Any = _on_stack(types.uint8)

_LOWER, _RIGHT, _TRANSPOSED, _PLAIN = (ord(letter) for letter in "LRTN")


@numba.njit(cache=True)
def cholesky(matrix, size, stride):
    """A <- L with L L^T = A, in the lower triangle.

    Args:
        matrix: A; changed.
        size: Rows and columns of A.
        stride: Distance between the starts of its columns.

    Returns:
        Whether A is positive definite.
    """
    failed = np.zeros(1, np.int32)
    _potrf(_letter(_LOWER), _integer(size), matrix.ctypes, _integer(stride), failed.ctypes)
    return failed[0] == 0


@numba.njit(cache=True)
def divide_by_transposed(triangle, matrix, rows, columns, stride):
    """B <- B L^-T.

    Args:
        triangle: L.
        matrix: B; changed.
        rows: Rows of B.
        columns: Columns of B, and size of L.
        stride: Distance between the starts of the columns of both.
    """
    _trsm(
        _letter(_RIGHT), _letter(_LOWER), _letter(_TRANSPOSED), _letter(_PLAIN), _integer(rows),
        _integer(columns), _real(1.0), triangle.ctypes, _integer(stride), matrix.ctypes, _integer(stride),
    )  # fmt: skip


@numba.njit(cache=True)
def subtract_product(left, right, target, rows, columns, inner, stride):
    """C <- C - A B^T.

    Args:
        left: A.
        right: B.
        target: C; changed.
        rows: Rows of A and C.
        columns: Rows of B, columns of C.
        inner: Columns of A and B.
        stride: Distance between the starts of the columns of all three.
    """
    _gemm(
        _letter(_PLAIN), _letter(_TRANSPOSED), _integer(rows), _integer(columns), _integer(inner),
        _real(-1.0), left.ctypes, _integer(stride), right.ctypes, _integer(stride), _real(1.0), target.ctypes,
        _integer(stride),
    )  # fmt: skip


@numba.njit(cache=True)
def negative_square(matrix, rows, columns, stride, target):
    """C <- -A A^T, its lower triangle, without gaps between its columns.

    Args:
        matrix: A.
        rows: Rows of A, and size of C.
        columns: Columns of A.
        stride: Distance between the starts of the columns of A.
        target: C; overwritten.
    """
    _syrk(
        _letter(_LOWER), _letter(_PLAIN), _integer(rows), _integer(columns), _real(-1.0), matrix.ctypes,
        _integer(stride), _real(0.0), target.ctypes, _integer(rows),
    )  # fmt: skip


@numba.njit(cache=True)
def solve_lower(triangle, size, stride, vector, transposed):
    """x <- L^-1 x, or x <- L^-T x.

    Args:
        triangle: L.
        size: Its size.
        stride: Distance between the starts of its columns.
        vector: x; changed.
        transposed: Whether L is transposed.
    """
    _trsv(
        _letter(_LOWER), _letter(_TRANSPOSED if transposed else _PLAIN), _letter(_PLAIN), _integer(size),
        triangle.ctypes, _integer(stride), vector.ctypes, _integer(1),
    )  # fmt: skip


@numba.njit(cache=True)
def subtract_times(matrix, rows, columns, stride, vector, target, transposed):
    """y <- y - A x, or y <- y - A^T x.

    Args:
        matrix: A.
        rows: Its rows.
        columns: Its columns.
        stride: Distance between the starts of its columns.
        vector: x.
        target: y; changed.
        transposed: Whether A is transposed.
    """
    _gemv(
        _letter(_TRANSPOSED if transposed else _PLAIN), _integer(rows), _integer(columns), _real(-1.0),
        matrix.ctypes, _integer(stride), vector.ctypes, _integer(1), _real(1.0), target.ctypes, _integer(1),
    )  # fmt: skip


def _thread_functions() -> tuple[Any, Any] | None:
    """Setter and getter of OpenBLAS's thread count; None where SciPy uses another BLAS, and on Windows.

    There a library does not show the functions of those that it is linked to.
    """
    library = ctypes.CDLL(importlib.import_module("scipy.linalg.cython_blas").__file__)
    for prefix in ("scipy_openblas", "openblas"):
        setter, getter = f"{prefix}_set_num_threads", f"{prefix}_get_num_threads"
        if hasattr(library, setter):
            return getattr(library, setter), getattr(library, getter)
    return None


THREAD_FUNCTIONS = _thread_functions()


@lru_cache(maxsize=1)  # looks through all libraries that are loaded
def _any_blas() -> ThreadpoolController:
    return ThreadpoolController().select(user_api="blas")


@contextmanager
def single_threaded() -> Iterator[None]:
    """Keep BLAS on one thread: kernels are parallel themselves, and its sums then have one order."""
    if THREAD_FUNCTIONS is None:
        with _any_blas().limit(limits=1):
            yield
        return
    set_threads, get_threads = THREAD_FUNCTIONS
    before = get_threads()
    set_threads(1)
    try:
        yield
    finally:
        set_threads(before)
