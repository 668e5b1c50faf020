"""Gives memory that was freed back to the system, without which a long run takes more with every cell.

The C library keeps freed blocks for later ones, and between them lie small ones that live on. Where arrays have another
size in every cell, what it keeps grows by some 70 MB a cell: to gigabytes in a run of a hundred.
"""

import ctypes
import gc
import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

try:
    import resource
except ImportError:  # Windows
    resource = None

_LONG = 1.0  # [s]; shorter work leaves little behind, and looking for it takes a tenth of a second


@contextmanager
def memory_returned() -> Iterator[None]:
    """Gives back the memory that was freed meanwhile, where that took a second or more; also decorates functions."""
    start = time.monotonic()
    try:
        yield
    finally:
        if time.monotonic() - start >= _LONG:
            return_memory()


def return_memory() -> None:
    """Frees objects that only refer to each other, and returns free memory to the system where glibc is there."""
    gc.collect()
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


def most_memory() -> float:
    """Most memory that this process has held so far [bytes]; NaN on Windows, where Python does not tell it."""
    if resource is None:
        return math.nan
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(peak if sys.platform == "darwin" else 1024 * peak)
