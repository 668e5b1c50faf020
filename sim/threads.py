"""Which threads the compiled kernels run on.

GNU OpenMP starts a parallel region in 2 us where numba's own pool takes 30 to 100, and a drop starts hundreds. Its
threads spin while they wait, which on a busy machine costs more than it gains; so they spin no longer than the gaps
inside a step last, and then sleep. Set NUMBA_THREADING_LAYER or GOMP_SPINCOUNT to choose otherwise.

OpenMP does not survive a fork: numba would end the child. `check_fork` says so in time, and what to do.
"""

import os
from contextlib import suppress
from typing import Any

from numba.core import config
from numba.np.ufunc.parallel import threading_layer

from cusick_bench.sim.errors import SimulationError

_SPINS = (
    "2000"  # measured: 1000 to 10000 are equally fast on a quiet machine, and no slower than sleeping on a busy one
)
_state = {"forked": False}


def configure() -> None:
    """Prefers OpenMP where it is there and nothing else was asked for; to be called before any kernel runs."""
    configuration: Any = config
    if configuration.THREADING_LAYER == "default":
        os.environ.setdefault("GOMP_SPINCOUNT", _SPINS)
        configuration.THREADING_LAYER_PRIORITY = ["omp", "workqueue", "tbb"]
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=_after_fork)


def _after_fork() -> None:
    with suppress(ValueError):  # no kernel has run yet: the child starts threads of its own
        _state["forked"] = threading_layer() == "omp"


def check_fork() -> None:
    """Checks that kernels can run in this process.

    Raises:
        SimulationError: The process was forked from one that had simulated.
    """
    if _state["forked"]:
        raise SimulationError(
            "this process was forked from one that has simulated, and OpenMP threads do not survive a fork; start "
            "processes with multiprocessing.get_context('spawn'), or set NUMBA_THREADING_LAYER=workqueue"
        )
