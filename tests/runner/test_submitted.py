"""Cells through submitit: processes of this machine everywhere, and Slurm where there is one."""

import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets import load
from cusick_bench.datasets.errors import DataError
from cusick_bench.problem import Budget
from cusick_bench.runner import Cell, ProblemSettings, RunnerError, Source, Store, Submitted, Unwatched, plan, run
from cusick_bench.runner.executors.pool import work
from cusick_bench.runner.executors.submitted import GRACE_SECONDS, POLL_SECONDS, Batch
from cusick_bench.sim.engine.settings import DrapeSettings

SETTINGS = ProblemSettings(vertices=97, drape=DrapeSettings(steps=12), budget=Budget(8))

pytestmark = pytest.mark.usefixtures("one_thread")


def _slurm_runs() -> bool:
    if not (shutil.which("sbatch") and shutil.which("sinfo")):
        return False
    return bool(subprocess.run(["sinfo", "--noheader"], capture_output=True, text=True, check=False).stdout)


needs_slurm = pytest.mark.skipif(not _slurm_runs(), reason="no Slurm answers here")


@pytest.fixture(scope="module")
def data(make_lab) -> Path:
    return make_lab((2.0, 4.0), samples=2)


@pytest.fixture
def cells(data) -> list[Cell]:
    return plan(load(data), solvers=["null:disc", "null:copy"], cloths=["fabric_1"], settings=SETTINGS)


class _Told(Unwatched):
    def __init__(self) -> None:
        self.ended: list[tuple[str, str]] = []

    def end(self, cell: Cell, status: str, failure: str) -> None:
        self.ended.append((cell.solver, status))


@pytest.mark.parametrize("cluster", ["local", pytest.param("slurm", marks=needs_slurm)])
def test_cells_that_are_submitted_end_with_the_numbers_of_this_process(data, cells, tmp_path, cluster):
    pytest.importorskip("submitit")
    watcher = _Told()
    here = run(Source(str(data)), cells, tmp_path / "here")
    there = run(Source(str(data)), cells, tmp_path / "there", executor=Submitted(cluster), watcher=watcher)
    assert [result["status"] for result in there] == ["done", "done"]
    for one, two in zip(here, there, strict=True):
        known = {name: value for name, value in one["metrics"].items() if value is not None}
        assert {name: two["metrics"][name] for name in known} == pytest.approx(known, rel=1e-9)
    assert sorted(watcher.ended) == [("null:copy", "done"), ("null:disc", "done")]
    assert any((tmp_path / "there" / "jobs").iterdir())


def test_cells_that_an_earlier_commands_task_finishes_are_not_lost(data, cells, tmp_path):
    """They were found open, and are finished before the task that is submitted for them looks."""
    pytest.importorskip("submitit")
    finished, watcher = run(Source(str(data)), cells, tmp_path), _Told()
    assert Submitted("local").run(Source(str(data)), cells, Store(tmp_path), watcher) == []
    assert sorted(watcher.ended) == [("null:copy", "done"), ("null:disc", "done")]
    assert [result["status"] for result in finished] == ["done", "done"]


@needs_slurm
@pytest.mark.slow
def test_a_task_that_is_killed_costs_its_own_cell_only(data, tmp_path):
    """It is submitted again, alone; where that is killed, too, the record says so."""
    pytest.importorskip("submitit")
    out = tmp_path / "out"
    arguments = ["run", "--data", str(data), "--out", str(out), "--solver", "cmaes", "--solver", "null:disc"]
    arguments += ["--cloth", "fabric_1", "--vertices", "97", "--steps", "12", "--space", "homo", "--budget", "1e6"]
    command = [sys.executable, "-m", "cusick_bench.cli", *arguments, "--executor", "slurm", "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline, killed = time.monotonic() + 600, 0  # two graces are waited for
    while process.poll() is None and time.monotonic() < deadline:
        for worker in _workers(out):
            os.kill(worker, signal.SIGKILL)
            killed += 1
        time.sleep(1)
    said, log = process.communicate(timeout=10)
    assert process.returncode == 1, log
    assert killed >= 2
    assert '"failed"' in said
    assert '"done"' in said
    assert "ended before the cell did" in said


class _Job:
    """A job that has left the queue, and whose files are seen after so many looks at it."""

    job_id = "7"

    def __init__(self, batch: Batch, looks: float) -> None:
        self._batch, self._looks = batch, looks

    def done(self) -> bool:
        self._looks -= 1
        if self._looks == 0:
            run(self._batch.source, self._batch.cells, self._batch.out)
        return True


def _submitit_of(looks: float, submitted: list[Batch]) -> SimpleNamespace:
    """A library that runs nothing; what its tasks have written is seen late."""

    def submit_array(batches: list[Batch]) -> list[_Job]:
        submitted.extend(batches)
        return [_Job(batch, looks) for batch in batches]

    executor = SimpleNamespace(update_parameters=lambda **_: None, submit_array=submit_array)
    return SimpleNamespace(LocalExecutor=lambda *_, **__: executor)


def test_what_a_job_asks_for_is_asked_of_slurm(data, cells, tmp_path, monkeypatch):
    asked: dict[str, Any] = {}

    def submit_array(batches: list[Batch]) -> None:
        asked["cells"] = [batch.cells for batch in batches]
        asked["threads"] = os.environ["OMP_NUM_THREADS"]
        raise RuntimeError("is enough")

    executor = SimpleNamespace(update_parameters=asked.update, submit_array=submit_array)
    submitit = SimpleNamespace(SlurmExecutor=lambda folder, max_num_timeout: executor)
    monkeypatch.setitem(sys.modules, "submitit", submitit)
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    Store(tmp_path).prepare()
    job = {"mem": "8GB", "time": "30", "cpus_per_task": "2"}
    with pytest.raises(RunnerError, match="slurm does not take the job: is enough"):
        Submitted("slurm", 3, job).run(Source(str(data)), cells, Store(tmp_path), Unwatched())
    assert asked == {
        "job_name": "cusick-bench", "array_parallelism": 3, "mem": "8GB", "time": 30, "cpus_per_task": 2,
        "cells": [(cell,) for cell in cells], "threads": "2",
    }  # fmt: skip


def test_files_that_a_network_file_system_shows_late_are_waited_for(data, cells, tmp_path, monkeypatch):
    submitted: list[Batch] = []
    monkeypatch.setitem(sys.modules, "submitit", _submitit_of(12, submitted))
    monkeypatch.setitem(POLL_SECONDS, "local", 0.01)
    monkeypatch.setitem(GRACE_SECONDS, "local", 600.0)
    Store(tmp_path).prepare()
    assert Submitted("local").run(Source(str(data)), cells, Store(tmp_path), Unwatched()) == []
    assert len(submitted) == 1  # not once more


def test_a_task_that_stays_away_is_lost_after_the_grace_period(data, cells, tmp_path, monkeypatch):
    submitted: list[Batch] = []
    monkeypatch.setitem(sys.modules, "submitit", _submitit_of(float("inf"), submitted))
    monkeypatch.setitem(POLL_SECONDS, "local", 0.01)
    monkeypatch.setitem(GRACE_SECONDS, "local", 0.02)
    Store(tmp_path).prepare()
    assert Submitted("local").run(Source(str(data)), cells, Store(tmp_path), Unwatched()) == cells
    assert [len(batch.cells) for batch in submitted] == [2, 1, 1]


def test_data_that_change_under_a_job_are_named_and_no_cell_has_failed(make_lab, tmp_path, monkeypatch):
    data = make_lab((2.0,), samples=2)
    cells, submitted = plan(load(data), solvers=["null:disc", "null:copy"], settings=SETTINGS), list[Batch]()
    monkeypatch.setitem(sys.modules, "submitit", _submitit_of(float("inf"), submitted))
    monkeypatch.setitem(POLL_SECONDS, "local", 0.01)
    monkeypatch.setitem(GRACE_SECONDS, "local", 0.02)

    def queued(*_) -> set[str]:
        (data / "fabrics.csv").write_text("fabric,areal_density_kg_m2,thickness_m\nfabric_1,0.3,0.0004\n")
        return set()

    monkeypatch.setattr(Submitted, "_queued", queued)
    with pytest.raises(DataError, match=r"not those that the cells were planned for.*repeat the command"):
        run(Source(str(data)), cells, tmp_path, executor=Submitted("local"))
    assert len(submitted) == 1  # not once more
    assert not list(tmp_path.glob("cells/*/result.json"))


def _workers(out: Path) -> list[int]:
    """Processes that run a cell of the solver that never ends."""
    found = []
    for trace in out.glob("cells/*/trace.jsonl"):
        for process in Path("/proc").glob("[0-9]*"):
            try:
                held = {os.readlink(link) for link in (process / "fd").iterdir()}
            except OSError:
                continue
            if str(trace.resolve()) in held and trace.stat().st_size:
                found.append(int(process.name))
    return found


def test_what_is_put_into_the_queue_again_is_the_same_batch(data, cells, tmp_path):
    pytest.importorskip("submitit")
    batch = Batch(Source(str(data)), tuple(cells), tmp_path)
    again = batch.checkpoint()
    assert again.function == batch
    assert not again.args
    assert not again.kwargs


def test_a_task_that_may_not_be_queued_again_stops_and_no_cell_has_failed(data, cells, tmp_path, monkeypatch):
    """submitit tells of it by an ordinary error, out of the handler of a signal that comes while a cell runs."""
    core = pytest.importorskip("submitit.core.utils")

    def give_up(*_) -> None:
        raise core.UncompletedJobError("Job not requeued because: timed-out too many times.")

    def score(*_, **__) -> None:
        try:
            os.kill(os.getpid(), signal.SIGUSR2)
            time.sleep(60)
        except RuntimeError:  # as solvers catch, for whom that is a matrix without factors
            pytest.fail("the request to stop looks like an error of the solver")

    before = signal.signal(signal.SIGUSR2, give_up)
    monkeypatch.setattr("cusick_bench.runner.cell.score", score)
    try:
        with pytest.raises(core.UncompletedJobError, match="too many times"):
            Batch(Source(str(data)), tuple(cells), tmp_path)()
        assert signal.getsignal(signal.SIGUSR2) is give_up
    finally:
        signal.signal(signal.SIGUSR2, before)
    assert (tmp_path / "cells" / cells[0].key / "cell.json").exists()
    assert not list(tmp_path.glob("cells/*/result.json"))
    assert not (tmp_path / "cells" / cells[1].key).exists()


def test_a_task_that_is_queued_again_stops_and_no_cell_has_failed(data, cells, tmp_path, monkeypatch):
    """submitit ends it by `sys.exit`, out of the handler of a signal that comes while a cell runs."""
    task = pytest.importorskip("submitit.core.job_environment")
    batch, queued = Batch(Source(str(data)), tuple(cells), tmp_path), list[int]()
    delayed = task.DelayedSubmission(batch)
    delayed.set_timeout(60, 20)
    place = SimpleNamespace(submitted_pickle=tmp_path / "task.pkl")
    handler = task.SignalHandler(SimpleNamespace(global_rank=0, _requeue=queued.append), place, delayed)

    def score(*_, **__) -> None:
        os.kill(os.getpid(), signal.SIGUSR2)
        time.sleep(60)

    before = signal.signal(signal.SIGUSR2, handler.checkpoint_and_try_requeue)
    monkeypatch.setattr("cusick_bench.runner.cell.score", score)
    try:
        with pytest.raises(SystemExit) as ended:
            batch()
    finally:
        signal.signal(signal.SIGUSR2, before)
    assert (ended.type, queued) == (SystemExit, [20])
    assert (tmp_path / "cells" / cells[0].key / "cell.json").exists()
    assert not list(tmp_path.glob("cells/*/result.json"))
    assert not (tmp_path / "cells" / cells[1].key).exists()


def test_a_cell_that_an_earlier_commands_task_runs_comes_last(data, cells, tmp_path, monkeypatch):
    pytest.importorskip("submitit")
    monkeypatch.setattr("cusick_bench.runner.executors.turns.WAIT_SECONDS", 0.05)
    store, order = Store(tmp_path), []
    store.prepare()
    with ExitStack() as other:
        other.enter_context(store.claimed(cells[0].key))

        def watched(source: Source, cell: Cell, out: Path) -> dict[str, Any]:
            result = work(source, cell, out)
            order.append(cell)
            other.close()
            return result

        monkeypatch.setattr("cusick_bench.runner.executors.submitted.work", watched)
        Batch(Source(str(data)), tuple(cells), tmp_path)()
    assert order == [cells[1], cells[0]]


def test_one_error_keeps_no_other_cell_from_being_run(data, cells, tmp_path):
    pytest.importorskip("submitit")
    (tmp_path / "cells" / cells[0].key / "cell.json.part").mkdir(parents=True)  # cannot be removed as a file
    with pytest.raises(RunnerError, match=cells[0].solver):
        Batch(Source(str(data)), tuple(cells), tmp_path)()
    assert [(tmp_path / "cells" / cell.key / "done").exists() for cell in cells] == [False, True]


@pytest.mark.parametrize(
    ("arguments", "rule"),
    [
        (["--executor", "lsf"], "use one of process, slurm, local"),
        (["--executor", "local", "--job", "time"], "--job takes NAME=VALUE"),
        (["--executor", "local", "--job", "time=2:00:00"], "--job time must be a whole number of minutes"),
        (["--executor", "slurm", "--job", "cpus_per_task=two"], "--job cpus_per_task must be a whole number"),
        (["--executor", "slurm", "--job", "time=3"], "--job time must be >= 4 minutes, got 3"),
        (["--executor", "slurm", "--job", "time=2", "--job", "signal_delay_s=20"], "time must be >= 3 minutes, got 2"),
        (["--executor", "slurm", "--job", "signal_delay_s=soon"], "--job signal_delay_s must be a whole number"),
        (["--executor", "local", "--job", "partition=a"], "knows --job time=MINUTES only"),
        (["--job", "time=3"], "--job is for --executor slurm or local"),
    ],
)
def test_wrong_options_are_refused(data, tmp_path, arguments, rule):
    pytest.importorskip("submitit")
    words = ["run", "--data", str(data), "--cloth", "fabric_1", "--solver", "null:disc", "--out", str(tmp_path)]
    found = CliRunner().invoke(app, [*words, "--vertices", "97", *arguments])
    assert found.exit_code == 2
    assert rule in " ".join(found.stderr.split())


def test_a_missing_library_names_the_extra(data, cells, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "submitit", None)
    with pytest.raises(RunnerError, match=r"cusick-bench\[slurm\]"):
        run(Source(str(data)), cells, tmp_path, executor=Submitted("local"))
