"""Peak memory of one case, measured in a process of its own."""

import gc
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec

from cusick_bench.runner.environment import cores
from cusick_bench.runner.processes import process_pool
from cusick_bench.sim.memory import most_memory

P = ParamSpec("P")


_RESET = Path("/proc/self/clear_refs")  # Linux: "5" sets the peak back to what is held now


def _held(line: str) -> int:
    """A figure of this process's memory [bytes]."""
    words = next(row for row in Path("/proc/self/status").read_text().splitlines() if row.startswith(line)).split()
    return 1024 * int(words[1])


def _peak(prepare: Callable[P, Callable[[], object]], *args: P.args, **kwargs: P.kwargs) -> float:
    case = prepare(*args, **kwargs)
    gc.collect()
    if not _RESET.exists():
        before = most_memory()
        case()
        return most_memory() - before
    before = _held("VmRSS")
    _RESET.write_text("5")
    case()
    return _held("VmHWM") - before


def peak_of(prepare: Callable[P, Callable[[], object]], *args: P.args, **kwargs: P.kwargs) -> float:
    """Memory that a case takes beyond a process that is ready for it [bytes]; NaN where no system tells it.

    Args:
        prepare: Function of a module that gets everything ready and returns the case.
        *args: Its arguments, which must be picklable.
        **kwargs: More of them.

    Returns:
        Memory [bytes].
    """
    with process_pool(1, threads=cores()) as pool:
        return pool.submit(_peak, prepare, *args, **kwargs).result()
