"""Cells that a leaderboard leaves out, with a note that says why, and folders without any."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from made_up_cells import DIFFICULTY, only, shown_by_command, write_cell, write_solver

from cusick_bench.datasets.audit.limits import BEYOND, UNCOVERED
from cusick_bench.leaderboard import (
    LeaderboardError,
    load_cells,
    markdown,
)
from cusick_bench.leaderboard.cells.plausible import implausible
from cusick_bench.metrics.distributions.proper_scores import variogram_score
from cusick_bench.runner import Store


def test_failed_unfinished_and_damaged_cells_are_named_and_not_fatal(tmp_path):
    write_solver(tmp_path, "homo", lambda cloth, seed: 0.05)
    write_cell(tmp_path, "heter", "blue", status="failed", failure="DrapeDiverged: residual 0.3")
    write_cell(tmp_path, "heter", "red", done=False)
    (tmp_path / "cells" / "empty").mkdir()
    (write_cell(tmp_path, "heter", "pink") / "result.json").write_text('{"solver": "heter", "ki')
    (write_cell(tmp_path, "heter", "white") / "result.json").write_text("[1, 2]")
    write_cell(tmp_path, "heter", "viscose", train_mse="good")
    cells = load_cells(tmp_path)
    assert sorted(cell.status for cell in cells.skipped) == ["damaged"] * 3 + ["failed"] + ["unfinished"] * 2
    assert set(cells.table["solver"]) == {"homo"}
    notes = " ".join(only(tmp_path).notes)
    assert "residual 0.3" in notes
    assert "heter on pink" in notes


def test_a_cell_that_was_edited_is_left_out_with_a_note(tmp_path):
    kept, edited = (write_cell(tmp_path, "homo", cloth) for cloth in ("blue", "red"))
    for cell in (kept, edited):
        Store(tmp_path).mark_done(cell.name)
    text = (edited / "result.json").read_text()
    (edited / "result.json").write_text(text.replace('"test_mse": 0.05,', '"test_mse": 0.01,'))
    assert load_cells(tmp_path).table["cloth"].tolist() == ["blue"]
    (note,) = [note for note in only(tmp_path).notes if note.startswith("Left out")]
    assert "damaged: homo on red, seed 0" in note
    assert "result.json is not what the cell was finished with; repeat the run command, which runs the cell" in note
    assert load_cells(tmp_path, changed=True).table["cloth"].tolist() == ["blue", "red"]  # for `verify`
    with pytest.raises(LeaderboardError, match="is not what the cell was finished with"):
        load_cells(tmp_path).require_sound()


def _tested_on(cell: Path, rows: list[int]) -> None:
    for path in cell.glob("*.json"):
        path.write_text(json.dumps(json.loads(path.read_text()) | {"test": rows}))


def test_a_cell_with_held_out_samples_and_no_error_on_them_is_damaged(tmp_path):
    _tested_on(write_cell(tmp_path, "homo", "blue"), [1, 2])
    _tested_on(write_cell(tmp_path, "homo", "red", test_mse=None), [1, 2])
    _tested_on(write_cell(tmp_path, "homo", "pink", test_mse=None), [])
    cells = load_cells(tmp_path)
    assert cells.table["cloth"].tolist() == ["blue", "pink"]
    assert "no finite test_mse" in cells.skipped[0].reason


def test_samples_of_another_split_are_not_left_out_in_turn(tmp_path):
    for split, rows in (("first-1", [4, 5]), ("first-8", [6])):
        cell = write_cell(tmp_path, "homo", "blue", protocol=split)
        _tested_on(cell, rows)
        cell.rename(cell.with_name(split))
    assert load_cells(tmp_path).table["repeat"].tolist() == [0, 0]


def test_failed_cells_of_a_row_are_counted(tmp_path):
    write_cell(tmp_path, "homo", "blue")
    write_cell(tmp_path, "homo", "red", status="failed", failure="diverged")
    assert "| 1+1✗ |" in markdown(only(tmp_path))


@pytest.mark.parametrize("make", [lambda f: None, lambda f: f.mkdir(), lambda f: (f / "cells").mkdir(parents=True)])
def test_a_missing_or_empty_folder_gets_one_clear_error(tmp_path, make):
    make(tmp_path / "runs")
    with pytest.raises(LeaderboardError, match="cusick-bench run"):
        load_cells(tmp_path / "runs")


def test_a_folder_without_finished_cells_says_why(tmp_path):
    write_cell(tmp_path, "homo", "blue", status="failed", failure="no density")
    with pytest.raises(LeaderboardError, match="no density"):
        load_cells(tmp_path)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"test_mse": -1e9}, "test_mse must lie in [0, 1], got -1e+09"),
        ({"test_mse": 1.5}, "test_mse must lie in [0, 1], got 1.5"),
        ({"train_mse": None}, "no finite train_mse"),
        ({"test_mse": "0.01x"}, "test_mse must be a number"),
        ({"test_mse": True}, "test_mse must be a number"),
        ({"test_mse": float("nan")}, "NaN"),
        ({"test_mse": float("inf")}, "Infinity"),
        ({"test_hausdorff_m": -0.01}, "test_hausdorff_m must lie in [0, 10], got -0.01"),
        ({"train_dc": 3.0}, "train_dc must lie in [-0.6, 2.5], got 3"),
        ({"test_iou": 1.01}, "test_iou must lie in [0, 1]"),
        ({"seed": -1}, "seed must be a whole number"),
    ],
)
def test_a_cell_that_says_what_no_cell_can_say_is_no_row(tmp_path, noise, changes, reason):
    write_solver(tmp_path, "homo", lambda cloth, seed: DIFFICULTY[cloth])
    seed = changes.pop("seed", 9)
    folder = write_cell(tmp_path, "liar", "blue", seed, **changes)
    result = shown_by_command([str(tmp_path), "--json"])
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert {row["solver"] for row in document["rows"]} == {"homo", "repeat of the same drape"}
    (skipped,) = document["skipped"]
    assert (skipped["path"], skipped["status"]) == (str(folder), "damaged")
    assert reason in skipped["reason"]


@pytest.mark.parametrize(("plate", "cloth"), [(0.09, 0.12), (0.09, 0.15), (0.09, 0.18)])
def test_drape_coefficients_of_all_silhouettes_that_are_used_are_plausible(plate, cloth):
    """A scale that was 7 % off, and stiff cloth: the run was done, and its cells were damaged by its leaderboard."""
    smallest, largest = UNCOVERED * plate, BEYOND * cloth
    limits = [(radius**2 - plate**2) / (cloth**2 - plate**2) for radius in (smallest, largest)]
    assert [implausible("train_dc_target", limit) for limit in limits] == ["", ""]
    assert implausible("test_dc_error", limits[1] - limits[0]) == ""


@pytest.mark.parametrize("name", ["test_dc_rank_bias", "test_energy_score", "spent_wall_seconds", "draws"])
def test_what_is_never_negative_is_said_to_be_so(name):
    assert implausible(name, 0.0) == ""
    assert implausible(name, -0.1) == f"{name} must be at least 0, got -0.1"


def test_a_fair_score_below_zero_is_one(tmp_path):
    """The variance of the draws' mean is taken off: of two draws and a sample between them more than there is."""
    angle = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    shallow, middle, deep = (0.12 + depth * np.cos(6 * angle)[None] for depth in (1e-3, 8e-3, 2e-2))
    score = variogram_score(np.concatenate([shallow, deep]), middle)
    assert score < -1e-3
    write_cell(tmp_path, "bdp", "blue", test_variogram_score=score)
    cells = load_cells(tmp_path)
    assert cells.table["test_variogram_score"].tolist() == [score]
    cells.require_sound()


@pytest.mark.parametrize("name", [None, "", "null", "None", "nan", 7, ["homo"]])
@pytest.mark.parametrize("field", ["solver", "cloth"])
def test_a_cell_without_a_name_is_no_row(tmp_path, name, field):
    write_solver(tmp_path, "null:disc", lambda cloth, seed: DIFFICULTY[cloth])
    folder = write_cell(tmp_path, "homo", "blue")
    result = json.loads((folder / "result.json").read_text())
    (folder / "result.json").write_text(json.dumps(result | {field: name}))
    cells = load_cells(tmp_path)
    assert set(cells.table["solver"]) == {"null:disc"}
    assert f"{field} must be a name" in cells.skipped[0].reason
    with pytest.raises(LeaderboardError, match=rf"result\.json: {field} must be a name"):
        cells.require_sound()


def test_the_command_that_fills_an_empty_folder_can_be_typed_on_windows(tmp_path, monkeypatch):
    """Single quotes, which every path there would have had, are part of a name in cmd.exe."""
    folder = tmp_path / r"my runs\lab"
    folder.mkdir()
    monkeypatch.setattr(sys, "platform", "win32")
    with pytest.raises(LeaderboardError, match=re.escape(f'`cusick-bench run --out "{folder}"`')):
        load_cells(folder)


def test_reading_of_many_cells_tells_how_far_it_is(tmp_path):
    for seed in range(3):
        write_cell(tmp_path, "homo", "blue", seed)
    told = []
    load_cells(tmp_path, progress=lambda done, total: told.append((done, total)))
    assert told == [(1, 3), (2, 3), (3, 3)]


def test_of_many_cells_that_are_left_out_the_first_have_a_note_each(tmp_path):
    """A method that failed everywhere had thousands of lines below the table."""
    write_cell(tmp_path, "homo", "blue")
    for seed in range(25):
        write_cell(tmp_path, "heter", "blue", seed, status="failed", failure="diverged")
    notes = [note for note in only(tmp_path).notes if note.startswith("Left out")]
    assert len(notes) == 21
    assert notes[-1] == "Left out as well: 5 more cells (5 failed); `leaderboard --json` lists them all."
    assert len(json.loads(shown_by_command([str(tmp_path), "--json"]).stdout)["skipped"]) == 25
