"""A folder that appears whole or not at all: beside what was there, after an error, after a crash."""

import subprocess
import sys
from pathlib import Path

import pytest

from cusick_bench.files.errors import FolderInUse
from cusick_bench.photographs.preparation.whole_folder import free, whole_folder

NAMES = ("data", "table")
CRASH = """
import os, sys
from pathlib import Path
from cusick_bench.photographs.preparation.whole_folder import whole_folder

moves = []

def replace(source, target, plain=os.replace):
    moves.append(target)
    os._exit(9) if len(moves) == int(sys.argv[2]) else plain(source, target)

os.replace = replace
with whole_folder(Path(sys.argv[1]), ("data", "table")) as part:
    (part / "data").mkdir()
    (part / "data" / "one").write_text("1")
    (part / "table").write_text("2")
"""


def _write(out: Path, *, fail: bool = False) -> None:
    with whole_folder(out, NAMES) as part:
        (part / "data").mkdir()
        (part / "data" / "one").write_text("1")
        if fail:
            raise KeyboardInterrupt
        (part / "table").write_text("2")


def _paths(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


@pytest.fixture(params=["new", "there"])
def out(request, tmp_path: Path) -> Path:
    """A folder that does not exist, or one that holds a file of the user's."""
    found = tmp_path / "out"
    if request.param == "there":
        found.mkdir()
        (found / "weights.csv").write_text("mine")
    return found


def test_files_are_there_when_all_are_written(out):
    before = _paths(out)
    _write(out)
    assert _paths(out) == sorted([*before, "data", "data/one", "table"])
    assert _paths(out.parent) == sorted(["out", *(f"out/{path}" for path in _paths(out))])


def test_an_error_leaves_nothing(out):
    before = _paths(out.parent)
    with pytest.raises(KeyboardInterrupt):
        _write(out, fail=True)
    assert _paths(out.parent) == before


@pytest.mark.skipif(sys.platform == "win32", reason="no locks there")
def test_a_second_process_is_refused_and_takes_nothing_away(out):
    """It would remove what the first one has written so far, and the folder would appear without it."""
    before = _paths(out)
    with whole_folder(out, NAMES) as part:
        (part / "data").mkdir()
        (part / "data" / "one").write_text("1")
        with pytest.raises(FolderInUse, match="another process is writing into"):
            _write(out)
        (part / "table").write_text("2")
    assert _paths(out) == sorted([*before, "data", "data/one", "table"])


@pytest.mark.parametrize("move", [1, 2])
def test_a_crash_is_in_nobodys_way_and_takes_nothing_away(out, move):
    """The process ends at the first or at the second file that is moved to its place."""
    before = _paths(out)
    crashed = subprocess.run([sys.executable, "-c", CRASH, str(out), str(move)], check=False)
    assert crashed.returncode == (9 if before or move == 1 else 0)  # a new folder takes a single move
    if crashed.returncode:
        assert free(out, NAMES, allowed=("weights.csv",))
        _write(out)
    assert _paths(out.parent) == sorted(["out", *(f"out/{path}" for path in [*before, "data", "data/one", "table"])])


def test_what_somebody_else_has_written_is_in_the_way(tmp_path):
    assert free(tmp_path / "new", NAMES)
    assert free(tmp_path, NAMES)
    (tmp_path / "weights.csv").touch()
    assert free(tmp_path, NAMES, allowed=("weights.csv",))
    assert not free(tmp_path, NAMES)
    assert not free(tmp_path / "weights.csv", NAMES)
    (tmp_path / "data").mkdir()  # of a data set that is finished
    assert not free(tmp_path, NAMES, allowed=("weights.csv",))


@pytest.mark.parametrize("name", [".DS_Store", ".~lock.weights.csv#"])
def test_what_file_managers_and_spreadsheets_hide_is_in_nobodys_way(tmp_path, name):
    (tmp_path / name).touch()
    assert free(tmp_path, NAMES)
    _write(tmp_path)
    assert (tmp_path / name).exists()
