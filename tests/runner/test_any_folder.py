"""A results folder is read from any working folder, and after it was moved."""

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.leaderboard import load_cells
from cusick_bench.leaderboard.cells.source import data_of

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture
def place(make_lab, tmp_path, monkeypatch) -> Path:
    """A folder with data, a table of densities beside it, and a run of both that was given relative paths."""
    monkeypatch.delenv("CUSICK_DATA", raising=False)
    place = tmp_path / "place"
    shutil.copytree(make_lab((2.0,), samples=2), place / "lab")
    shutil.move(place / "lab" / "fabrics.csv", place / "weights.csv")
    monkeypatch.chdir(place)
    words = ["run", "--data", "lab", "--fabrics-csv", "weights.csv", "--solver", "null:disc", "--vertices", "97"]
    result = CliRunner().invoke(app, [*words, "--out", "runs/one"])
    assert result.exit_code == 0, result.output
    return place


def _read(run: Path, out: Path) -> None:
    """Every command that reads a results folder ends well, without being told where the data are."""
    for words in (
        ["leaderboard", str(run)],
        ["verify", str(run)],
        ["report", str(run), "--out", str(out / "page.html")],
        ["submit", str(run), "--track", "lab", "--out", str(out / "lab.csv")],
        ["check", str(run), "--against", str(out / "baseline.csv"), "--write"],
    ):
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 0, (words, result.output)
        assert "no band of unseen samples" not in result.output, words


def test_from_another_folder_and_after_both_were_moved(place, tmp_path, monkeypatch):
    monkeypatch.setattr("cusick_bench.report.drawing.drape_view.SUPERSAMPLING", 1)
    monkeypatch.setattr("cusick_bench.report.drawing.drape_view.SHADOW_SIZE", 100)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert data_of(load_cells(place / "runs" / "one")) == (str(place / "lab"), str(place / "weights.csv"))
    _read(place / "runs" / "one", elsewhere)
    moved = Path(shutil.move(place, tmp_path / "moved"))
    assert data_of(load_cells(moved / "runs" / "one")) == (str(moved / "lab"), str(moved / "weights.csv"))
    _read(Path("..") / "moved" / "runs" / "one", elsewhere)


def test_only_the_run_was_moved(place, tmp_path):
    moved = Path(shutil.move(place / "runs" / "one", tmp_path / "alone"))
    assert data_of(load_cells(moved)) == (str(place / "lab"), str(place / "weights.csv"))


def test_data_that_are_gone_are_named_where_they_were(place):
    shutil.rmtree(place / "lab")
    result = CliRunner().invoke(app, ["verify", "runs/one"])
    assert result.exit_code == 2
    assert f"{place / 'lab'} is not; give their folder with --data" in " ".join(result.output.split())


@pytest.mark.parametrize("source", [None, [], {"data": 3}, {"data": {"given": "lab"}}, {"data": {}}])
def test_a_record_without_places_is_read_by_its_command(place, source):
    path = Path("runs/one/run.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | {"source": source, "command": ["run", "--data", "lab"]}))
    assert data_of(load_cells("runs/one")) == ("lab", None)
