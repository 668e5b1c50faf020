"""The paper's tables: what is run, what stands beside what, and curves read off traces."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.leaderboard import leaderboards, load_cells
from cusick_bench.leaderboard.anytime import Steps, curves, loss_at_equal_time
from cusick_bench.leaderboard.paper import PUBLISHED, SOLVERS, make_table, methods, records, set_table
from cusick_bench.report.drawing.method_graphs import anytime_graph
from cusick_bench.report.figures.anytime import save_anytime

CLOTHS = ("cotton_blue", "cotton_pink", "cotton_white", "viscose_white", "wool_red")


pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def data(make_lab) -> Path:
    return make_lab((2.0, 4.0))


def paper(table: str, data: Path, out: Path, *words: str) -> tuple[int, str]:
    tiny = ["--vertices", "100", "--steps", "20", "--budget", "6", "--draws", "12"]
    result = CliRunner().invoke(app, ["paper", table, "--data", str(data), "--out", str(out), *tiny, *words])
    return result.exit_code, " ".join(result.output.split())


def write_cell(
    folder: Path, solver: str, cloth: str, seed: int, trace: list[tuple[float, float]] = (), **metrics
) -> None:
    """A finished cell with given metrics and a trace of (drapes, best loss), a drape a second."""
    cell = folder / "cells" / f"{solver}-{cloth}-{seed}".replace(":", "_")
    cell.mkdir(parents=True)
    kind = "null" if solver.startswith("null") else "solver"
    record = {"solver": solver, "kind": kind, "cloth": cloth, "seed": seed, "dataset": "cusick", "status": "done"}
    record |= {"dataset_hash": "abc", "protocol": "paper", "space": "homo", "vertices": 9, "code_version": "1"}
    metrics = {"train_mse": 0.01, "test_mse": 0.05, "draws": 1} | metrics
    (cell / "result.json").write_text(json.dumps(record | {"settings": {"loss": "mse"}, "metrics": metrics}))
    (cell / "done").touch()
    lines = [
        {"kind": "loss", "forward_equivalents": cost, "wall_seconds": cost, "best_loss": loss} for cost, loss in trace
    ]
    (cell / "trace.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))


class TestTable1:
    @pytest.fixture
    def run(self, tmp_path) -> Path:
        """A method that beats random phases by 0.004 on every cloth, and one that loses by as much."""
        for place, cloth in enumerate(CLOTHS):
            level = 0.03 + 0.004 * place
            write_cell(tmp_path, "homo", cloth, 0, test_mse=0.06, test_mse_best=0.06)
            write_cell(tmp_path, "bdp,draws=1000", cloth, 0, draws=1000, test_mse=0.05, test_mse_best=level - 0.004)
            write_cell(tmp_path, "bdp-field,draws=1000", cloth, 0, draws=1000, test_mse_best=level + 0.004)
            write_cell(
                tmp_path, "null:random-phase,draws=1000", cloth, 0, draws=1000, test_mse=0.058, test_mse_best=level
            )
        return tmp_path

    def lines(self, run: Path):
        cells = load_cells(run)
        (board,) = leaderboards(cells)
        return make_table("table-1", cells, board)

    def test_best_of_n_stands_beside_its_n_matched_random_row(self, run):
        rows = {row["solver"]: row for row in records(self.lines(run))}
        bdp, field, homo = rows["bdp,draws=1000"], rows["bdp-field,draws=1000"], rows["homo"]
        assert bdp["random_phase_mse_best"] == pytest.approx(0.038)
        assert bdp["margin"] == pytest.approx(-0.004)
        assert bdp["margin_high"] < 0 < field["margin_low"]
        assert homo["margin"] == pytest.approx(0.06 - 0.058), "one draw is read against the mean over random draws"

    def test_published_figures_stand_beside_their_methods_alone(self, run):
        rows = {row["solver"]: row for row in records(self.lines(run))}
        assert rows["homo"]["published_mse"] == 0.0572
        assert rows["bdp,draws=1000"]["published_hausdorff_m"] == 0.0217
        assert np.isnan(rows["bdp-field,draws=1000"]["published_mse"])
        text = set_table(self.lines(run))
        assert [(column.head, column.unit) for column in text.columns[1:3]] == [
            ("published", "MSE"),
            ("published", "H mm"),
        ]

    def test_every_row_names_what_made_it(self, run):
        table = self.lines(run)
        board = replace(table.board, run={"command": "cusick-bench paper table-1", "cores": 2, "processor": "a chip"})
        for row in records(replace(table, board=board)):
            assert row["command"] == "cusick-bench paper table-1"
            assert "a chip" in row["hardware"]
            assert (row["dataset_hash"], row["protocol"]) == (board.dataset_hash, board.protocol)
            assert row["code_version"]

    def test_other_cloths_are_said_to_be_others(self, run, tmp_path):
        assert not any("published figures are for" in note for note in self.lines(run).notes)
        write_cell(tmp_path, "homo", "fabric_9", 0)
        assert any("these rows are for" in note and "fabric_9" in note for note in self.lines(run).notes)

    def test_columns_that_nobody_fills_are_left_out(self, run):
        heads = {column.head for column in set_table(self.lines(run)).columns}
        assert "CRPS" not in heads
        for path in run.glob("cells/*/result.json"):
            result = json.loads(path.read_text())
            result["metrics"]["test_dc_crps"] = 0.0123
            path.write_text(json.dumps(result))
        text = set_table(self.lines(run))
        place = [column.head for column in text.columns].index("CRPS")
        assert {entries[place] for entries in text.entries} == {"1.23"}

    def test_fold_numbers_are_rejected_over_all_cloths_together(self, run, tmp_path):
        """By Holm's correction: .02 alone would be rejected in one cloth, not in one of five."""
        for place, (cloth, p) in enumerate(zip(CLOTHS, (0.001, 0.02, 0.3, 0.5, 0.9), strict=True)):
            write_cell(tmp_path, "heter", cloth, 0, test_fold_p=p)
            write_cell(tmp_path, "sobol", cloth, 0, test_fold_p=0.02 if place == 0 else 0.6)
        rows = {row["solver"]: row for row in records(self.lines(run))}
        assert (rows["heter"]["folds_rejected"], rows["heter"]["folds_tested"]) == (1, 5)
        assert (rows["sobol"]["folds_rejected"], rows["sobol"]["folds_tested"]) == (0, 5)
        assert rows["homo"]["folds_tested"] == 0
        text = set_table(self.lines(run))
        place = [(column.head, column.unit) for column in text.columns].index(("folds", "rejected"))
        shown = {entries[0]: entries[place] for entries in text.entries}
        assert [shown[name] for name in ("heter", "sobol", "homo")] == ["1 of 5", "0 of 5", ""]


@pytest.mark.parametrize("name", ["table-1", "table-2"])
def test_every_column_shows_its_own_metric_in_its_unit(name, tmp_path):
    metrics = {"train_mse": 0.0123, "test_mse": 0.0456, "test_mse_best": 0.0345, "train_hausdorff_m": 0.0111}
    metrics |= {"test_hausdorff_m": 0.0222, "test_hausdorff_best_m": 0.0333, "test_energy_distance": 0.444}
    metrics |= {"test_variogram_score": 0.0555, "test_dc_crps": 0.0234, "test_dc_cover_50": 0.4, "test_fold_p": 0.66}
    write_cell(tmp_path, "bdp", "cotton_blue", 0, draws=1000, test_dc_cover_90=0.8, **metrics)
    cells = load_cells(tmp_path)
    (board,) = leaderboards(cells)
    text = set_table(make_table(name, cells, board, at_equal_time={("bdp", ""): 0.0777}))
    shown = [(column.head, column.unit, entry) for column, entry in zip(text.columns, text.entries[0], strict=True)]
    assert shown[1:] == {
        "table-1": [
            ("published", "MSE", ".0384"), ("published", "H mm", "21.7"), ("test", "MSE [95 %]", ".0456"),
            ("best", "MSE /N", ".0345 /1000"), ("H", "mm", "22.2"), ("H best", "mm", "33.3"),
            ("energy", "dist.", ".444"), ("variogram", "score", ".0555"), ("CRPS", "DC points", "2.34"),
            ("cover", "50 %", "40"), ("cover", "90 %", "80"), ("folds", "p", ".66"), ("folds", "rejected", "0 of 1"),
            ("train", "MSE", ".0123"),
        ],
        "table-2": [
            ("published", "MSE", ".0452"), ("published", "H mm", "20.1"), ("train", "MSE [95 %]", ".0123"),
            ("H", "mm", "11.1"), ("equal time", "MSE", ".0777"), ("test", "MSE", ".0456"),
        ],
    }[name]  # fmt: skip


class TestMethods:
    def test_draws_go_to_who_offers_many(self):
        found, missing = methods(["homo", "null:random-phase", "null:rotation", "rembo@heter", "nobody"], 50)
        assert [method.solver for method in found] == ["homo", "null:random-phase,draws=50", "null:rotation", "rembo"]
        assert [method.space for method in found] == [None, None, None, "heter"]
        assert missing == ["nobody"]
        for text in ("null:random-phase,draws=7", "null:random-phase, draws = 7 @homo"):
            assert methods([text], 50)[0][0].solver == "null:random-phase,draws=7"

    def test_every_published_method_is_in_its_table(self):
        for table, figures in PUBLISHED.items():
            assert set(figures) <= set(SOLVERS[table])


class TestAnytime:
    def test_best_loss_is_a_step_function_of_cost(self):
        steps = Steps(np.array([1.0, 3.0, 7.0]), np.array([np.inf, 0.5, 0.2]))
        at = steps.at(np.array([0.5, 1.0, 2.9, 3.0, 6.9, 7.0, 99.0]))
        assert at.tolist() == [np.inf, np.inf, np.inf, 0.5, 0.5, 0.2, 0.2]

    def test_curves_and_equal_time_are_means_over_cells(self, tmp_path):
        write_cell(tmp_path, "fast", "a", 0, [(1, 0.4), (4, 0.2)])
        write_cell(tmp_path, "fast", "b", 0, [(1, 0.6), (4, 0.4)])
        write_cell(tmp_path, "slow", "a", 0, [(1, 0.9), (6, 0.1)])
        write_cell(tmp_path, "slow", "b", 0, [(3, 0.7), (20, 0.1)])
        write_cell(tmp_path, "null:disc", "a", 0)
        table = load_cells(tmp_path).table
        found = {curve.label: curve for curve in curves(table, "forward_equivalents")}
        assert list(found) == ["slow", "fast"], "the best at the end comes first"
        assert found["slow"].loss[-1] == pytest.approx(0.1)
        assert np.isnan(found["slow"].loss[0]), "one of its cells has no drape yet"
        assert (found["fast"].loss[0], found["fast"].low[0], found["fast"].high[0]) == pytest.approx((0.5, 0.4, 0.6))
        shortest, losses = loss_at_equal_time(table)
        assert shortest == 4
        assert losses == {("fast", ""): pytest.approx(0.3), ("slow", ""): pytest.approx(0.8)}

    def test_curves_are_drawn_to_their_ends(self, tmp_path):
        """A line ended at the last point before, and one that ended before the first point was not there."""
        write_cell(tmp_path, "fast", "a", 0, [(1, 0.4), (2, 0.3), (3, 0.2)])
        write_cell(tmp_path, "middle", "a", 0, [(cost, 1 / cost) for cost in range(1, 30)])
        write_cell(tmp_path, "slow", "a", 0, [(1, 0.9), (9000, 0.1)])
        found = curves(load_cells(tmp_path).table, "wall_seconds")
        figure = anytime_graph(found, "wall_seconds", {curve.label: place for place, curve in enumerate(found)})
        drawn = zip(found, figure.axes[0].lines, strict=True)
        lines = {curve.label: np.asarray(line.get_xydata()) for curve, line in drawn}
        ends = {label: tuple(line[-1]) for label, line in lines.items()}
        assert ends == {"fast": (3, 0.2), "middle": (29, 1 / 29), "slow": (9000, 0.1)}
        assert lines["fast"][0] == pytest.approx((1, 0.4))
        save_anytime(tmp_path / "anytime.png", "lab$a_$: a $ in a name is a letter", {"wall_seconds": found})

    def test_a_name_with_dollars_is_no_formula_in_the_legend(self, tmp_path):
        write_cell(tmp_path, "fit,file=$_$x", "a", 0, [(1, 0.4), (2, 0.3)])
        found = curves(load_cells(tmp_path).table, "wall_seconds")
        save_anytime(tmp_path / "anytime.png", "lab", {"wall_seconds": found})


class TestCommand:
    def test_table_1_is_written_in_every_form_and_goes_on_where_it_stopped(self, data, tmp_path):
        words = ("--solver", "homo,search=2", "--solver", "null:disc", "--solver", "null:random-phase")
        status, output = paper("table-1", data, tmp_path, *words)
        assert status == 0, output
        rows = json.loads((tmp_path / "table-1.json").read_text())["rows"]
        assert {"homo,search=2", "null:disc", "null:random-phase,draws=12"} <= {row["solver"] for row in rows}
        assert len(pd.read_csv(tmp_path / "table-1.csv")) == len(rows)
        assert r"\begin{tabular}" in (tmp_path / "table-1.tex").read_text()
        text = (tmp_path / "table-1.md").read_text()
        assert "| published MSE |" in text
        assert all(f"\n- {fact}: " in text for fact in ("Data", "Command", "Hardware", "Code")), "it says what made it"
        done = {path: path.stat().st_mtime_ns for path in tmp_path.glob("cells/*/result.json")}
        assert len(done) == 6
        assert paper("table-1", data, tmp_path, *words)[0] == 0
        assert {path: path.stat().st_mtime_ns for path in tmp_path.glob("cells/*/result.json")} == done

    def test_a_second_law_has_rows_of_its_own_and_baselines_have_none(self, data, tmp_path):
        words = ("--solver", "homo,search=2", "--solver", "null:disc", "--second-law", "paper")
        status, output = paper("table-1", data, tmp_path, *words)
        assert status == 0, output
        rows = [row["solver"] for row in json.loads((tmp_path / "table-1.json").read_text())["rows"]]
        assert sorted(rows) == ["homo,search=2", "homo,search=2", "null:disc"]
        records_of = [json.loads(path.read_text()) for path in tmp_path.glob("cells/*/cell.json")]
        laws = [record["settings"]["drape"]["law"] for record in records_of if record["solver"].startswith("homo")]
        assert sorted(laws) == ["paper", "paper", "plate", "plate"]

    def test_a_second_law_is_nothing_to_a_space_of_baselines(self, data, tmp_path):
        words = ("--solver", "homo,search=2@homo", "--solver", "null:disc", "--second-law", "paper")
        status, output = paper("table-1", data, tmp_path, *words)
        assert status == 0, output

    def test_table_2_has_curves_and_reads_equal_time(self, data, tmp_path):
        status, output = paper("table-2", data, tmp_path, "--solver", "homo,search=2", "--solver", "nlopt:GN_ESCH")
        assert status == 0, output
        assert (tmp_path / "anytime.png").read_bytes().startswith(b"\x89PNG")
        curve = json.loads((tmp_path / "anytime.json").read_text())["forward_equivalents"]["nlopt:GN_ESCH"]
        rows = {row["solver"]: row for row in json.loads((tmp_path / "table-2.json").read_text())["rows"]}
        assert curve["loss"][-1] == pytest.approx(rows["nlopt:GN_ESCH"]["train_mse"], rel=1e-6)
        assert rows["homo,search=2"]["spent_forward_equivalents"] <= 6
        assert any(row["loss_at_equal_time"] is not None for row in rows.values())

    def test_a_method_that_is_asked_for_must_exist(self, data, tmp_path):
        status, output = paper("table-1", data, tmp_path, "--solver", "homoo")
        assert status == 2
        assert "no solver is registered for homoo" in output

    def test_a_method_that_cannot_be_used_says_why(self, data, tmp_path):
        status, output = paper("table-1", data, tmp_path, "--solver", "nlopt:LN_AUGLAG@homo")
        assert status == 2
        assert "LN_AUGLAG cannot be used: it needs a second optimiser" in " ".join(output.split())
