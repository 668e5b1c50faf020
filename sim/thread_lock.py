"""A lock of a process that outlives a fork."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class ThreadLock:
    """Lets one thread of a process in at a time, which may come in again.

    Renewed in a forked process, whose other threads are gone and would never give it back.
    """

    def __init__(self) -> None:
        self._renew()
        if hasattr(os, "register_at_fork"):  # Windows does not fork
            os.register_at_fork(after_in_child=self._renew)

    def _renew(self) -> None:
        self._lock = threading.RLock()

    @contextmanager
    def held(self) -> Iterator[None]:
        """Waits until no other thread is within, and keeps them waiting meanwhile.

        Yields:
            Nothing; this thread is within.
        """
        with self._lock:
            yield
