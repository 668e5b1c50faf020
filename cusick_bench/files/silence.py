"""Work without Python's warnings, whose filters are the process's."""

import os
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager


class _Turn:
    """Whose turn it is; renewed in a forked process, whose other threads are gone and would never give it back."""

    lock = threading.RLock()

    @classmethod
    def renew(cls) -> None:
        cls.lock = threading.RLock()


if hasattr(os, "register_at_fork"):  # Windows does not fork
    os.register_at_fork(after_in_child=_Turn.renew)


@contextmanager
def without_warnings() -> Iterator[None]:
    """Ignores all warnings within, and puts the filters back; one thread at a time.

    Of two threads that ignore warnings at once, one would put back the other's silence, and no warning of the process
    would be shown any more.

    Yields:
        Nothing; no warning is shown within the `with` block.
    """
    with _Turn.lock, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
