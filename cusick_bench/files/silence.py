"""Work without Python's warnings, whose filters are the process's."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from cusick_bench.sim.thread_lock import ThreadLock

_SILENCE = ThreadLock()


@contextmanager
def without_warnings() -> Iterator[None]:
    """Ignores all warnings within, and puts the filters back; one thread at a time.

    Of two threads that ignore warnings at once, one would put back the other's silence, and no warning of the process
    would be shown any more.

    Yields:
        Nothing; no warning is shown within the `with` block.
    """
    with _SILENCE.held(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
