"""No command writes into the installed package."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

import cusick_bench
from cusick_bench.cli import app
from cusick_bench.diagnosis.options import SHIPPED

PACKAGE = Path(cusick_bench.__file__).parent


@pytest.mark.parametrize(
    "words",
    [
        ["atlas", "fit", "FOLDER", "--out", str(SHIPPED)],
        ["atlas", "calibrate", "CASES", "LABELS", "--atlas", str(SHIPPED)],
        ["atlas", "build", "--out", str(PACKAGE / "points")],
        ["run", "--solver", "null:disc", "--out", str(PACKAGE / "runs")],
        ["simulate", "--out", str(PACKAGE / "diagnosis" / ".." / "drapes")],
        ["leaderboard", "RUN", "--out", "board.csv", "--out", str(PACKAGE / "board.csv")],
        ["report", "RUN", "--out", str(PACKAGE / "page.html")],
        ["submit", "RUN", "--track", "lab", "--out", str(PACKAGE / "lab.csv")],
        ["data", "synthetic", "--out", str(PACKAGE / "set")],
        ["diagnose", "synthetic", "--out", str(PACKAGE / "diagnosis")],
        ["withheld", "generate", "--out", str(PACKAGE / "cases"), "--labels", "LABELS"],
    ],
    ids=lambda words: " ".join(words[:2]),
)
def test_a_path_in_the_package_is_refused(words):
    before = sorted(PACKAGE.rglob("*.npz")), SHIPPED.read_bytes()
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2, result.output
    assert "lies in the installed package" in " ".join(result.output.replace("│", " ").split())
    assert (sorted(PACKAGE.rglob("*.npz")), SHIPPED.read_bytes()) == before


@pytest.mark.parametrize("words", [["atlas", "fit", "FOLDER"], ["atlas", "calibrate", "CASES", "LABELS"]])
def test_an_atlas_is_written_only_where_one_says(words):
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2
    assert "Missing option" in result.output


def test_a_baseline_is_not_written_into_the_package(tmp_path):
    run = tmp_path / "run.csv"
    run.write_text("solver,cloth,seed,train_mse\nhomo,a,0,0.01\n")
    result = CliRunner().invoke(app, ["check", str(run), "--against", str(PACKAGE / "new.csv"), "--write"])
    assert result.exit_code == 2
    assert not (PACKAGE / "new.csv").exists()


def test_links_that_go_round_in_circles_end_in_a_message(tmp_path):
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    words = ["export", "benchopt", str(tmp_path / "loop" / "bench"), "--solver", "null:disc"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2, result.exception
    assert "choose another folder" in result.stderr


def test_a_name_that_begins_with_a_tilde_is_a_name(tmp_path, monkeypatch):
    """Shells put a home in its place where there is one; of a user that is unknown it had ended in a traceback."""
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["export", "benchopt", "~no-such-user/bench", "--solver", "null:disc"])
    assert result.exit_code == 0, result.exception
    assert (tmp_path / "~no-such-user" / "bench" / "objective.py").is_file()


def test_a_link_into_the_package_is_followed(tmp_path):
    (tmp_path / "link").symlink_to(PACKAGE / "diagnosis")
    result = CliRunner().invoke(app, ["atlas", "build", "--out", str(tmp_path / "link" / "points")])
    assert result.exit_code == 2
    assert not (PACKAGE / "diagnosis" / "points").exists()
