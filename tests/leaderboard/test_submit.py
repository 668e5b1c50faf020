"""Submitted rows say what they are, and a track takes no others."""

import json
import shutil

import pandas as pd
import pytest
from typer.testing import CliRunner
from verified_runs import SOLVERS, change_json, folder_of, grid

from cusick_bench.cli import app
from cusick_bench.leaderboard import load_cells
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.leaderboard.verification.submit import altered, append, read_rows, rows_of
from cusick_bench.leaderboard.verification.verify import keep, verify_cell
from cusick_bench.sim.engine.settings import DrapeSettings

pytestmark = pytest.mark.usefixtures("one_thread")


class TestSubmission:
    def test_rows_say_what_it_takes_to_repeat_them(self, finished):
        rows = rows_of(load_cells(finished), "lab")
        assert {row["solver"] for row in rows} == set(SOLVERS)
        for row in rows:
            assert row["state"] == "reported"
            assert row["budget"] == "6 drapes"
            assert row["command"].startswith("run ")
            assert all(row[name] for name in ("dataset_hash", "code_version", "hardware", "time", "settings"))

    def test_submitting_again_doubles_nothing_and_brings_states_up_to_date(self, copy, dataset, tmp_path):
        path = tmp_path / "board" / "lab.csv"
        assert append(path, rows_of(load_cells(copy), "lab")) == {"added": 4, "replaced": 0, "unchanged": 0}
        first = path.read_bytes()
        assert append(path, rows_of(load_cells(copy), "lab")) == {"added": 0, "replaced": 0, "unchanged": 4}
        assert path.read_bytes() == first
        keep(copy, [verify_cell(folder_of(copy, "null:disc"), dataset)])
        assert append(path, rows_of(load_cells(copy), "lab")) == {"added": 0, "replaced": 1, "unchanged": 3}
        states = read_rows(path).set_index("solver")["state"]
        assert states["null:disc"] == "verified"
        assert set(states.drop("null:disc")) == {"reported"}

    def test_rows_of_other_runs_stay(self, finished, data, tmp_path):
        path = tmp_path / "lab.csv"
        append(path, rows_of(load_cells(finished), "lab"))
        other = grid(data, tmp_path / "other", ["null:copy"], DrapeSettings(steps=21))
        assert append(path, rows_of(load_cells(other), "lab"))["added"] == 1
        assert len(read_rows(path)) == 5

    def test_altered_numbers_are_found(self, finished, tmp_path):
        path = tmp_path / "lab.csv"
        rows = rows_of(load_cells(finished), "lab")
        append(path, rows)
        lines = {line["row"]: line for line in read_rows(path).to_dict("records")}
        assert [altered(lines[row["row"]], row) for row in rows] == [[]] * 4
        lines[rows[0]["row"]]["test_mse"] = "0.001"
        assert altered(lines[rows[0]["row"]], rows[0])[0].startswith("test_mse 0.001, the run has")

    def test_a_number_that_the_run_has_not_is_found(self, finished, tmp_path):
        row = next(row for row in rows_of(load_cells(finished), "lab") if row["solver"] == "null:disc")
        append(tmp_path / "lab.csv", [row])
        (line,) = read_rows(tmp_path / "lab.csv").to_dict("records")
        assert altered(line | {"test_mse_best_of_1000": ""}, row) == []
        assert altered(line | {"test_mse_best_of_1000": "0.001"}, row) == [
            "test_mse_best_of_1000 0.001, the run has none"
        ]

    def test_numbers_under_another_name_are_found(self, finished, tmp_path):
        path = tmp_path / "lab.csv"
        row = next(row for row in rows_of(load_cells(finished), "lab") if row["solver"].startswith("homo"))
        append(path, [row])
        (line,) = read_rows(path).to_dict("records")
        for name, text in (("solver", "mine"), ("cloths", "fabric_9"), ("budget", "1 drapes"), ("kind", "null")):
            assert altered(line | {name: text}, row) == [
                f"{name} {text}, the run has {str(row[name]).partition(',')[0]}"
            ]
        assert altered(line | {"solver": "homo, search = 2"}, row) == []

    def test_verify_finds_an_altered_line(self, copy, data, tmp_path):
        path = tmp_path / "lab.csv"
        append(path, rows_of(load_cells(copy), "lab"))
        words = ["verify", str(copy), "--data", str(data), "--solver", "null:disc", "--against", str(path)]
        assert CliRunner().invoke(app, words).exit_code == 0
        table = read_rows(path)
        table.loc[table["solver"] == "null:disc", "test_mse"] = "0.001"
        table.to_csv(path, index=False)
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 1
        assert "null:disc's line in the table was altered: test_mse 0.001" in " ".join(result.output.split())

    def test_a_leaderboard_of_the_same_grid_becomes_the_tracks_file(self, finished, tmp_path):
        path = tmp_path / "lab.csv"
        assert CliRunner().invoke(app, ["leaderboard", str(finished), "--out", str(path)]).exit_code == 0
        words = ["submit", str(finished), "--track", "lab", "--out", str(path), "--json"]
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 0, result.output
        assert set(read_rows(path)["solver"]) == set(SOLVERS)
        assert json.loads(CliRunner().invoke(app, words).stdout)["unchanged"] == len(SOLVERS)

    def test_a_leaderboard_of_another_grid_is_left_alone(self, finished, data, tmp_path):
        path = tmp_path / "lab.csv"
        other = grid(data, tmp_path / "other", ["null:disc", "null:copy"])
        CliRunner().invoke(app, ["leaderboard", str(other), "--out", str(path)])
        before = path.read_bytes()
        result = CliRunner().invoke(app, ["submit", str(finished), "--track", "lab", "--out", str(path)])
        assert result.exit_code == 2
        assert "1 lines of another grid" in " ".join(result.output.split())
        assert "null:copy on fabric_1" in " ".join(result.output.split())
        assert path.read_bytes() == before

    def test_a_file_of_another_kind_is_left_alone(self, finished, tmp_path):
        path = tmp_path / "other.csv"
        pd.DataFrame({"solver": ["homo"]}).to_csv(path, index=False)
        before = path.read_bytes()
        result = CliRunner().invoke(app, ["submit", str(finished), "--track", "lab", "--out", str(path)])
        assert result.exit_code == 2
        assert "has no column 'row'" in " ".join(result.output.split())
        assert path.read_bytes() == before
        with pytest.raises(LeaderboardError, match="lower-case letters"):
            rows_of(load_cells(finished), "../evil")

    def test_rows_of_other_tracks_in_the_same_file_stay(self, finished, tmp_path):
        path = tmp_path / "all.csv"
        append(path, rows_of(load_cells(finished), "lab"))
        assert append(path, rows_of(load_cells(finished), "second"))["added"] == 4
        assert append(path, rows_of(load_cells(finished), "lab"))["unchanged"] == 4
        assert list(read_rows(path)["track"]) == 4 * ["lab"] + 4 * ["second"]

    def test_a_track_refuses_data_and_sizes_that_it_is_not_for(self, finished, tmp_path):
        path = tmp_path / "synthetic.csv"
        result = CliRunner().invoke(app, ["submit", str(finished), "--track", "synthetic", "--out", str(path)])
        assert result.exit_code == 2
        assert "track synthetic is for the data set synthetic, got lab" in " ".join(result.output.split())
        rows = [row | {"dataset": "synthetic"} for row in rows_of(load_cells(finished), "synthetic")]
        with pytest.raises(LeaderboardError, match="for meshes of --vertices 600 or 2699, got 100"):
            append(path, rows)
        assert not path.exists()
        settings = json.dumps(json.loads(rows[0]["settings"]) | {"vertices": 600})
        assert append(path, [row | {"settings": settings} for row in rows])["added"] == 4
        before = path.read_bytes()
        with pytest.raises(LeaderboardError, match=r"has rows with dataset hash .*, got abc"):
            append(path, [row | {"settings": settings, "dataset_hash": "abc", "row": "new"} for row in rows])
        assert path.read_bytes() == before

    def test_a_track_takes_its_data_from_a_folder_of_any_name(self, finished, data, tmp_path, monkeypatch):
        rows = rows_of(load_cells(finished), "paper-table-1")
        settings = json.dumps(json.loads(rows[0]["settings"]) | {"vertices": 700})
        rows = [row | {"settings": settings} for row in rows]
        monkeypatch.delenv("CUSICK_DATA", raising=False)
        with pytest.raises(LeaderboardError, match="is for the data set cusick, got lab"):
            append(tmp_path / "table.csv", rows)
        monkeypatch.setenv("CUSICK_DATA", str(data))
        assert append(tmp_path / "table.csv", rows)["added"] == 4

    def test_the_first_rows_of_a_track_are_of_one_data_set(self, finished, tmp_path):
        rows = rows_of(load_cells(finished), "lab")
        rows[1] |= {"dataset_hash": "abc"}
        with pytest.raises(LeaderboardError, match=r"must have one dataset hash, got .* and abc"):
            append(tmp_path / "lab.csv", rows)
        assert not (tmp_path / "lab.csv").exists()

    def test_a_run_that_was_cut_off_is_not_submitted(self, copy, tmp_path):
        shutil.rmtree(folder_of(copy, "homo"))
        path = tmp_path / "lab.csv"
        result = CliRunner().invoke(app, ["submit", str(copy), "--track", "lab", "--out", str(path)])
        assert result.exit_code == 2
        assert "is not finished: 1 cells were cut off or not begun" in " ".join(result.output.split())
        assert not path.exists()

    def test_a_track_of_ones_own_is_for_what_its_first_rows_are_about(self, finished, tmp_path):
        path = tmp_path / "lab.csv"
        rows = rows_of(load_cells(finished), "lab")
        append(path, rows)
        settings = json.dumps(json.loads(rows[0]["settings"]) | {"vertices": 200})
        with pytest.raises(LeaderboardError, match="mesh of so many vertices 100, got 200"):
            append(path, [rows[0] | {"settings": settings, "row": "new"}])

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"solver": None}, "solver must be a name, got None"),
            ({"test_mse": -1e9}, "test_mse must lie in [0, 1], got -1e+09"),
            ({"test_hausdorff_m": -0.02}, "test_hausdorff_m must lie in [0, 10]"),
        ],
    )
    def test_a_run_with_cells_that_are_none_is_not_submitted(self, copy, tmp_path, change, message):
        folder = folder_of(copy, "null:disc")
        change_json(folder / "result.json", lambda result: result.update(change) or result["metrics"].update(change))
        path = tmp_path / "lab.csv"
        result = CliRunner().invoke(app, ["submit", str(copy), "--track", "lab", "--out", str(path)])
        assert result.exit_code == 2
        assert f"{folder / 'result.json'}: {message}" in " ".join(result.output.split())
        assert not path.exists()
