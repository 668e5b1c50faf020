"""Several processes: a kill and the same numbers after it, two runs of one cell, workers that die."""

import multiprocessing
import os
import queue
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack

import pytest
from small_grid import SMALL, numbers, run_small, say_much, small_run_arguments

from cusick_bench.runner import Cell, RunnerError, Source, Store, Unwatched, plan, run_cell
from cusick_bench.runner.executors.pool import _start_worker, _Worker
from cusick_bench.runner.processes import process_pool

pytestmark = pytest.mark.usefixtures("one_thread")


class TestKill:
    def test_killed_process_resumes_to_the_same_numbers(self, data, tmp_path):
        """kill -9 in the middle of a fit, then the same command again."""
        (cell,), _ = run_small(data, tmp_path / "whole", ["homo"])
        command = [sys.executable, "-m", "cusick_bench.cli", *small_run_arguments(data, tmp_path / "killed", "homo")]
        process = subprocess.Popen(command, stderr=subprocess.DEVNULL, env=os.environ | {"NUMBA_NUM_THREADS": "1"})
        trace = tmp_path / "killed" / "cells" / cell.key / "trace.jsonl"
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline and process.poll() is None:
            if trace.exists() and trace.read_text().count("\n") >= 2:
                break
            time.sleep(0.002)
        process.kill()
        assert process.wait() == -signal.SIGKILL, "it ended by itself"
        assert trace.exists()
        assert not (trace.parent / "done").exists(), "killed too late to prove anything"
        run_small(data, tmp_path / "killed", ["homo"])
        assert numbers(trace.parent) == numbers(tmp_path / "whole" / "cells" / cell.key)

    def test_two_runs_of_one_cell_do_not_mix(self, data, tmp_path, dataset):
        (cell,) = plan(dataset, solvers=["null:disc"], cloths=["fabric_1"], settings=SMALL)
        store = Store(tmp_path)
        store.prepare()
        with store.claimed(cell.key), pytest.raises(RunnerError, match="another process is running"):
            run_cell(dataset, cell, store, lambda *_: None)

    @pytest.mark.parametrize("threads", [0, 1])
    def test_a_cell_that_another_process_runs_comes_last(self, data, tmp_path, dataset, monkeypatch, caplog, threads):
        """The others are not kept waiting for it, and it is waited for, in this process as on an executor."""
        monkeypatch.setattr("cusick_bench.runner.executors.turns.WAIT_SECONDS", 0.05)
        (held,) = plan(dataset, solvers=["null:disc"], cloths=["fabric_1"], settings=SMALL)
        store, ended = Store(tmp_path), []
        store.prepare()

        class LetGo(Unwatched):
            def end(self, cell: Cell, status: str, failure: str) -> None:
                ended.append(cell.solver)
                other.close()

        with ExitStack() as other, ThreadPoolExecutor(1) as executor:
            other.enter_context(store.claimed(held.key))
            options = {"executor": executor} if threads else {}
            _, results = run_small(data, tmp_path, ["null:disc", "null:copy"], watcher=LetGo(), **options)
        assert ended == ["null:copy", "null:disc"]
        assert [result["status"] for result in results] == ["done", "done"]
        (said,) = [record.getMessage() for record in caplog.records]
        assert f"another process is running null:disc on fabric_1, seed 0 (cell {held.key})" in said

    def test_a_cell_that_was_finished_before_it_could_be_claimed_is_left_alone(
        self, data, tmp_path, dataset, monkeypatch
    ):
        (cell,), _ = run_small(data, tmp_path, ["null:disc"])
        path, looks, is_done = tmp_path / "cells" / cell.key / "result.json", [], Store.is_done

        def not_at_first(store: Store, key: str) -> bool:
            looks.append(key)
            return len(looks) > 1 and is_done(store, key)

        monkeypatch.setattr(Store, "is_done", not_at_first)
        before = path.stat()
        assert run_cell(dataset, cell, Store(tmp_path), lambda *_: None)["status"] == "done"
        assert (path.stat().st_ino, path.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
        assert len(looks) == 2


def test_messages_that_nobody_reads_do_not_keep_a_worker_from_ending():
    """More of them than a pipe holds, as where a journal is replayed: the command never came to its end."""
    messages = multiprocessing.get_context("spawn").Queue()
    pool = process_pool(1, initializer=_start_worker, initargs=(messages,))
    pool.submit(say_much, 2000).result(timeout=120)
    ending = threading.Thread(target=pool.shutdown, daemon=True)
    ending.start()
    ending.join(30)
    waiting = ending.is_alive()
    for process in multiprocessing.active_children() if waiting else ():  # or this process would not end either
        process.kill()
    assert not waiting


class _Mortal(Executor):
    """A pool that dies of every null:copy cell, and takes along what else it was given.

    Or, with `after`, of every cell, right after that was finished.
    """

    def __init__(self, *, after: bool = False):
        self.broken, self.after = False, after

    def submit(self, function, /, *arguments, **options):
        future: Future = Future()
        if self.after:
            function(*arguments, **options)
        self.broken = self.broken or self.after or arguments[1].solver == "null:copy"
        if self.broken:
            future.set_exception(BrokenProcessPool("planted"))
        else:
            future.set_result(function(*arguments, **options))
        return future


class TestPool:
    def test_workers_give_the_numbers_of_one_process(self, data, tmp_path):
        cells, _ = run_small(data, tmp_path / "one", ["homo", "null:disc"])
        _, results = run_small(data, tmp_path / "two", ["homo", "null:disc"], workers=2)
        assert [result["status"] for result in results] == ["done", "done"]
        for cell in cells:
            one, two = (numbers(tmp_path / name / "cells" / cell.key) for name in ("one", "two"))
            assert two["spent"] == one["spent"]
            assert two["metrics"]["test_mse"] == pytest.approx(one["metrics"]["test_mse"], rel=1e-6)

    @pytest.mark.slow
    def test_workers_do_not_say_again_what_is_odd_about_the_data(self, data, tmp_path, caplog, capfd):
        """Every worker reads the data set, and wrote the reader's warnings between the lines of progress."""
        lab = shutil.copytree(data, tmp_path / "lab")
        shutil.copy(next(lab.glob("data/*/silhouettes/*")), lab / "stray.jpg")
        run_small(lab, tmp_path / "run", ["null:disc", "null:copy"], workers=2)
        assert "stray.jpg" in caplog.text
        assert "stray.jpg" not in capfd.readouterr().err

    def test_dead_worker_costs_its_own_cell_only(self, data, tmp_path, monkeypatch):
        """A broken pool loses every cell under way; the innocent ones are run again."""
        monkeypatch.setattr("cusick_bench.runner.executors.pool.process_pool", lambda workers, **settings: _Mortal())
        _, results = run_small(data, tmp_path, ["null:copy", "null:disc"], workers=2)
        assert [result["status"] for result in results] == ["failed", "done"]
        assert "Worker process died" in results[0]["failure"]

    def test_the_death_of_a_worker_leaves_the_others_their_pool(self, data, tmp_path, monkeypatch):
        """Cells that were not begun go on in a new pool of all workers; those under way share one process."""
        pools: list[int] = []

        def pool(workers: int, **_) -> _Mortal:
            pools.append(workers)
            return _Mortal()

        monkeypatch.setattr("cusick_bench.runner.executors.pool.process_pool", pool)
        monkeypatch.setattr("cusick_bench.runner.executors.pool.SUBMITTED_AHEAD", 1)
        solvers = ["null:copy", "null:disc", "null:rotation", "null:random-phase,draws=2"]
        _, results = run_small(data, tmp_path, solvers, workers=2)
        assert [result["status"] for result in results] == ["failed", "done", "done", "done"]
        assert pools == [2, 1, 1, 2]

    def test_a_cell_that_had_finished_before_its_worker_died_keeps_its_result(self, data, tmp_path):
        """The answer is lost with the worker, but what it has written is not."""
        cells, results = run_small(data, tmp_path, ["null:disc"], executor=_Mortal(after=True))
        assert [result["status"] for result in results] == ["done"]
        assert Store(tmp_path).is_done(cells[0].key)

    def test_a_worker_tells_at_once_what_a_solver_says(self, data, tmp_path, dataset, monkeypatch):
        """It follows a drape within milliseconds, and of drapes a worker tells five times a second at most."""

        def watched(dataset, cell, store, report, simulators):
            for words in ("", "", "inference", "inference", "scoring"):
                report(0.5, 0.1, words)
            return {}

        monkeypatch.setattr("cusick_bench.runner.executors.pool.run_cell", watched)
        (cell,) = plan(dataset, solvers=["null:disc"], cloths=["fabric_1"], settings=SMALL)
        messages: queue.SimpleQueue[tuple[Cell, float, float, str]] = queue.SimpleQueue()
        _Worker(messages).run(Source(str(data)), cell, tmp_path)
        assert [messages.get()[-1] for _ in range(messages.qsize())] == ["", "inference", "scoring"]

    def test_number_of_workers(self, data, tmp_path):
        with pytest.raises(RunnerError, match="workers must be >= 1"):
            run_small(data, tmp_path, ["null:disc"], workers=0)


def test_threads_of_an_executor_run_one_cell_at_a_time(data, tmp_path, monkeypatch):
    """They share simulators and the random numbers of libraries: side by side, cells had other numbers every time."""
    at_once: list[int] = []
    running = 0

    def watched(*arguments):
        nonlocal running
        running += 1
        at_once.append(running)
        time.sleep(0.05)
        running -= 1
        return run_cell(*arguments)

    monkeypatch.setattr("cusick_bench.runner.executors.pool.run_cell", watched)
    with ThreadPoolExecutor(3) as threads:
        _, results = run_small(data, tmp_path, ["null:disc", "null:copy"], seeds=[0, 1], executor=threads)
    assert [result["status"] for result in results] == ["done"] * 4
    assert at_once == [1] * 4
