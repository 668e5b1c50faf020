"""`cusick-bench run` says what stiffness it found: in its JSON, its table, `result.json` and `stiffness.csv`."""

import csv
import json
import shutil
import sys
from pathlib import Path
from threading import Thread

import pytest
from typer.testing import CliRunner

from cusick_bench import leaderboard
from cusick_bench.cli import app
from cusick_bench.cli.fit.run import _write_stiffness
from cusick_bench.datasets import load
from cusick_bench.runner import load_prediction

pytestmark = pytest.mark.usefixtures("one_thread")

WORDS = ["run", "--data", "synthetic", "--cloth", "fabric_3", "--vertices", "97", "--steps", "10", "--budget", "6"]
SOLVERS = ("homo", "bdp,draws=2,steps=1", "null:disc")


@pytest.fixture(scope="module")
def out(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("run")


@pytest.fixture(scope="module")
def cells(out) -> dict[str, dict]:
    words = [*WORDS, *(word for solver in SOLVERS for word in ("--solver", solver)), "--out", str(out)]
    result = CliRunner().invoke(app, [*words, "--json"])
    assert result.exit_code == 0, result.output
    return {cell["solver"]: cell for cell in json.loads(result.stdout)["cells"]}


def test_json_has_value_and_interval_of_each_direction(cells):
    for solver in SOLVERS[:2]:
        stiffness = cells[solver]["stiffness"]
        assert set(stiffness) == {"warp", "weft", "bias"}
        assert all(set(one) == {"value", "ci90"} for one in stiffness.values())
        assert all(1e-9 < one["value"] < 1e-3 for one in stiffness.values())  # N m
        assert set(cells[solver]["stretch"]) == {"warp", "weft", "shear"}
    assert all(one["ci90"] is None for one in cells["homo"]["stiffness"].values())
    for one in cells["bdp,draws=2,steps=1"]["stiffness"].values():
        low, high = one["ci90"]
        assert low < one["value"] < high


def test_ratio_is_to_the_truth_of_the_shipped_set(cells):
    truth = json.loads((Path(__file__).parents[2] / "datasets/synthetic/truth.json").read_text())
    for direction, row in (("warp", 2), ("weft", 0), ("bias", 1)):
        table = truth["fabrics"]["3"]["bending_N_m"][row]
        true = (table[0] * table[1] * table[2] * table[3] * table[4]) ** 0.2
        found = cells["homo"]["stiffness"][direction]["value"]
        assert cells["homo"]["truth_ratio"]["stiffness"][direction]["value"] == pytest.approx(found / true)


def test_a_solver_without_physics_has_none(cells):
    for key in ("stiffness", "stretch", "truth_ratio", "stiffness_gf_cm2_cm"):
        assert cells["null:disc"][key] is None
    assert cells["null:disc"]["units"]["stiffness"] == "N m"


def test_files_hold_the_same(cells, out):
    for solver, cell in cells.items():
        result = json.loads((Path(cell["path"]) / "result.json").read_text())
        for key in ("stiffness", "stretch", "truth_ratio", "stiffness_curve"):
            assert result[key] == cell[key], (solver, key)
    with (out / "stiffness.csv").open() as file:
        lines = [line for line in csv.DictReader(file) if line["quantity"] == "bending"]
    assert {line["solver"] for line in lines} == set(SOLVERS[:2])
    for line in lines:
        assert float(line["value"]) == cells[line["solver"]]["stiffness"][line["direction"]]["value"]
        assert (out / line["path"]).is_dir()
    draws = load_prediction(Path(cells[SOLVERS[1]]["path"]))["bending_draws"]
    assert draws.shape == (400, 3)


def test_table_shows_both_units_and_a_dash_where_there_is_none(cells, out):
    words = [*WORDS, *(word for solver in SOLVERS for word in ("--solver", solver)), "--out", str(out)]
    text = CliRunner().invoke(app, words, env={"COLUMNS": "300"}).stdout
    for expected in ("bending [µN m]", "[gf cm²/cm]", "stretch [N/m]", "/ true", "warp", "weft", "bias"):
        assert expected in text
    (line,) = [line for line in text.splitlines() if "null:disc" in line and " - " in line]
    assert "0.0" not in line


def test_samples_that_are_left_out_in_turn_are_named(make_lab, tmp_path):
    """By their numbers in the names of the files, whatever their rows are."""
    lab, out = make_lab([4e-5], samples=3), tmp_path / "run"
    for path in sorted(lab.rglob("*Sample_1*")):
        path.rename(path.with_name(path.name.replace("Sample_1", "Sample_8")))
    words = ["run", "--data", str(lab), "--protocol", "leave-one-sample-out", "--vertices", "97", "--steps", "6"]
    words += ["--budget", "6", "--solver", "homo", "--out", str(out)]
    done = CliRunner().invoke(app, [*words, "--json"])
    assert done.exit_code == 0, done.output
    cells = json.loads(done.stdout)["cells"]
    for cell in cells:
        record = json.loads((Path(cell["path"]) / "cell.json").read_text())
        image = load(lab).index["image"][record["test"][0]]
        assert f"Sample_{cell['left_out']}_" in image
    assert sorted(cell["left_out"] for cell in cells) == [2, 3, 8]
    with (out / "stiffness.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert {(line["path"], line["left_out"]) for line in lines} == {
        (f"cells/{Path(cell['path']).name}", str(cell["left_out"])) for cell in cells
    }
    shown = CliRunner().invoke(app, words, env={"COLUMNS": "300"}).stdout
    assert shown.count("left out") == 2
    rows = [line.split("│")[4].strip() for line in shown.splitlines() if line.startswith("│")]
    assert sorted(rows) == sorted(["2", "3", "8"] * 4)  # once, and in three directions


def test_who_leaves_nothing_out_in_turn_says_nothing_of_it(cells, out):
    assert all("left_out" not in cell for cell in cells.values())
    assert "left_out" not in (out / "stiffness.csv").read_text()


def test_a_cell_that_was_edited_is_left_out_of_the_table_with_a_note(cells, out, tmp_path):
    run = shutil.copytree(out, tmp_path / "run")
    edited = run / "cells" / Path(cells["homo"]["path"]).name / "result.json"
    edited.write_text(edited.read_text().replace('"seed": 0', '"seed":  0'))
    result = CliRunner().invoke(app, [*WORDS, "--solver", "null:disc", "--out", str(run)])
    assert result.exit_code == 0, result.output
    with (run / "stiffness.csv").open() as file:
        assert {line["solver"] for line in csv.DictReader(file)} == {SOLVERS[1]}
    assert "Left out, damaged: homo on fabric_3, seed 0" in result.stderr
    assert "result.json is not what the cell was finished with" in result.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="no locks there")
def test_of_two_commands_that_end_at_the_same_time_the_table_has_all_cells(cells, out, tmp_path, monkeypatch):
    """The one that has read the cells first may be the last to write its table."""
    run, aside = Path(shutil.copytree(out, tmp_path / "run")), tmp_path / "aside"
    late = run / "cells" / Path(cells["homo"]["path"]).name
    late.rename(aside)
    table, dataset, others = leaderboard.stiffness_csv, load("synthetic"), list[Thread]()

    def other() -> None:
        aside.rename(late)  # its cell is finished
        _write_stiffness(run, dataset)

    def slow(*arguments) -> str:
        if not others:
            others.append(Thread(target=other))
            others[0].start()
            others[0].join(2.0)
        return table(*arguments)

    monkeypatch.setattr(leaderboard, "stiffness_csv", slow)
    _write_stiffness(run, dataset)
    others[0].join()
    with (run / "stiffness.csv").open() as file:
        assert {line["solver"] for line in csv.DictReader(file)} == set(SOLVERS[:2])


def test_predictions_are_not_read_for_the_table_while_other_commands_wait(cells, out, tmp_path):
    """They are nearly all of a folder, and each part of a grid writes the table at its end."""
    run = Path(shutil.copytree(out, tmp_path / "run"))
    (run / "cells" / Path(cells["homo"]["path"]).name / "prediction.npz").write_bytes(b"other")
    _write_stiffness(run, load("synthetic"))
    with (run / "stiffness.csv").open() as file:
        assert {line["solver"] for line in csv.DictReader(file)} == set(SOLVERS[:2])
    (skipped,) = leaderboard.load_cells(run).skipped
    assert "prediction.npz is not what the cell was finished with" in skipped.reason
