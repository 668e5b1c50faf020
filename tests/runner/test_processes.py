"""A pool's processes are on a number of threads; the process that asks for them keeps its own."""

import copy
import logging
import os
import signal
import sys
import threading
import time
import warnings
from pathlib import Path

import numba
import pytest
import torch
from threadpoolctl import threadpool_info

from cusick_bench.cli.verbosity import messages, tell_less, tell_more
from cusick_bench.datasets.errors import DataError
from cusick_bench.files import BadFile, read_json_object
from cusick_bench.runner.processes import one_thread, process_pool
from cusick_bench.sim.errors import BadMeshFile, CusickError, MembersDiverged

THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@pytest.fixture
def unset(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in THREADS:
        monkeypatch.delenv(name, raising=False)


@pytest.mark.usefixtures("unset")
def test_workers_are_on_one_thread_and_this_environment_stays_as_it_was() -> None:
    with process_pool(1) as pool:
        given = list(pool.map(os.getenv, THREADS))
    assert given == ["1", "1", "1"]
    assert not [name for name in THREADS if name in os.environ]


@pytest.mark.usefixtures("unset")
def test_the_environment_has_the_last_word(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with process_pool(1) as pool:
        assert pool.submit(os.getenv, "OMP_NUM_THREADS").result() == "2"
    assert os.environ["OMP_NUM_THREADS"] == "2"


@pytest.mark.usefixtures("unset")
def test_number_of_threads_is_that_of_the_pool() -> None:
    with process_pool(1, threads=2) as pool:
        assert list(pool.map(os.getenv, THREADS)) == ["2", "2", "2"]


@pytest.mark.parametrize(("system", "started"), [("win32", 61), ("linux", 100)])
def test_windows_gets_as_many_workers_as_it_can_wait_for(monkeypatch: pytest.MonkeyPatch, system: str, started: int):
    """More of them ended in a traceback."""
    monkeypatch.setattr(sys, "platform", system)
    assert process_pool(100)._max_workers == started


@pytest.mark.parametrize(
    ("level", "shown"),
    [
        ("quiet", []),
        ("", ["warning: the cell is run again"]),
        ("verbose", ["a file is read", "warning: the cell is run again", "library.py:1: UserWarning: slow"]),
    ],
)
def test_workers_tell_as_much_as_the_command_that_starts_them(capfd, level: str, shown: list[str]) -> None:
    logger = logging.getLogger("cusick_bench.runner.store")
    with messages():
        tell_less(level == "quiet")
        tell_more(level == "verbose")
        with process_pool(1) as pool:
            pool.submit(logger.debug, "a file is read").result()
            pool.submit(logger.warning, "the cell is run again").result()
            pool.submit(warnings.warn_explicit, "slow", UserWarning, "library.py", 1).result()
    assert [line.strip() for line in capfd.readouterr().err.splitlines()] == shown


def test_a_workers_error_is_told_as_it_is(tmp_path: Path) -> None:
    """One that could not be unpickled broke the pool, as a worker that was killed does."""
    damaged = tmp_path / "design.json"
    damaged.write_text("{")
    with pytest.raises(BadFile, match=r"design.json: cannot be read as JSON.*; mend it") as raised:  # noqa: SIM117
        with process_pool(1) as pool:
            pool.submit(read_json_object, damaged, remedy="mend it").result()
    assert raised.value.remedy == "mend it"


@pytest.mark.parametrize(
    "error",
    [
        BadFile("fabrics.csv", "is empty", "fill it"),
        BadMeshFile("cloth.obj", "has no faces", kind="no-faces"),
        MembersDiverged("two flew apart", [1, 3], 5),
        DataError("is missing", where="data", remedy="give another one", kind="missing"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_are_copied_as_they_are(error: CusickError) -> None:
    again = copy.copy(error)
    assert type(again) is type(error)
    assert (str(again), vars(again)) == (str(error), vars(error))


@pytest.mark.threads
def test_one_thread_for_a_while() -> None:
    def threads() -> tuple[int, ...]:
        blas = [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]
        return numba.get_num_threads(), torch.get_num_threads(), *blas

    before = threads()
    assert len(before) > 2
    with one_thread():
        assert set(threads()) == {1}
    assert threads() == before


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="needs signals that stop a process")
def test_a_worker_killed_with_the_lock_while_its_pool_shuts_down_keeps_nobody_waiting() -> None:
    """Of idle workers one waits for a task, with the lock of the queue, and the other for the lock."""
    with process_pool(2) as pool:
        list(pool.map(time.sleep, [0.1, 0.1]))
        workers = set(pool._processes)
        assert len(workers) == 2
        time.sleep(3.0)  # both have started, and wait
        waiting = pool.submit(os.getpid).result()  # it took a task, and the other one the lock
        (holding,) = workers - {waiting}
        time.sleep(0.5)
        for worker in workers:
            os.kill(worker, signal.SIGSTOP)
        at_last = threading.Timer(30.0, _end, [waiting])
        for timer in (threading.Timer(1.0, _end, [holding, waiting]), at_last):
            timer.start()
        begin = time.monotonic()
    took = time.monotonic() - begin
    at_last.cancel()
    assert took < 20


def _end(killed: int, going_on: int | None = None) -> None:
    os.kill(killed, signal.SIGKILL)
    if going_on is not None:
        os.kill(going_on, signal.SIGCONT)
