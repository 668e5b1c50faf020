"""Process pools of the project: fresh processes that share the cores, with their numbers of threads.

Compiled code reads its number of threads when it is loaded, and refuses another one afterwards. So the number is set in
the environment only while a process is started: a permanent setting would slow down the present process, and a setting
within a worker would come too late for a library that is already loaded.
"""

import logging
import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, redirect_stdout
from multiprocessing.connection import wait
from multiprocessing.context import SpawnContext, SpawnProcess
from types import TracebackType
from typing import Any

import numba
import torch
from threadpoolctl import threadpool_limits

from cusick_bench.sim.threads import thread_pool

ORPHANED = 70  # exit status of a worker whose parent has ended
_PACKAGE = "cusick_bench"  # its name, and that of its logger
_MOST_ON_WINDOWS = 61  # processes of a pool: Windows waits for no more than 63 things at once
_THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def process_pool(
    workers: int,
    *,
    threads: int = 1,
    initializer: Callable[..., object] | None = None,
    initargs: tuple[Any, ...] = (),
) -> ProcessPoolExecutor:
    """A pool of fresh processes, each on so many threads unless the environment says otherwise.

    This process keeps its own threads and environment.

    Args:
        workers: Number of processes; on Windows no more than 61 are started.
        threads: Threads of each.
        initializer: Called in each process as it starts.
        initargs: What it is given.

    Returns:
        The pool; it is a context manager. Where that is left by an error or by Ctrl-C, the processes are ended at once;
        they end by themselves where this process ends, be it killed.
    """
    most = _MOST_ON_WINDOWS if sys.platform == "win32" else workers
    return _Pool(min(workers, most), _Context(threads), initializer, initargs)


@contextmanager
def one_thread() -> Iterator[None]:
    """One thread in this process for a while: what is computed then is the same to the bit on any number of cores."""
    thread_pool()  # numba's thread functions would start it without its preferences
    before = torch.get_num_threads(), numba.get_num_threads()
    torch.set_num_threads(1)
    numba.set_num_threads(1)
    try:
        with threadpool_limits(limits=1, user_api="blas"):
            yield
    finally:
        torch.set_num_threads(before[0])
        numba.set_num_threads(before[1])


class _Pool(ProcessPoolExecutor):
    """Waits for its processes only where all went well."""

    def __init__(
        self, workers: int, context: "_Context", initializer: Callable[..., object] | None, initargs: tuple[Any, ...]
    ) -> None:
        super().__init__(workers, mp_context=context, initializer=initializer, initargs=initargs)
        self._context = context

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        if kind is not None:
            self.shutdown(wait=False, cancel_futures=True)
            self._context.end()
        else:
            threading.Thread(target=self._context.end_with_a_killed_one, daemon=True).start()
        return super().__exit__(kind, error, trace)


class _Context(SpawnContext):
    """Starts processes on a number of threads, and can end them."""

    def __init__(self, threads: int) -> None:
        self._threads = threads
        self._started: list[SpawnProcess] = []

    def Process(self, *args: Any, **kwargs: Any) -> SpawnProcess:  # pyright: ignore[reportIncompatibleVariableOverride]
        self._started.append(_Process(self._threads, *args, **kwargs))
        return self._started[-1]

    def end(self) -> None:
        """Ends all processes that it started, in the midst of their work."""
        for process in self._started:
            if process.pid is not None:
                process.terminate()

    def end_with_a_killed_one(self) -> None:
        """Waits until all processes that it started have ended; where one was killed, it ends the others.

        A process may be killed while it holds the lock of the queue that all of them read, and a pool that is shutting
        down, its work done, no longer looks whether its processes live.
        """
        left = [process for process in self._started if process.pid is not None]
        while left:
            wait([process.sentinel for process in left])
            ended = [process for process in left if process.exitcode is not None]
            if any(process.exitcode for process in ended):
                self.end()
            left = [process for process in left if process not in ended]


class _Process(SpawnProcess):
    def __init__(self, threads: int, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._threads = threads
        self._levels = _levels()

    def start(self) -> None:
        with threads_of_new_processes(self._threads), _interrupts_blocked():
            super().start()

    def run(self) -> None:
        """In the new process: works until the process that started it ends, however that ends.

        What is printed goes to standard error, for standard output is that of the parent's results. Messages are shown
        from the parent's levels on.
        """
        threading.Thread(target=_end_with_parent, name="end-with-parent", daemon=True).start()
        _show_from(*self._levels)
        with redirect_stdout(sys.stderr):
            super().run()


class _Line(logging.Formatter):
    """A message as the command line shows it."""

    def format(self, record: logging.LogRecord) -> str:
        text = record.getMessage()
        return f"{record.levelname.lower()}: {text}" if record.levelno >= logging.WARNING else text


def _levels() -> tuple[int, int]:
    """The levels from which on messages of the package, and those of libraries, are shown in this process."""
    last = logging.lastResort
    return logging.getLogger(_PACKAGE).level, logging.WARNING if last is None else last.level


def _show_from(own: int, libraries: int) -> None:
    """Shows in a new process what the one that started it does: `-q` and `-v` were given to that one alone."""
    logger, handler = logging.getLogger(_PACKAGE), logging.StreamHandler()
    handler.setFormatter(_Line())
    logger.addHandler(handler)
    logger.setLevel(own)
    if logging.lastResort is not None:
        logging.lastResort.setLevel(libraries)
    if libraries > logging.WARNING:  # a command without `-v`
        warnings.simplefilter("ignore")
        if own < logging.ERROR:
            warnings.filterwarnings("default", module=_PACKAGE)


def _end_with_parent() -> None:
    """Waits for the parent's end, which closes its end of a pipe, and then ends this process in the midst of its work.

    What the process was writing appears whole or not at all (`store`), and its locks end with it.
    """
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(ORPHANED)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """A process started now never sees Ctrl-C, which a terminal sends to all: the one that started it ends it."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def threads_of_new_processes(threads: int) -> Iterator[None]:
    """Processes started now have so many threads, unless the environment says otherwise already.

    Args:
        threads: Threads of each.

    Returns:
        A context manager.
    """
    unset = [name for name in _THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(unset, str(threads)))
    try:
        yield
    finally:
        for name in unset:
            del os.environ[name]
