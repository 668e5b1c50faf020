"""GNU OpenMP, loaded before torch and numba load it.

GNU OpenMP starts a parallel region in 2 us where numba's own pool takes 30 to 100, and a drop starts hundreds. Its
threads spin while they wait, which on a busy machine costs more than it gains; so they spin no longer than the gaps
inside a step last, and then sleep. Set NUMBA_THREADING_LAYER or GOMP_SPINCOUNT to choose otherwise.

OpenMP reads how long to spin while it is loaded, and torch and numba use the library that is loaded already:
`load_openmp` comes before both, and puts the environment back. (Without it, on a machine with twice as many busy
processes as cores, a drop took three times as long; loading it when the first simulator is made is too late.)
"""

import ctypes
import os
import sys
from contextlib import suppress

_LIBRARY = "libgomp.so.1"
_SPIN_VARIABLE = "GOMP_SPINCOUNT"
_SPINS = "2000"  # measured: 1000 to 10000 are equally fast on a quiet machine, no slower than sleeping on a busy one


def load_openmp() -> None:
    """Loads GNU OpenMP such that its threads spin briefly, unless something else was asked for; starts no thread."""
    asked = _SPIN_VARIABLE in os.environ or os.environ.get("NUMBA_THREADING_LAYER", "default") != "default"
    if sys.platform != "linux" or asked:
        return
    os.environ[_SPIN_VARIABLE] = _SPINS
    try:
        with suppress(OSError):  # numba then takes another pool
            ctypes.CDLL(_LIBRARY)
    finally:
        del os.environ[_SPIN_VARIABLE]
