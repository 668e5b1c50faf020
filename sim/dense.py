"""Dense BLAS and LAPACK of SciPy, callable from numba kernels that are cached on disk.

A cached kernel must not hold an address of the process that compiled it. Each routine therefore gets a symbol of our
own, registered with LLVM at import, and kernels refer to it by name. All arguments are pointers, as in Fortran.
"""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager

import llvmlite.binding
import numpy as np
from numba import types
from numba.extending import get_cython_function_address
from scipy.linalg import cython_blas

LOWER, RIGHT, TRANSPOSE, PLAIN = (np.frombuffer(letter, np.uint8) for letter in (b"L", b"R", b"T", b"N"))
"""Option letters of BLAS; PLAIN ("N") is "not transposed" or "no unit diagonal"."""

ONE, MINUS_ONE, ZERO = (np.array([number]) for number in (1.0, -1.0, 0.0))
STEP_ONE = np.array([1], np.int32)


def _routine(library: str, name: str, arguments: int) -> types.ExternalFunction:
    """Numba's handle of `scipy.linalg.<library>.<name>`."""
    symbol = f"cusick_bench_{name}"
    llvmlite.binding.add_symbol(symbol, get_cython_function_address(f"scipy.linalg.{library}", name))
    return types.ExternalFunction(symbol, types.void(*[types.voidptr] * arguments))


cholesky = _routine("cython_lapack", "dpotrf", 5)
solve_triangular_panel = _routine("cython_blas", "dtrsm", 11)
subtract_outer_product = _routine("cython_blas", "dsyrk", 10)
solve_triangular = _routine("cython_blas", "dtrsv", 8)
multiply = _routine("cython_blas", "dgemv", 11)
multiply_matrices = _routine("cython_blas", "dgemm", 13)


def _thread_functions():
    """Setter and getter of OpenBLAS's thread count, or None where SciPy uses another BLAS."""
    library = ctypes.CDLL(cython_blas.__file__)
    for prefix in ("scipy_openblas", "openblas"):
        try:
            return getattr(library, f"{prefix}_set_num_threads"), getattr(library, f"{prefix}_get_num_threads")
        except AttributeError:
            continue
    return None


_THREADS = _thread_functions()


@contextmanager
def single_threaded() -> Iterator[None]:
    """Keep SciPy's OpenBLAS on one thread: our kernels are parallel themselves, and its sums then have one order."""
    if _THREADS is None:
        yield
        return
    set_threads, get_threads = _THREADS
    before = get_threads()
    set_threads(1)
    try:
        yield
    finally:
        set_threads(before)
