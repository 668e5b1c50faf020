"""Peak memory of one case, measured in a process of its own."""

import gc
import resource
import sys
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec

from cusick_bench.runner.environment import cores
from cusick_bench.runner.processes import process_pool

P = ParamSpec("P")


_RESET = Path("/proc/self/clear_refs")  # Linux: "5" sets the peak back to what is held now


def _held(line: str) -> int:
    """A figure of this process's memory [bytes]."""
    words = next(row for row in Path("/proc/self/status").read_text().splitlines() if row.startswith(line)).split()
    return 1024 * int(words[1])


def _peak_ever() -> int:
    """Most memory that this process has held so far [bytes]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def _peak(prepare: Callable[P, Callable[[], object]], *args: P.args, **kwargs: P.kwargs) -> int:
    case = prepare(*args, **kwargs)
    gc.collect()
    if not _RESET.exists():
        before = _peak_ever()
        case()
        return _peak_ever() - before
    before = _held("VmRSS")
    _RESET.write_text("5")
    case()
    return _held("VmHWM") - before


def peak_of(prepare: Callable[P, Callable[[], object]], *args: P.args, **kwargs: P.kwargs) -> int:
    """Memory that a case takes beyond a process that is ready for it [bytes].

    Args:
        prepare: Function of a module that gets everything ready and returns the case.
        *args: Its arguments, which must be picklable.
        **kwargs: More of them.

    Returns:
        Memory [bytes].
    """
    with process_pool(1, threads=cores()) as pool:
        return pool.submit(_peak, prepare, *args, **kwargs).result()
