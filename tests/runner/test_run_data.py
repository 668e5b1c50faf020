"""Whoever reads a results folder finds the run's data, or is told how to name them."""

import json
import shutil
from pathlib import Path

import pytest
from finished_cell import CLOTHS, held_out_images, write_cell
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.leaderboard import LeaderboardError, load_cells
from cusick_bench.leaderboard.cells.source import data_of, load_data_of

TABLE = "fabric,areal_density_kg_m2,thickness_m\nfabric_1,0.35,0.0004\n"


@pytest.fixture(autouse=True)
def _no_release(monkeypatch):
    monkeypatch.delenv("CUSICK_DATA", raising=False)


@pytest.fixture
def run(toy_dataset, tmp_path) -> Path:
    """A finished run whose record does not say where its data were."""
    folder = tmp_path / "run"
    for cloth in CLOTHS:
        write_cell(folder, toy_dataset, "null:copy", cloth, held_out_images(toy_dataset, cloth)[:1])
    return folder


def recorded(run: Path, *words: str) -> Path:
    (run / "run.json").write_text(json.dumps({"command": ["cusick-bench", "run", *words]}))
    return run


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["--data=/lab", "--fabrics-csv", "weights.csv"], ("/lab", "weights.csv")),
        (["--data", "/lab"], ("/lab", None)),
        (["--solver", "homo"], (None, None)),
    ],
)
def test_the_record_says_what_the_run_was_given(run, toy_dataset, words, found):
    data, table = found
    assert data_of(load_cells(recorded(run, *words))) == (data or toy_dataset.name, table)


def test_the_runs_own_data_come_first(run, toy_data, toy_dataset, tmp_path, monkeypatch):
    monkeypatch.setenv("CUSICK_DATA", str(tmp_path / "other"))
    cells = load_cells(recorded(run, "--data", str(toy_data)))
    assert load_data_of(cells).content_hash == toy_dataset.content_hash


def test_a_table_of_the_run_is_used_again_unless_another_is_given(run, toy_data, tmp_path):
    table = tmp_path / "weights.csv"
    table.write_text(TABLE)
    cells = load_cells(recorded(run, "--data", str(toy_data), "--fabrics-csv", str(table)))
    assert load_data_of(cells).select(cloth="fabric_1").table["areal_density"].iloc[0] == 0.35
    other = tmp_path / "others.csv"
    other.write_text(TABLE.replace("0.35", "0.2"))
    assert load_data_of(cells, fabrics_csv=other).select(cloth="fabric_1").table["areal_density"].iloc[0] == 0.2


def test_a_run_that_was_moved_finds_the_release(run, toy_data, toy_dataset, monkeypatch):
    cells = load_cells(recorded(run, "--data", "/elsewhere/release"))
    monkeypatch.setenv("CUSICK_DATA", str(toy_data))
    assert load_data_of(cells).root == toy_dataset.root


@pytest.mark.parametrize("name", ["/elsewhere/lab", "cusick"])
def test_without_any_data_the_remedy_is_said(run, name):
    with pytest.raises(LeaderboardError, match=r"give their folder with --data, or, .* set CUSICK_DATA") as caught:
        load_data_of(load_cells(recorded(run, "--data", name)))
    assert name in str(caught.value)


@pytest.mark.parametrize("command", ["figure-6", "figure-7", "figure-8"])
def test_figures_ask_for_data_only_where_none_are_found(run, command, toy_data, tmp_path, monkeypatch):
    monkeypatch.setattr("cusick_bench.report.drawing.drape_view.SUPERSAMPLING", 1)
    monkeypatch.setattr("cusick_bench.report.drawing.drape_view.SHADOW_SIZE", 100)
    words = ["paper", command, str(run), "--out", str(tmp_path / "figures")]
    refused = CliRunner().invoke(app, words)
    assert refused.exit_code == 2
    assert "set CUSICK_DATA" in " ".join(refused.output.split())
    monkeypatch.setenv("CUSICK_DATA", str(toy_data))
    drawn = CliRunner().invoke(app, words)
    assert drawn.exit_code == 0, drawn.output
    assert (tmp_path / "figures" / f"{command}.json").is_file()


def test_a_diagnosis_asks_for_data_in_the_same_way(toy_data, tmp_path, monkeypatch):
    refused = CliRunner().invoke(app, ["diagnose", "--out", str(tmp_path)])
    assert refused.exit_code == 2
    assert "set CUSICK_DATA" in " ".join(refused.output.split())
    empty = shutil.copytree(toy_data, tmp_path / "empty", ignore=shutil.ignore_patterns("silhouettes"))
    monkeypatch.setenv("CUSICK_DATA", str(empty))
    looked = CliRunner().invoke(app, ["diagnose", "--out", str(tmp_path)])
    assert looked.exit_code == 2
    assert str(empty) in "".join(looked.output.split())
