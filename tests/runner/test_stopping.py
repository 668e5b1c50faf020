"""Real processes: workers end with the process that started them, and a run that is told to stop says how to go on."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cusick_bench.cli.common import TERMINATED

SECONDS = 120  # at most, for a start on busy cores
ENDING = 20  # at most, for an end
PROCESSES = Path("/proc")

pytestmark = pytest.mark.skipif(not (PROCESSES / "self" / "stat").exists(), reason="looks for processes in /proc")


@pytest.fixture(scope="module")
def data(make_lab) -> Path:
    return make_lab((2.0, 4.0), samples=2)


def _descendants(parent: int) -> list[int]:
    """Processes that a process has started, and that run."""
    found = []
    for folder in PROCESSES.iterdir():
        if folder.name.isdigit() and (state := _state(int(folder.name))) is not None and state[1] == parent:
            found.append(int(folder.name))
    return found


def _state(process: int) -> tuple[str, int] | None:
    """State and parent of a process; None where there is none, or it has ended and waits to be buried."""
    try:
        words = (PROCESSES / str(process) / "stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return None
    return None if words[0] in "ZX" else (words[0], int(words[1]))


def _command(data: Path, out: Path, workers: int, budget: str) -> list[str]:
    words = ["run", "--data", str(data), "--out", str(out), "--solver", "cmaes", "--vertices", "97", "--steps", "12"]
    words += ["--space", "homo", "--workers", str(workers), "--budget", budget]
    return [sys.executable, "-m", "cusick_bench.cli", *words]


def _started(data: Path, out: Path, workers: int) -> subprocess.Popen[str]:
    """A run whose cells are all under way, each with some evaluations behind it."""
    environment = os.environ | {"NUMBA_NUM_THREADS": "1"}
    process = subprocess.Popen(
        _command(data, out, workers, "1e6"), stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True
    )
    deadline = time.monotonic() + SECONDS
    while time.monotonic() < deadline:
        traces = list(out.glob("cells/*/trace.jsonl"))
        if len(traces) == workers and all(trace.read_bytes().count(b"\n") >= 2 for trace in traces):
            return process
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.05)
    process.kill()
    raise AssertionError(f"no cell was under way after {SECONDS} s")


def _all_ended(processes: list[int]) -> bool:
    deadline = time.monotonic() + ENDING
    while time.monotonic() < deadline and any(map(_state, processes)):
        time.sleep(0.1)
    return not any(map(_state, processes))


@pytest.mark.slow
def test_a_run_that_is_told_to_stop_ends_its_workers_and_says_how_to_go_on(data, tmp_path):
    out = tmp_path / "out"
    process = _started(data, out, workers=2)
    children = _descendants(process.pid)
    assert len(children) >= 2
    process.terminate()
    _, said = process.communicate(timeout=ENDING)
    assert process.returncode == TERMINATED, said
    assert f"terminated: 0 of 2 cells are finished and kept in {out}" in said
    assert "go on with: cusick-bench run" in said
    assert "Traceback" not in said
    assert _all_ended(children)
    assert not list(out.glob("cells/*/done"))


def test_workers_of_a_killed_run_end_too(data, tmp_path):
    process = _started(data, tmp_path, workers=2)
    children = _descendants(process.pid)
    assert len(children) >= 2
    process.kill()
    process.communicate(timeout=ENDING)
    assert _all_ended(children)


def test_a_run_in_one_process_stops_on_sigterm_too(data, tmp_path):
    process = _started(data, tmp_path, workers=1)
    process.terminate()
    _, said = process.communicate(timeout=ENDING)
    assert process.returncode == TERMINATED, said
    assert "go on with: cusick-bench run" in said
