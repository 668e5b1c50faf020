"""A disk that fills up, a clock that jumps, a folder that two runners share: nothing torn, and the same numbers."""

import errno
import json
import logging
import os
import platform
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from cusick_bench.datasets import load
from cusick_bench.files.plain_names import part_of
from cusick_bench.problem import Budget
from cusick_bench.runner import Cell, ProblemSettings, Source, Store, plan, run, run_cell
from cusick_bench.runner.store import disk_errors, ends_grid, write_atomically
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.solvers.registry import solver_class

SOLVERS = ("null:disc", "null:copy", "nlopt:LN_BOBYQA")
SMALL = ProblemSettings(vertices=97, drape=DrapeSettings(steps=5), budget=Budget(8))

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")


@pytest.fixture(scope="module")
def data(make_lab) -> Path:
    return make_lab((2.0,), samples=2)


@pytest.fixture(scope="module")
def cells(data) -> list[Cell]:
    return plan(load(data), solvers=list(SOLVERS), settings=SMALL)


@pytest.fixture(scope="module")
def undisturbed(data, cells, tmp_path_factory) -> dict[str, dict]:
    out = tmp_path_factory.mktemp("undisturbed")
    run(Source(str(data)), cells, out)
    return _numbers(out)


def _numbers(out: Path) -> dict[str, dict]:
    """Results and answers of the finished cells, all but times."""
    found = {}
    for marker in sorted(out.glob("cells/*/done")):
        result = json.loads((marker.parent / "result.json").read_text())
        kept = {name: value for name, value in result.items() if name not in ("spent", "code")}
        found[marker.parent.name] = {"result": kept, "answer": (marker.parent / "prediction.npz").read_bytes()}
    return found


LIMITED = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # the write fails instead of the process
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)),) * 2)
from cusick_bench.cli import main
main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no such limit")
def test_files_that_cannot_grow_end_the_grid_with_one_line_and_it_resumes(data, cells, undisturbed, tmp_path):
    words = ["run", "--data", str(data), "--out", str(tmp_path / "out"), "--vertices", "97", "--steps", "5"]
    words += ["--budget", "8", "--law", "paper", *(word for solver in SOLVERS for word in ("--solver", solver))]
    command = [sys.executable, "-c", LIMITED, "4000", *words]
    environment = os.environ | {"NUMBA_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 2, done.stderr
    assert "File too large" in done.stderr
    assert "finished cells are kept" in done.stderr
    assert "Traceback" not in done.stderr
    run(Source(str(data)), cells, tmp_path / "out")
    assert _numbers(tmp_path / "out") == undisturbed


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may mount a small disk")
@pytest.mark.slow
def test_a_disk_of_a_few_kilobytes_fills_up_and_is_gone_on_from(data, cells, undisturbed, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=40k", "tmpfs", str(disk)], check=False).returncode:
        pytest.skip("no small disk can be mounted here")
    try:
        with pytest.raises(Exception, match=r"No space left.*finished cells are kept"):
            run(Source(str(data)), cells, disk / "out")
        subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True)
        run(Source(str(data)), cells, disk / "out")
        assert _numbers(disk / "out") == undisturbed
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_clock_that_goes_back_changes_neither_order_nor_numbers(data, cells, undisturbed, tmp_path, monkeypatch):
    begin, calls = time.time(), iter(range(1, 10**9))
    monkeypatch.setattr(time, "time", lambda: begin - 3600.0 * next(calls))  # an hour back at every look
    for _ in range(2):
        for number in range(1, len(cells) + 1):
            run(Source(str(data)), cells[:number], tmp_path / "out", command=[str(number)])
    assert _numbers(tmp_path / "out") == undisturbed
    last = json.loads((tmp_path / "out" / "run.json").read_text())
    told = [int(made["command"][0]) for made in [*last["history"], last]]
    assert told == 2 * [*range(1, len(cells) + 1)]


def test_files_from_the_future_are_as_good_as_others(data, cells, undisturbed, tmp_path, caplog):
    run(Source(str(data)), cells, tmp_path / "out")
    for path in (tmp_path / "out").rglob("*"):
        os.utime(path, (4e9, 4e9))
    with caplog.at_level(logging.WARNING):
        run(Source(str(data)), cells, tmp_path / "out")
    assert not caplog.records
    assert _numbers(tmp_path / "out") == undisturbed


@pytest.mark.skipif(sys.platform == "win32", reason="no locks there")
@pytest.mark.parametrize("code", [errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP], ids=errno.errorcode.get)
def test_a_file_system_without_locks_is_written_to_without(data, cells, undisturbed, tmp_path, monkeypatch, code):
    def flock(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr("fcntl.flock", flock)
    run(Source(str(data)), cells, tmp_path / "out")
    assert _numbers(tmp_path / "out") == undisturbed


@pytest.mark.skipif(sys.platform == "win32", reason="no locks there")
@pytest.mark.parametrize("code", [errno.ENOLCK, 0], ids=["no locks", "locks of each machine"])
def test_machines_that_do_not_see_each_others_locks_both_finish_a_cell(
    data, cells, undisturbed, tmp_path, monkeypatch, code
):
    """The second machine begins with the cell, and ends, while the first one writes its answer."""

    def flock(*_: object) -> None:
        if code:
            raise OSError(code, os.strerror(code))

    dataset, store, savez, ended = load(data), Store(tmp_path), np.savez_compressed, list[str]()

    def slow(file, **arrays) -> None:
        if not ended:
            with monkeypatch.context() as other:
                other.setattr(platform, "node", lambda: "other.machine")
                ended.append("begun")
                ended[0] = run_cell(dataset, cells[0], store, lambda *_: None)["status"]
        savez(file, **arrays)

    monkeypatch.setattr("fcntl.flock", flock)
    monkeypatch.setattr(np, "savez_compressed", slow)
    store.prepare()
    assert run_cell(dataset, cells[0], store, lambda *_: None)["status"] == "done"
    assert ended == ["done"]
    assert _numbers(tmp_path) == {cells[0].key: undisturbed[cells[0].key]}
    assert store.is_done(cells[0].key)
    assert not list(tmp_path.glob("cells/*/*.part"))


def test_two_runners_on_one_folder_finish_the_grid_once(data, undisturbed, tmp_path):
    """Each in a process of its own, as two machines are; whoever comes second to a cell comes back to it."""
    words = ["run", "--data", str(data), "--out", str(tmp_path / "out"), "--vertices", "97", "--steps", "5"]
    words += ["--budget", "8", "--law", "paper", *(word for solver in SOLVERS for word in ("--solver", solver))]
    environment = os.environ | {"NUMBA_NUM_THREADS": "1"}
    with ThreadPoolExecutor(2) as machines:
        ended = list(
            machines.map(
                lambda _: subprocess.run(
                    [sys.executable, "-m", "cusick_bench.cli", *words],
                    capture_output=True, text=True, env=environment, check=False,
                ),
                range(2),
            )
        )  # fmt: skip
    for one in ended:
        assert one.returncode == 0, one.stderr
        assert "Traceback" not in one.stderr
    assert _numbers(tmp_path / "out") == undisturbed


def test_an_interruption_leaves_the_file_of_before_and_nothing_half_written(tmp_path, monkeypatch):
    path = tmp_path / "table.csv"
    write_atomically(path, b"before")

    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(path, b"after")
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(sys.platform == "win32", reason="no locks there")
def test_without_locks_nothing_that_another_process_may_be_writing_is_removed(tmp_path, monkeypatch):
    def flock(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", flock)
    part = part_of(tmp_path / "cells" / "key" / "result.json")
    part.parent.mkdir(parents=True)
    part.write_bytes(b"half")
    with Store(tmp_path).claimed("key"):
        assert part.exists()
    monkeypatch.undo()
    with Store(tmp_path).claimed("key"):
        assert not part.exists()


def test_a_file_that_may_not_grow_is_the_disks_fault(tmp_path):
    with pytest.raises(Exception, match="finished cells are kept"), disk_errors(tmp_path):
        raise OSError(errno.EFBIG, "File too large")


def test_a_file_of_the_solvers_own_is_no_fault_of_the_disk(tmp_path):
    elsewhere, here = "/opt/vendor/licence.key", str(tmp_path / "trace.jsonl")
    assert not ends_grid(PermissionError(errno.EACCES, "Permission denied", elsewhere), tmp_path)
    assert not ends_grid(FileNotFoundError(errno.ENOENT, "No such file", here), tmp_path)
    assert ends_grid(PermissionError(errno.EACCES, "Permission denied", here), tmp_path)
    assert ends_grid(OSError(errno.EACCES, "Permission denied", elsewhere, None, here), tmp_path), "moved to there"
    assert ends_grid(OSError(errno.EIO, "Input/output error"), tmp_path)
    assert ends_grid(OSError(errno.ENOSPC, "No space left on device", elsewhere), tmp_path)


def test_a_solver_that_may_not_read_its_file_fails_alone(tmp_path, toy_data, monkeypatch):
    def solve(*_: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", "/opt/vendor/licence.key")

    monkeypatch.setattr(solver_class("null:disc"), "solve", solve)
    cells = plan(load(toy_data), solvers=["null:disc", "null:copy"])
    failed, done = run(Source(str(toy_data)), cells[:2], tmp_path / "out")
    assert (failed["status"], done["status"]) == ("failed", "done")
    assert "licence.key" in failed["failure"]
