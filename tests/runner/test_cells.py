"""Cells: what their folders hold, failures that stay where they are, stops, and faults of the disk."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from small_grid import DENSITY, SMALL, run_small

from cusick_bench.datasets import load
from cusick_bench.datasets.errors import DataError
from cusick_bench.problem import Budget, Meter
from cusick_bench.runner import (
    ProblemSettings,
    RunnerError,
    Source,
    Store,
    load_prediction,
    plan,
    run,
    run_cell,
)
from cusick_bench.runner.cell import solve_cell
from cusick_bench.runner.cell_problem import build_problem
from cusick_bench.runner.environment import code_state, code_text
from cusick_bench.runner.executors.pool import work
from cusick_bench.runner.warm_up import WarmUp
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import TimeLimit
from cusick_bench.solvers.base import prediction_at
from cusick_bench.solvers.bayesian_optimisation import gaussian_process
from cusick_bench.solvers.gradient.homo import Homo

pytestmark = pytest.mark.usefixtures("one_thread")


class TestCells:
    def test_folder_holds_what_was_asked_done_and_found(self, data, tmp_path):
        (cell,), (result,) = run_small(data, tmp_path, ["homo"], command=["cusick-bench", "run"])
        folder = tmp_path / "cells" / cell.key
        names = {"cell.json", "trace.jsonl", "state.bin", "prediction.npz", "result.json", "done"}
        assert names <= {path.name for path in folder.iterdir()}
        assert not list(folder.glob("*.part"))
        assert result["status"] == "done"
        assert result["spent"]["forward_equivalents"] <= 8
        assert result["budget"] == {"forward_equivalents": 8, "seconds": None}
        arrays = load_prediction(folder)
        assert arrays["draws"].dtype == np.uint8
        assert arrays["stretch"].shape == (6, 4)
        assert arrays["bending"].shape == (3, 5)
        assert arrays["density"] == pytest.approx(DENSITY)
        squared = np.square(arrays["train_image"] - arrays["train_target"], dtype=np.float64).mean()
        assert result["metrics"]["train_mse"] == pytest.approx(squared, rel=1e-4)
        losses = [json.loads(line)["best_loss"] for line in (folder / "trace.jsonl").read_text().splitlines()]
        assert result["metrics"]["train_mse"] == pytest.approx(losses[-1], rel=1e-6)
        record = json.loads((tmp_path / "run.json").read_text())
        assert record["command"] == ["cusick-bench", "run"]
        assert record["dataset_hash"] == load(data).content_hash
        assert record["numerics"] == result["numerics"] == json.loads((folder / "cell.json").read_text())["numerics"]

    def test_data_that_were_changed_between_two_grids_of_one_process_are_read_again(self, data, tmp_path):
        lab = shutil.copytree(data, tmp_path / "lab")
        (first,), _ = run_small(lab, tmp_path / "out", ["sobol"])
        table = lab / "fabrics.csv"
        table.write_text(table.read_text().replace(f",{DENSITY},", ",0.3,"))
        (second,), (result,) = run_small(lab, tmp_path / "out", ["sobol"])
        assert (result["status"], first.key == second.key) == ("done", False)
        assert load_prediction(tmp_path / "out" / "cells" / second.key)["density"] == pytest.approx(0.3)
        assert json.loads((tmp_path / "out" / "run.json").read_text())["dataset_hash"] == second.dataset_hash

    def test_data_that_were_changed_after_the_cells_were_planned_are_refused(self, data, tmp_path):
        lab = shutil.copytree(data, tmp_path / "lab")
        cells = plan(load(lab), solvers=["sobol"], cloths=["fabric_1"], settings=SMALL)
        table = lab / "fabrics.csv"
        table.write_text(table.read_text().replace(f",{DENSITY},", ",0.3,"))
        with pytest.raises(DataError, match=r"are not those that the cells were planned for.*repeat the command"):
            run(Source(str(lab)), cells, tmp_path / "out")
        with pytest.raises(DataError, match="planned for"):
            work(Source(str(lab)), cells[0], tmp_path / "out")

    def test_the_commit_is_recorded_and_not_keyed(self, data, tmp_path, monkeypatch):
        """An edit that changes no number, such as of a docstring, throws no finished work away."""
        (cell,), (result,) = run_small(data, tmp_path, ["null:disc"])
        assert result["code"] == code_state()
        other = {"package": "0.1.0", "commit": "0123456789ab", "dirty": True}
        for module in ("cell", "environment"):
            monkeypatch.setattr(f"cusick_bench.runner.{module}.code_state", lambda: other)
        (again,), (kept,) = run_small(data, tmp_path, ["null:disc"])
        assert (again.key, kept) == (cell.key, result)
        made = json.loads((tmp_path / "run.json").read_text())
        assert code_text(made, {"metrics": 1}) == "metrics 1; commit 0123456789ab (changed)"
        _, (fresh,) = run_small(data, tmp_path, ["null:disc"], seeds=[1])
        assert fresh["code"] == other

    def test_finished_cells_are_not_touched_again(self, data, tmp_path, monkeypatch):
        (cell,), first = run_small(data, tmp_path, ["null:disc"])
        stamp = (tmp_path / "cells" / cell.key / "result.json").stat().st_mtime_ns
        monkeypatch.setattr("cusick_bench.runner.execute.run_cell", None)
        _, again = run_small(data, tmp_path, ["null:disc"])
        assert again == json.loads(json.dumps(again)) == [json.loads(json.dumps(first[0]))]
        assert (tmp_path / "cells" / cell.key / "result.json").stat().st_mtime_ns == stamp
        assert len(json.loads((tmp_path / "run.json").read_text())["history"]) == 1

    def test_one_failure_stays_alone_and_is_tried_again(self, data, tmp_path, monkeypatch):
        def explode(self, problem, generator, progress):
            problem.observe(np.zeros(39))
            raise ZeroDivisionError("planted")

        with monkeypatch.context() as patch:
            patch.setattr(Homo, "_solve", explode)
            cells, results = run_small(data, tmp_path, ["homo", "null:copy"])
        assert [result["status"] for result in results] == ["failed", "done"]
        assert results[0]["failure"] == "ZeroDivisionError: planted"
        assert "explode" in results[0]["traceback"]
        assert results[0]["spent"]["forward"] == 1
        assert not Store(tmp_path).is_done(cells[0].key)
        _, results = run_small(data, tmp_path, ["homo", "null:copy"])
        assert [result["status"] for result in results] == ["done", "done"]

    def test_diverging_drapes_fail_the_cell_with_a_reason(self, data, tmp_path):
        settings = ProblemSettings(
            vertices=100, drape=DrapeSettings(mode="equilibrium", iterations=1), budget=Budget(4)
        )
        _, (result,) = run_small(data, tmp_path, ["homo"], settings=settings)
        assert result["status"] == "failed"
        assert "did not come to rest" in result["failure"]
        assert result["spent"]["failed"] == result["spent"]["forward"] > 0

    def test_what_a_solver_says_stands_until_it_says_something_else(self, dataset, monkeypatch):
        """The next drape took it away: what `bdp-field` knows of the stiffness was there for a moment only."""

        def speaking(self, problem, generator, progress):
            tau = np.zeros(problem.dimension)
            for words in ("first answer", "inference"):
                progress(words, problem.meter.share)
                for _ in range(2):
                    problem.evaluate(tau)
            return prediction_at(problem, tau, finished=True)

        monkeypatch.setattr(Homo, "_solve", speaking)
        (cell,) = plan(dataset, solvers=["homo"], cloths=["fabric_1"], settings=SMALL)
        said: list[str] = []
        solve_cell(build_problem(dataset, cell), dataset, cell, lambda share, loss, message: said.append(message))
        assert said == ["first answer"] * 3 + ["inference"] * 4

    def test_seeds_decide(self, data, tmp_path):
        cells, _ = run_small(data, tmp_path, ["null:random-phase,draws=3"], seeds=[0, 1])
        first, second = (load_prediction(tmp_path / "cells" / cell.key)["draws"] for cell in cells)
        assert (first != second).any()

    def test_oracles_are_shown_the_held_out_images(self, data, tmp_path, dataset):
        (mean, repeat), results = run_small(data, tmp_path, ["oracle:mean", "oracle:repeat"])
        images = np.stack([np.asarray(dataset.image(row)) for row in (*mean.test, *mean.train)])
        draws = load_prediction(tmp_path / "cells" / mean.key)["draws"] / 255
        assert draws[0] == pytest.approx((images[1] + images[2]) / 2, abs=0.003)
        assert results[1]["status"] == "failed"
        assert "repeated capture" in results[1]["failure"]
        assert repeat.record()["kind"] == "oracle"


class TestStop:
    @pytest.mark.parametrize("stop", [KeyboardInterrupt(), TimeLimit("of the task")])
    def test_a_stop_that_comes_out_of_a_kernel_as_another_error_is_no_failure(
        self, data, tmp_path, dataset, monkeypatch, stop
    ):
        """Compiled code turns what a signal's handler raises within it into a SystemError."""

        def interrupted(self, problem, generator, progress):
            raise SystemError("returned a result with an exception set") from stop

        monkeypatch.setattr(Homo, "_solve", interrupted)
        (cell,) = plan(dataset, solvers=["homo"], cloths=["fabric_1"], settings=SMALL)
        store = Store(tmp_path)
        store.prepare()
        with pytest.raises(type(stop)):
            run_cell(dataset, cell, store, lambda *_: None)
        assert not (store.folder(cell.key) / "result.json").exists()

    @pytest.mark.parametrize("stop", [KeyboardInterrupt(), TimeLimit("of the task")])
    def test_a_stop_while_kernels_are_compiled_is_heard(self, dataset, monkeypatch, stop):
        """An ordinary error of the warm-up is the cell's to tell."""

        def raising(error, cause=None):
            def solve(self, problem, generator, progress):
                raise error from cause

            monkeypatch.setattr(Homo, "_solve", solve)
            WarmUp().before(dataset, cell)

        (cell,) = plan(dataset, solvers=["homo"], cloths=["fabric_1"], settings=SMALL)
        with pytest.raises(type(stop)):
            raising(SystemError("returned a result with an exception set"), stop)
        raising(ValueError("planted"))

    @pytest.mark.parametrize("name", ["rembo", "hesbo", "vanilla-bo", "turbo", "baxus"])
    def test_a_warm_up_goes_on_until_the_first_model(self, name, dataset, monkeypatch):
        """BoTorch is imported there, in seconds that no budget is to pay for."""
        modelled = []

        def fit(points, losses, **how):
            modelled.append(len(points))
            raise ValueError("planted")

        monkeypatch.setattr(gaussian_process, "fit", fit)
        (cell,) = plan(dataset, solvers=[name], cloths=["fabric_1"], settings=SMALL)
        WarmUp().before(dataset, cell)
        assert modelled

    def test_a_warm_up_takes_a_gradient_where_its_budget_ends_before(self, dataset, monkeypatch):
        kinds, record = set(), Meter.record
        monkeypatch.setattr(Meter, "record", lambda meter, one: kinds.add(one.kind) or record(meter, one))
        (cell,) = plan(dataset, solvers=["bdp-field,draws=1"], cloths=["fabric_1"], settings=SMALL)
        WarmUp().before(dataset, cell)
        assert kinds == {"drape", "draw", "gradient"}

    def test_the_end_of_a_generator_behind_an_error_is_no_stop(self, data, tmp_path, dataset, monkeypatch):
        def failing(self, problem, generator, progress):
            raise ValueError("planted") from GeneratorExit()

        monkeypatch.setattr(Homo, "_solve", failing)
        (cell,) = plan(dataset, solvers=["homo"], cloths=["fabric_1"], settings=SMALL)
        store = Store(tmp_path)
        store.prepare()
        assert run_cell(dataset, cell, store, lambda *_: None)["failure"] == "ValueError: planted"


class TestDisk:
    def test_unwritable_output_is_found_first(self, data, tmp_path, monkeypatch):
        file = tmp_path / "file"
        file.write_text("")
        monkeypatch.setattr("cusick_bench.runner.execute.run_cell", None)
        with pytest.raises(RunnerError, match=r"is \(or lies under\) a file"):
            run_small(data, file, ["null:disc"])

    @pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
    def test_forbidden_output(self, data, tmp_path):
        tmp_path.chmod(0o500)
        with pytest.raises(RunnerError, match=r"Permission denied.*--out"):
            run_small(data, tmp_path / "out", ["null:disc"])

    def test_full_disk_ends_the_grid_and_loses_nothing(self, data, tmp_path, monkeypatch):
        run_small(data, tmp_path, ["null:disc"])
        device = Path("/dev/full")
        if not device.exists():
            pytest.skip("no /dev/full on this system")

        def full(file, **arrays):
            with device.open("wb", buffering=0) as file:
                file.write(b"x")

        with monkeypatch.context() as patch:
            patch.setattr(np, "savez_compressed", full)
            with pytest.raises(RunnerError, match=r"No space left.*finished cells are kept"):
                run_small(data, tmp_path, ["null:disc", "null:copy"])
        _, results = run_small(data, tmp_path, ["null:disc", "null:copy"])
        assert [result["status"] for result in results] == ["done", "done"]
