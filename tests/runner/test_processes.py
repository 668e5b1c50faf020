"""A pool's processes are on a number of threads; the process that asks for them keeps its own."""

import os
import signal
import threading
import time

import numba
import pytest
import torch
from threadpoolctl import threadpool_info

from cusick_bench.runner.processes import one_thread, process_pool

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
