"""Which threads the compiled kernels run on.

`thread_pool` starts the threads, of GNU OpenMP where it is there (see `openmp`), and puts numba's configuration back.

OpenMP does not survive a fork: numba would end the child. `check_fork` says so in time, and what to do.

Systems and linear solvers use their storage again at every step. `alone` therefore lets one thread of a process
simulate at a time; kernels run on all threads of the pool as it is.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numba
from numba.core import config
from numba.np.ufunc.parallel import threading_layer

from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.thread_lock import ThreadLock

_PREFERRED = ["omp", "workqueue", "tbb"]
_SIMULATION = ThreadLock()


@dataclass(frozen=True)
class ThreadPool:
    """The threads of the kernels.

    Attributes:
        layer: What runs them, in numba's words: `omp`, `workqueue` or `tbb`.
        process: Number of the process that started them.
    """

    layer: str
    process: int


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


@contextmanager
def alone() -> Iterator[None]:
    """Waits until no other thread of this process simulates, and keeps them waiting meanwhile."""
    with _SIMULATION.held():
        yield
