"""Processes that share the cores: independent pieces of work side by side, each on one thread."""

import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.context import SpawnContext, SpawnProcess

_THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def one_thread_each(workers: int) -> ProcessPoolExecutor:
    """A pool of fresh processes, each on one thread unless the environment says otherwise.

    This process keeps its own threads and environment: compiled code refuses another number of threads once it runs.

    Args:
        workers: Processes.
    """
    return ProcessPoolExecutor(workers, mp_context=_OneThread())


class _OneThreadProcess(SpawnProcess):
    def start(self) -> None:
        with _one_thread():
            super().start()


class _OneThread(SpawnContext):
    Process = _OneThreadProcess


@contextmanager
def _one_thread() -> Iterator[None]:
    """The environment that a process started now inherits: thread counts are read when a library is loaded."""
    unset = [name for name in _THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(unset, "1"))
    try:
        yield
    finally:
        for name in unset:
            del os.environ[name]
