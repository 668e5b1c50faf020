"""Ctrl-C, as a terminal sends it to all processes of a command: no traceback, status 130, and how to go on."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.cli.common import INTERRUPTED, TERMINATED, interruptible

START = 300  # [s] that a command may take until it works: a fresh checkout compiles its kernels first
STOP = 120  # [s] that it may take to end on a machine that has other work


def interrupted(words: list[str], ready: Callable[[], bool]) -> subprocess.CompletedProcess[str]:
    """Runs a command until it is ready to be interrupted, and interrupts it and its workers."""
    process = subprocess.Popen(
        [sys.executable, "-m", "cusick_bench", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=_heeds_interrupts,
    )  # fmt: skip
    until = time.monotonic() + START
    while not ready() and process.poll() is None and time.monotonic() < until:
        time.sleep(0.05)
    assert process.poll() is None, process.communicate()
    os.killpg(process.pid, signal.SIGINT)
    try:
        output, errors = process.communicate(timeout=STOP)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert _ends(process.pid), "a worker is left"
    return subprocess.CompletedProcess(words, process.returncode, output, errors)


def _heeds_interrupts() -> None:
    """As a command in a terminal does, even where the tests themselves run in the background, which ignores them."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _ends(group: int) -> bool:
    """Whether the last process of a group goes within some seconds."""
    until = time.monotonic() + STOP
    while time.monotonic() < until:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_run_says_what_is_kept_and_how_to_go_on(make_lab, tmp_path, workers):
    data = make_lab([1e-5, 4e-5], samples=2)
    words = ["run", "--data", str(data), "--out", str(tmp_path / "a run"), "--solver", "sobol", "--vertices", "97"]
    words += ["--budget", "1000000", "--workers", str(workers), "--json"]
    found = interrupted(words, lambda: any(tmp_path.glob("a run/cells/*/trace.jsonl")))
    assert found.returncode == INTERRUPTED
    assert found.stdout == ""  # no half of a document
    assert "Traceback" not in found.stderr
    assert f"interrupted: 0 of 2 cells are finished and kept in {tmp_path}/a run" in found.stderr
    typed = " ".join(words).replace(f"{tmp_path}/a run", f"'{tmp_path}/a run'")  # as a shell reads it
    assert f"go on with: cusick-bench {typed}\n" in found.stderr


def test_drapes_that_are_written_are_counted(tmp_path):
    out = tmp_path / "drapes"
    words = [
        "simulate",
        "--density",
        "0.2",
        "--bending",
        "1e-5",
        "--vertices",
        "97",
        "--steps",
        "2",
        "--draws",
        "3000",
    ]
    words += ["--with-effect", "off-centre", "--out", str(out)]  # with effects one by one
    found = interrupted(words, lambda: any(out.glob("*.csv")))
    assert found.returncode == INTERRUPTED
    assert "Traceback" not in found.stderr
    assert f"interrupted: {len(list(out.glob('*_profile.csv')))} drapes are written to {out}" in found.stderr
    assert "go on with" not in found.stderr


def test_other_commands_say_that_nothing_was_written(monkeypatch):
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("cusick_bench.datasets.files.layout.scan", stop)
    found = CliRunner().invoke(app, ["datasets", "--json"])
    assert (found.exit_code, found.stdout) == (INTERRUPTED, "")
    assert found.stderr.strip() == "interrupted: nothing was written"


def test_a_stop_that_a_compiled_kernel_has_wrapped_is_a_stop(capsys, monkeypatch):
    def kernel(*_: object) -> None:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as stop:
            raise SystemError("returned a result with an exception set") from stop

    with pytest.raises(typer.Exit) as stopped, interruptible("one file"):
        kernel()
    assert stopped.value.exit_code == INTERRUPTED
    assert "interrupted: one file" in capsys.readouterr().err
    monkeypatch.setattr("cusick_bench.datasets.files.layout.scan", kernel)
    found = CliRunner().invoke(app, ["datasets", "--json"])
    assert (found.exit_code, found.stderr.strip()) == (INTERRUPTED, "interrupted: nothing was written")


def test_statuses_of_stops_are_those_of_shells_and_of_the_page():
    page = (Path(__file__).parents[2] / "docs" / "command-line.md").read_text(encoding="utf-8")
    (told,) = re.findall(r"^\| (\d+), (\d+) \| interrupted by Ctrl-C, terminated by SIGTERM \|$", page, re.M)
    assert tuple(map(int, told)) == (128 + signal.SIGINT, 128 + signal.SIGTERM) == (INTERRUPTED, TERMINATED)


def test_a_fault_of_a_compiled_kernel_is_no_stop():
    with pytest.raises(SystemError), interruptible("one file"):
        raise SystemError("bad argument to internal function")


def test_what_is_kept_may_be_known_late(capsys):
    kept: list[Path] = []

    def work() -> None:
        with interruptible(lambda: f"{len(kept)} files"):
            kept.append(Path("a"))
            raise KeyboardInterrupt

    with pytest.raises(typer.Exit) as stop:
        work()
    assert stop.value.exit_code == INTERRUPTED
    assert "interrupted: 1 files" in capsys.readouterr().err


def test_a_run_that_is_stopped_after_its_last_cell_says_that_it_is_kept(make_lab, tmp_path, monkeypatch):
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("cusick_bench.leaderboard.stiffness_csv", stop)
    words = ["run", "--data", str(make_lab([1e-5], samples=2)), "--out", str(tmp_path), "--solver", "null:disc"]
    found = CliRunner().invoke(app, [*words, "--vertices", "97"])
    assert found.exit_code == INTERRUPTED
    assert f"interrupted: 1 of 1 cells are finished and kept in {tmp_path}" in found.stderr
