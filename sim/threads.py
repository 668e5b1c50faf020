"""Which threads the compiled kernels run on.

GNU OpenMP starts a parallel region in 2 us where numba's own pool takes 30 to 100, and a drop starts hundreds. Its
threads spin while they wait, which on a busy machine costs more than it gains; so they spin no longer than the gaps
inside a step last, and then sleep. Set NUMBA_THREADING_LAYER or GOMP_SPINCOUNT to choose otherwise.

OpenMP reads how long to spin while it is loaded, and torch loads the same library: `load_openmp` comes before torch,
and puts the environment back. (Without it, on a machine with twice as many busy processes as cores, a drop took three
times as long; loading it when the first simulator is made is too late.) `thread_pool` starts the threads, and puts
numba's configuration back.

OpenMP does not survive a fork: numba would end the child. `check_fork` says so in time, and what to do.
"""

import importlib
import os
import sys
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numba
from numba.core import config
from numba.np.ufunc.parallel import threading_layer

from cusick_bench.sim.errors import SimulationError

_SPIN_VARIABLE = "GOMP_SPINCOUNT"
_SPINS = "2000"  # measured: 1000 to 10000 are equally fast on a quiet machine, no slower than sleeping on a busy one
_PREFERRED = ["omp", "workqueue", "tbb"]


@dataclass(frozen=True)
class ThreadPool:
    """The threads of the kernels.

    Attributes:
        layer: What runs them, in numba's words: `omp`, `workqueue` or `tbb`.
        process: Number of the process that started them.
    """

    layer: str
    process: int


def load_openmp() -> None:
    """Loads GNU OpenMP such that its threads spin briefly, unless something else was asked for; starts no thread."""
    configuration: Any = config
    if sys.platform != "linux" or configuration.THREADING_LAYER != "default" or _SPIN_VARIABLE in os.environ:
        return
    os.environ[_SPIN_VARIABLE] = _SPINS
    try:
        with suppress(ImportError):  # numba then takes another pool
            importlib.import_module("numba.np.ufunc.omppool")
    finally:
        del os.environ[_SPIN_VARIABLE]


@lru_cache(maxsize=1)
def thread_pool() -> ThreadPool:
    """Starts the threads at the first call; to be called before any parallel kernel or numba's thread functions.

    Prefers OpenMP where it is there and nothing else was asked for.

    Returns:
        The threads. In a forked process they may be those of its parent, see `check_fork`.
    """
    configuration: Any = config
    priority = configuration.THREADING_LAYER_PRIORITY
    configuration.THREADING_LAYER_PRIORITY = _PREFERRED
    try:
        numba.get_num_threads()  # starts them
    finally:
        configuration.THREADING_LAYER_PRIORITY = priority
    return ThreadPool(threading_layer(), os.getpid())


def check_fork() -> None:
    """Checks that kernels can run in this process.

    Raises:
        SimulationError: The process was forked from one that had simulated.
    """
    pool = thread_pool()
    if pool.layer == "omp" and pool.process != os.getpid():
        raise SimulationError(
            "this process was forked from one that has simulated, and OpenMP threads do not survive a fork; start "
            "processes with multiprocessing.get_context('spawn'), or set NUMBA_THREADING_LAYER=workqueue"
        )
