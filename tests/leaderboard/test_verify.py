"""Verification finds out what was changed after the run."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner
from verified_runs import SOLVERS, change_arrays, change_json, folder_of, grid, mark_again

from cusick_bench.cli import app
from cusick_bench.cli.results import verify as verify_page
from cusick_bench.datasets import load
from cusick_bench.leaderboard import load_cells
from cusick_bench.leaderboard.learning_curve import learning_splits
from cusick_bench.leaderboard.verification import resimulate, verify
from cusick_bench.leaderboard.verification.comparison import stiffness_checks
from cusick_bench.leaderboard.verification.resimulate import _following, read_record, repeat, rescore
from cusick_bench.leaderboard.verification.submit import rows_of
from cusick_bench.leaderboard.verification.verify import keep, verified_keys, verify_cell
from cusick_bench.metrics.found_stiffness import UNITS
from cusick_bench.problem import DrapeProblem
from cusick_bench.runner import Cell, Source, plan, record_key, run
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.solvers.variational.bdp import Bdp

pytestmark = pytest.mark.usefixtures("one_thread")


class TestCells:
    @pytest.mark.parametrize("solver", SOLVERS)
    def test_an_honest_cell_is_verified(self, finished, dataset, solver):
        found = verify_cell(folder_of(finished, solver), dataset)
        assert (found.status, found.broken) == ("verified", [])
        assert {"test_mse", "train_mse", "fit", "data"} <= {check.name for check in found.checks}

    def test_an_equilibrium_is_verified_where_it_was_found(self, data, dataset, tmp_path):
        folder = folder_of(grid(data, tmp_path / "rest", ["homo,search=3"], DrapeSettings(mode="equilibrium")), "homo")
        found = verify_cell(folder, dataset)
        assert (found.status, found.broken) == ("verified", [])
        change_arrays(folder, vertices=lambda v: v * [1, 1, 0.98], draw_vertices=lambda v: v * [1, 1, 0.98])
        assert "shape [m]" in {check.name for check in verify_cell(folder, dataset).broken}

    @pytest.mark.parametrize("clamp", ["whole", "half"])
    def test_a_cell_is_draped_again_on_its_own_clamp(self, data, dataset, tmp_path, clamp):
        drape = DrapeSettings(steps=20, clamp=clamp)
        folder = folder_of(grid(data, tmp_path / clamp, ["homo,search=3"], drape), "homo")
        record = read_record(folder)
        assert record["settings"]["drape"].get("clamp") == (None if clamp == "whole" else "half")
        assert Cell.from_record(record).key == folder.name
        found = verify_cell(folder, dataset)
        assert (found.status, found.broken) == ("verified", [])

    def test_the_key_is_that_of_the_cell(self, finished, dataset):
        for folder in load_cells(finished).table["folder"]:
            record = read_record(folder)
            assert record_key(record) == Cell.from_record(record).key == folder.name

    @pytest.mark.parametrize(
        ("solver", "changes", "blamed"),
        [
            ("homo", {"tau": lambda tau: tau + 0.05}, "shape [m]"),
            ("homo", {"bending": lambda bending: bending * 1.001}, "bending"),
            ("homo", {"stretch": lambda stretch: stretch * 1.001}, "stretch"),
            ("homo", {"density": lambda density: density * 1.001}, "density"),
            ("homo", {"train_image": lambda image: np.roll(image, 1, axis=0)}, "fit"),
            ("homo", {"draws": lambda draws: np.roll(draws, 1, axis=1)}, "draws"),
            ("homo", {"train_target": lambda image: np.roll(image, 1, axis=0)}, "training image"),
            ("null:random", {"draws": lambda draws: draws[::-1].copy()}, "draws"),
            ("null:disc", {"train_image": lambda image: image * 0.9}, "fit"),
        ],
    )
    def test_changed_arrays_are_found_out(self, copy, dataset, solver, changes, blamed):
        folder = folder_of(copy, solver)
        change_arrays(folder, **changes)
        found = verify_cell(folder, dataset)
        assert found.status == "differs"
        assert blamed in {check.name for check in found.broken}

    @pytest.mark.parametrize("solver", ["homo", "null:random", "oracle"])
    @pytest.mark.parametrize("metric", ["test_mse", "test_hausdorff_m"])
    def test_changed_metrics_are_found_out(self, copy, dataset, solver, metric):
        folder = folder_of(copy, solver)
        change_json(folder / "result.json", lambda result: result["metrics"].update({metric: 0.02}))
        found = verify_cell(folder, dataset)
        assert (found.status, [check.name for check in found.broken]) == ("differs", [metric])

    @pytest.mark.parametrize("solver", ["homo", "null:random"])
    def test_a_metric_that_was_taken_out_or_put_in_is_found_out(self, copy, dataset, solver, monkeypatch):
        folder = folder_of(copy, solver)
        change_json(folder / "result.json", lambda result: result["metrics"].pop("test_hausdorff_m"))
        change_json(folder / "result.json", lambda result: result["metrics"].update(test_mse_best_of_7=0.001))
        found = verify_cell(folder, dataset)
        assert found.status == "differs"
        assert {check.name for check in found.broken} == {"test_hausdorff_m", "test_mse_best_of_7"}
        monkeypatch.setattr("cusick_bench.metrics.NUMERICS_VERSION", 99)
        assert verify_cell(folder, dataset).status == "verified"  # other code may measure other things

    def test_a_cost_or_trace_that_does_not_fit_the_marker_is_found_out(self, copy, dataset):
        folder = folder_of(copy, "homo")
        result = json.loads((folder / "result.json").read_text())
        result["spent"]["forward_equivalents"] = 1.0
        (folder / "result.json").write_text(json.dumps(result))
        (found,) = verify_cell(folder, dataset).broken
        assert found.name == "files"
        assert "result.json is not what the cell was finished with" in found.detail

    @pytest.mark.parametrize(
        "change",
        [
            lambda result: result["stiffness"]["warp"].update(value=1.001 * result["stiffness"]["warp"]["value"]),
            lambda result: result["stiffness"]["warp"].update(ci90=[1e-6, 1e-5]),
            lambda result: result["stiffness"].pop("bias"),
            lambda result: result.update(stiffness=None),
        ],
    )
    def test_a_changed_stiffness_is_found_out(self, copy, dataset, change):
        folder = folder_of(copy, "homo")
        change_json(folder / "result.json", change)
        found = verify_cell(folder, dataset)
        assert (found.status, [check.name for check in found.broken]) == ("differs", ["stiffness"])

    def test_a_comparison_with_another_truth_is_told_as_such(self):
        """As where a laboratory takes a `truth.json` away, or has measured its cloth after the fit."""
        stored = {"truth_ratio": {"stiffness": {"warp": {"value": 2.0}}}}
        (found,) = stiffness_checks(stored, None)
        assert not found.holds
        assert "if that file was changed since, run the cell again into another folder" in found.detail

    def test_a_result_of_before_stiffness_was_recorded_is_verified(self, copy, dataset):
        folder = folder_of(copy, "homo")
        change_json(folder / "result.json", lambda result: [result.pop(name) for name in UNITS])
        assert verify_cell(folder, dataset).status == "verified"

    def test_a_changed_question_is_found_out(self, copy, dataset):
        folder = folder_of(copy, "null:disc")
        change_json(folder / "result.json", lambda result: result.update(seed=7))
        assert {check.name for check in verify_cell(folder, dataset).broken} == {"result's record"}
        change_json(folder / "cell.json", lambda record: record.update(seed=7))
        assert {check.name for check in verify_cell(folder, dataset).broken} == {"record"}

    def test_a_changed_kind_is_found_out(self, copy, dataset):
        """An oracle, which has seen the test images, cannot pass for a reference that has not."""
        folder = folder_of(copy, "null:disc")
        for name in ("cell.json", "result.json"):
            change_json(folder / name, lambda record: record.update(kind="oracle"))
        renamed = folder.rename(folder.parent / record_key(read_record(folder)))
        mark_again(renamed)
        found = verify_cell(renamed, dataset)
        assert found.status == "differs"
        assert [check.detail for check in found.broken] == ["kind changed, not "]

    def test_samples_must_be_those_of_the_split(self, data, dataset, tmp_path):
        """Another picture of the training drape is no unseen sample, whatever the cell calls its split."""
        (split,) = dataset.split("paper", ["fabric_1"])
        repeat = replace(split, test=(split.train[0] + 1,))
        for name, status in (("paper", "differs"), ("first-1", "differs"), ("mine", "verified")):
            cells = plan(dataset, solvers=["null:disc"], splits=[repeat], protocol=name)
            run(Source(str(data)), cells, tmp_path / name)
            found = verify_cell(tmp_path / name / "cells" / cells[0].key, dataset)
            assert (found.status, [check.name for check in found.broken]) == (
                status,
                ["split"] if status == "differs" else [],
            )
            assert any("record alone says what was unseen" in note for note in found.notes) == (name == "mine")

    def test_samples_of_a_learning_curve_are_known(self, data, dataset, tmp_path):
        splits = learning_splits(dataset, ["fabric_1"], [2], 1)[2]
        cells = plan(dataset, solvers=["null:disc"], splits=splits, protocol="first-2")
        run(Source(str(data)), cells, tmp_path / "out")
        found = verify_cell(tmp_path / "out" / "cells" / cells[0].key, dataset)
        assert (found.status, found.notes) == ("verified", ())

    def test_other_data_do_not_verify(self, finished, data, tmp_path):
        other = Path(shutil.copytree(data, tmp_path / "other"))
        (other / "fabrics.csv").write_text("fabric,areal_density_kg_m2,thickness_m\nfabric_1,0.3,0.0004\n")
        found = verify_cell(folder_of(finished, "homo"), load(other))
        assert (found.status, [check.name for check in found.broken]) == ("differs", ["data"])

    def test_data_that_have_lost_samples_are_other_data_too(self, finished, data, tmp_path):
        """As of a run that was continued on another data set: the cell is sound, and its rows are not there."""
        fewer = Path(shutil.copytree(data, tmp_path / "fewer"))
        for path in fewer.rglob("*Sample_*"):
            if "Sample_1_Capture_1." not in path.name:
                path.unlink()
        found = verify_cell(folder_of(finished, "null:disc"), load(fewer))
        assert (found.status, [check.name for check in found.broken]) == ("differs", ["data"])

    def test_other_code_is_said(self, finished, dataset, monkeypatch):
        monkeypatch.setattr("cusick_bench.metrics.NUMERICS_VERSION", 99)
        found = verify_cell(folder_of(finished, "null:disc"), dataset)
        assert found.status == "verified"
        assert any("metrics 1" in note and "verified by datasets 1, metrics 99" in note for note in found.notes)

    def test_draws_that_are_not_simulated_again_are_said_to_be(self, copy, dataset):
        """A posterior's draws: their pictures are rendered and scored again, and nobody knows where they come from."""
        folder = folder_of(copy, "homo")
        change_arrays(
            folder,
            draws=lambda draws: np.concatenate([draws, draws]),
            draw_vertices=lambda shapes: np.concatenate([shapes, shapes]),
        )
        cell = Cell.from_record(read_record(folder))
        metrics = rescore(repeat(folder, cell, "solver", dataset), cell, dataset)
        assert metrics["draws"] == 2
        change_json(folder / "result.json", lambda result: result.update(metrics=metrics))
        found = verify_cell(folder, dataset)
        assert (found.status, found.broken) == ("rescored", [])
        assert any(
            "2 draws were scored again" in note and "none of them was simulated again" in note for note in found.notes
        )
        change_arrays(folder, draws=lambda draws: np.stack([draws[0], np.roll(draws[1], 2, axis=0)]))
        assert "pictures of draws" in {check.name for check in verify_cell(folder, dataset).broken}

    def test_draws_of_a_posterior_are_drawn_again(self, data, dataset, tmp_path):
        solver = "bdp,draws=3,steps=1,samples=2,search=2"
        folder = folder_of(grid(data, tmp_path / "bdp", [solver]), "bdp")
        found = verify_cell(folder, dataset, redrawn=2)
        assert (found.status, found.broken) == ("verified", [])
        assert any("3 draws were scored again; 2 of them" in note for note in found.notes)
        assert max(check.difference for check in found.checks if check.name.startswith("test_")) < 1e-9
        metrics = json.loads((folder / "result.json").read_text())["metrics"]
        slightly = {name: 1.0001 * metrics[name] for name in ("test_energy_distance", "test_dc_crps")}
        change_json(folder / "result.json", lambda result: result["metrics"].update(slightly))
        assert {check.name for check in verify_cell(folder, dataset).broken} == set(slightly)
        change_json(folder / "result.json", lambda result: result["stiffness"]["weft"]["ci90"].reverse())
        change_arrays(folder, bending_draws=lambda draws: draws[:, ::-1])
        assert {"stiffness", "stiffness of draws"} <= {check.name for check in verify_cell(folder, dataset).broken}
        change_arrays(folder, posterior_mean=lambda mean: mean + 0.1)
        assert "shapes of redraws [m]" in {check.name for check in verify_cell(folder, dataset).broken}

    def test_the_picture_of_every_draw_is_made_again(self, copy, dataset):
        folder = folder_of(copy, "homo")
        change_arrays(folder, **dict.fromkeys(("draws", "draw_vertices"), lambda one: np.concatenate([one] * 24)))
        cell = Cell.from_record(read_record(folder))
        again = repeat(folder, cell, "solver", dataset)
        assert all(check.holds for check in again.checks)
        change_arrays(folder, draws=lambda draws: np.stack([*draws[:5], np.roll(draws[5], 2, axis=0), *draws[6:]]))
        broken = [check.name for check in repeat(folder, cell, "solver", dataset).checks if not check.holds]
        assert broken == ["pictures of draws"]

    def test_draws_that_were_picked_or_repeated_are_found_out(self, data, dataset, tmp_path):
        solver = "bdp,draws=4,steps=1,samples=2,search=2"
        folder = folder_of(grid(data, tmp_path / "bdp", [solver]), "bdp")
        cell = Cell.from_record(read_record(folder))
        assert all(check.holds for check in repeat(folder, cell, "solver", dataset).checks)
        whole = (folder / "prediction.npz").read_bytes()
        pickings = (([0, 2, 3], "draws left out"), ([0, 1, 2, 2], "numbers of draws"), ([0, 1], "draws left out"))
        for picked, blamed in pickings:
            (folder / "prediction.npz").write_bytes(whole)
            chosen = dict.fromkeys(("draws", "draw_vertices", "posterior_draws"), lambda one, at=picked: one[at])
            change_arrays(folder, **chosen)
            broken = [check.name for check in repeat(folder, cell, "solver", dataset).checks if not check.holds]
            assert broken == [blamed]

    def test_draws_may_be_fewer_where_all_further_ones_fail(self, data, dataset, tmp_path, monkeypatch):
        exact, drape = Bdp.redraw, DrapeProblem.draw_batch
        monkeypatch.setattr(
            Bdp, "redraw", lambda *words: exact(*words) if words[-1] == 0 else np.zeros_like(exact(*words))
        )
        monkeypatch.setattr(
            DrapeProblem,
            "draw_batch",
            lambda problem, taus: [drape(problem, tau[None])[0] if tau.any() else None for tau in taus],
        )
        folder = folder_of(grid(data, tmp_path / "bdp", ["bdp,draws=2,steps=1,samples=2,search=2"]), "bdp")
        with np.load(folder / "prediction.npz") as archive:
            assert archive["posterior_draws"].tolist() == [0]
        assert verify_cell(folder, dataset, redrawn=2).status == "verified"

    def test_of_two_faces_the_numbers_after_the_last_draw_of_each_are_tried(self):
        stored = {"posterior_draws": np.array([0, 1, 4, 3]), "draw_turned": np.array([False, True] * 2)}
        assert _following(stored, 3, 2) == [[6, 8], [5, 7]]
        assert _following(stored, 3, 9) == [[6, 8, 10], [5, 7, 9, 11]]
        assert _following(stored, 2, 9) == []

    def test_draws_in_single_precision_are_drawn_again(self, data, dataset, tmp_path, monkeypatch):
        exact = Bdp.redraw
        monkeypatch.setattr(Bdp, "redraw", lambda *words: exact(*words).astype(np.float32))
        folder = folder_of(grid(data, tmp_path / "bdp", ["bdp,draws=2,steps=1,samples=2,search=2"]), "bdp")
        assert verify_cell(folder, dataset, redrawn=2).status == "verified"

    @pytest.mark.parametrize("damage", [b"", b"no archive", None])
    def test_damage_is_no_crash(self, copy, dataset, damage):
        path = folder_of(copy, "homo") / "prediction.npz"
        path.unlink() if damage is None else path.write_bytes(damage)
        found = verify_cell(path.parent, dataset)
        assert found.status == "unreadable"
        assert "prediction.npz" in found.notes[0]

    def test_too_little_memory_is_no_damage(self, finished, dataset, monkeypatch):
        def full(folder):
            raise MemoryError

        monkeypatch.setattr(resimulate, "load_prediction", full)
        with pytest.raises(MemoryError):
            verify_cell(folder_of(finished, "null:disc"), dataset)


class TestCommand:
    def test_verified_rows_are_kept_until_a_file_changes(self, copy, data):
        words = ["verify", str(copy), "--data", str(data), "--solver", "null:disc", "--json"]
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 0
        assert json.loads(result.stdout)["rows"] == [
            {"solver": "null:disc", "status": "verified", "verified": 1, "cells": 1}
        ]
        folder = folder_of(copy, "null:disc")
        assert verified_keys(copy) == {folder.name}
        change_json(folder / "result.json", lambda result: result["metrics"].update(test_mse=0.01))
        assert verified_keys(copy) == set()
        result = CliRunner().invoke(app, ["verify", str(folder), "--data", str(data)])
        assert result.exit_code == 1
        assert "test_mse" in result.output

    def test_a_row_is_verified_only_where_all_of_its_cells_are(self, data, dataset, tmp_path):
        """Of two cells one differs, and its files are those that were looked at."""
        good, changed = plan(dataset, solvers=["null:disc"], seeds=[0, 1])
        run(Source(str(data)), [good, changed], tmp_path)
        path = tmp_path / "cells" / changed.key / "result.json"
        change_json(path, lambda result: result["metrics"].update(test_mse=0.02))
        result = CliRunner().invoke(app, ["verify", str(tmp_path), "--data", str(data), "--json"])
        assert result.exit_code == 1
        document = json.loads(result.stdout)
        assert {cell["key"]: cell["status"] for cell in document["cells"]} == {
            good.key: "verified", changed.key: "differs"
        }  # fmt: skip
        assert document["rows"] == [{"solver": "null:disc", "status": "reported", "verified": 1, "cells": 2}]
        assert verified_keys(tmp_path) == {good.key}
        (row,) = rows_of(load_cells(tmp_path), "lab")
        assert (row["cells"], row["state"]) == (2, "reported")

    def test_a_damaged_cell_is_not_passed_over(self, copy, data):
        folder = folder_of(copy, "null:disc")
        for solver in ("homo", "oracle"):
            shutil.rmtree(folder_of(copy, solver))
        change_json(folder / "result.json", lambda result: result["metrics"].update(test_mse=-1e9))
        words = ["verify", str(copy), "--data", str(data), "--json"]
        for more in ((), ("--solver", "null:disc")):
            result = CliRunner().invoke(app, [*words, *more])
            assert result.exit_code == 1
            document = json.loads(result.stdout)
            assert document["rows"][0] == {"solver": "null:disc", "status": "reported", "verified": 0, "cells": 1}
            assert "test_mse must lie in [0, 1]" in document["cells"][0]["notes"][0]

    def test_what_was_verified_before_an_interruption_is_kept(self, copy, data, monkeypatch):
        first = load_cells(copy).table["folder"].iloc[0]

        def interrupted(folder, *given, **options):
            if folder != first:
                raise KeyboardInterrupt
            return verify_cell(folder, *given, **options)

        monkeypatch.setattr(verify, "verify_cell", interrupted)
        result = CliRunner().invoke(app, ["verify", str(copy), "--data", str(data)])
        assert result.exit_code == 130
        assert "interrupted: 1 cell of 4" in " ".join(result.stderr.split())
        assert set(json.loads((copy / "verified.json").read_text())) == {first.name}

    def test_a_kill_loses_no_more_than_the_last_minute(self, copy, data, monkeypatch):
        kept: list[set[str]] = []

        def looked_at(folder, *given, **options):
            path = copy / "verified.json"
            kept.append(set(json.loads(path.read_text())) if path.exists() else set())
            return verify_cell(folder, *given, **options)

        monkeypatch.setattr(verify, "verify_cell", looked_at)
        words = ["verify", str(copy), "--data", str(data), "--solver", "null:disc", "--solver", "oracle:best-other"]
        for every, first in ((60.0, 0), (0.0, 1)):
            monkeypatch.setattr(verify_page, "_KEPT_EVERY", every)
            (copy / "verified.json").unlink(missing_ok=True)
            assert CliRunner().invoke(app, words).exit_code == 0
            assert list(map(len, kept[-2:])) == [0, first]

    def test_a_cell_that_is_changed_while_others_are_looked_at_is_not_verified(self, copy, data, monkeypatch):
        folder = folder_of(copy, "null:disc")

        def changed(looked_at, *given, **options):
            found = verify_cell(looked_at, *given, **options)
            change_json(folder / "result.json", lambda result: result["metrics"].update(test_mse=0.01))
            return found

        monkeypatch.setattr(verify, "verify_cell", changed)
        result = CliRunner().invoke(app, ["verify", str(copy), "--data", str(data), "--solver", "null:disc"])
        assert result.exit_code == 0, result.output
        assert verified_keys(copy) == set()

    def test_an_interruption_in_the_first_cell_writes_nothing(self, copy, data, monkeypatch):
        def interrupted(*given, **options):
            raise KeyboardInterrupt

        monkeypatch.setattr(verify, "verify_cell", interrupted)
        result = CliRunner().invoke(app, ["verify", str(copy), "--data", str(data)])
        assert result.exit_code == 130
        assert "interrupted: no cell of 4 was looked at to its end, and nothing was written" in result.stderr
        assert not (copy / "verified.json").exists()

    def test_unknown_solver_is_said(self, finished):
        result = CliRunner().invoke(app, ["verify", str(finished), "--solver", "nobody"])
        assert result.exit_code == 2
        assert "holds no solver nobody" in " ".join(result.output.split())


def test_cells_of_another_data_set_keep_what_is_known_of_them(make_lab, tmp_path):
    labs, out = [make_lab((stiffness,), samples=2) for stiffness in (1.0, 2.0)], tmp_path / "out"
    for lab in labs:
        grid(lab, out, ("null:disc",))
    for lab in labs:
        shown = CliRunner().invoke(app, ["verify", str(out), "--data", str(lab)])
        assert shown.exit_code == 0, shown.output
        assert f"cells on {load(lab).name} are verified" in shown.stderr
    assert len(verified_keys(out)) == 2


def test_cells_on_other_data_of_the_same_name_keep_what_is_known_of_them(make_lab, tmp_path):
    """Folders of two laboratories may both be `prepared`: all cells were judged by the data of the last command."""
    labs, out = [tmp_path / place / "prepared" for place in ("first", "second")], tmp_path / "out"
    for lab, stiffness in zip(labs, (1.0, 2.0), strict=True):
        shutil.copytree(make_lab((stiffness,), samples=2), lab)
        grid(lab, out, ("null:disc",))
    for arguments in ([], ["--data", str(labs[0])]):
        shown = CliRunner().invoke(app, ["verify", str(out), *arguments], env={"COLUMNS": "400"})
        assert shown.exit_code == 0, shown.output
        assert "1 cells on other data of that name are left aside" in shown.stderr
    assert len(verified_keys(out)) == 2


def test_a_command_that_finished_no_cell_does_not_decide_by_which_data_others_are_judged(make_lab, tmp_path):
    """A second laboratory's run was cut off in its first cell, and verified cells of the first became wrong ones."""
    labs, out = [make_lab((stiffness,), samples=2) for stiffness in (1.0, 2.0)], tmp_path / "out"
    grid(labs[0], out, ("null:disc",))
    (finished,) = (out / "cells").iterdir()
    grid(labs[1], out, ("null:disc",))
    (other,) = (cell for cell in (out / "cells").iterdir() if cell != finished)
    for name in ("done", "result.json", "prediction.npz"):
        (other / name).unlink()
    shown = CliRunner().invoke(app, ["verify", str(out)])
    assert shown.exit_code == 0, shown.output
    assert verified_keys(out) == {finished.name}


@pytest.mark.parametrize("place", [".", "KEY"])
def test_a_cell_is_found_from_within_its_run(make_lab, tmp_path, monkeypatch, place):
    """Of `.` the folder two above was `.` again, which holds no cells."""
    out = grid(make_lab((1.0,), samples=2), tmp_path / "out", ("null:disc",))
    (cell,) = (out / "cells").iterdir()
    monkeypatch.chdir(cell if place == "." else cell.parent)
    shown = CliRunner().invoke(app, ["verify", place.replace("KEY", cell.name)])
    assert shown.exit_code == 0, shown.output
    assert verified_keys(out) == {cell.name}


def test_thousands_of_cells_stay_verified(tmp_path):
    """Of 3000 cells the file has more than the 16 MiB up to which JSON is read elsewhere."""
    entry = {"status": "verified", "files": {}, "notes": ["x" * (17 << 20)]}
    (tmp_path / "verified.json").write_text(json.dumps({"0123456789abcdef0123": entry}))
    keep(tmp_path, [])
    assert verified_keys(tmp_path) == {"0123456789abcdef0123"}
