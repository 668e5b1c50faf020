"""The runner: cells, resumption after a kill, failures that stay where they are, and faults of the disk."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets import load
from cusick_bench.datasets.errors import DataError
from cusick_bench.problem import Budget, ProblemError
from cusick_bench.runner import (
    Cell,
    ProblemSettings,
    RunnerError,
    Source,
    Store,
    Unwatched,
    load_prediction,
    plan,
    run,
    run_cell,
    shard,
)
from cusick_bench.runner.environment import code_state, code_text
from cusick_bench.runner.executors.pool import work
from cusick_bench.runner.warm_up import WarmUp
from cusick_bench.sim.effects.boundary.plate_tilt import PlateTilt
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import CusickError, TimeLimit
from cusick_bench.solvers.gradient.homo import Homo

DENSITY = 0.2  # [kg/m2], of every cloth that make_lab makes
SMALL = ProblemSettings(vertices=100, drape=DrapeSettings(steps=20), budget=Budget(8))


pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def data(make_lab) -> Path:
    """Two cloths with three samples each; the second has no areal density."""
    return make_lab((2.0, 4.0), weighed=1)


@pytest.fixture(scope="module")
def dataset(data):
    return load(data)


def _run(data: Path, out: Path, solvers: list[str], **options) -> tuple[list[Cell], list[dict]]:
    planned = {"cloths": ["fabric_1"], "settings": SMALL} | {
        key: options.pop(key) for key in ("cloths", "seeds", "settings") if key in options
    }
    cells = plan(load(data), solvers=solvers, **planned)
    return cells, list(run(Source(str(data)), cells, out, **options))  # read now, before they change


def _numbers(folder: Path) -> dict:
    """What must not depend on how often a run was killed: all but times."""
    result = json.loads((folder / "result.json").read_text())
    spent = {name: value for name, value in result["spent"].items() if name != "wall_seconds"}
    losses = [json.loads(line)["loss"] for line in (folder / "trace.jsonl").read_text().splitlines()]
    return {"metrics": result["metrics"], "spent": spent, "losses": losses}


class TestGrid:
    def test_every_solver_meets_every_cloth_and_seed(self, dataset):
        cells = plan(dataset, solvers=["homo", "null:disc"], cloths=["fabric_1"], seeds=[0, 1], settings=SMALL)
        assert len({cell.key for cell in cells}) == len(cells) == 4
        assert {(cell.solver, cell.seed) for cell in cells} == {
            (solver, seed) for solver in ("homo", "null:disc") for seed in (0, 1)
        }
        assert all(len(cell.train) == 1 and len(cell.test) == 2 for cell in cells)

    def test_a_solver_is_run_once_however_it_is_spelled(self, dataset):
        spellings = ["bdp,draws=5,steps=4", "bdp, steps = 4, draws=5", "bdp,draws=5,steps=4,search=8", "bdp,draws=5"]
        cells = plan(dataset, solvers=spellings, cloths=["fabric_1"], settings=SMALL)
        assert [cell.solver for cell in cells] == ["bdp,draws=5,steps=4", "bdp,draws=5"]
        (spaced,) = plan(dataset, solvers=[" bdp , draws = 5, steps=4 "], cloths=["fabric_1"], settings=SMALL)
        assert spaced.key == cells[0].key

    def test_a_laid_shape_is_refused_where_it_is_a_parameter(self, dataset):
        settings = replace(SMALL, laying="random")
        with pytest.raises(RunnerError, match="laying must be image in the space field"):
            plan(dataset, solvers=["homo", "bdp-field"], cloths=["fabric_1"], settings=settings)
        homo, null = plan(dataset, solvers=["homo", "null:disc"], cloths=["fabric_1"], settings=settings)
        assert homo.settings.laying == null.settings.laying == "random"
        assert plan(dataset, solvers=["null:disc"], settings=replace(settings, space="field"))

    @pytest.mark.parametrize(
        ("changed", "why"),
        [
            ({"drape": DrapeSettings(law="plate", mode="equilibrium")}, "got mode equilibrium"),
            ({"causes": ("self-contact:thickness=0.001",)}, "got self-contact"),
        ],
    )
    def test_a_brisk_pace_is_refused_where_nothing_is_dropped(self, dataset, changed, why):
        settings = replace(SMALL, **changed)
        with pytest.raises(RunnerError, match=f"pace brisk is for drops, {why}"):
            plan(dataset, solvers=["bdp-field,pace=brisk"], cloths=["fabric_1"], settings=settings)
        assert plan(dataset, solvers=["bdp-field"], cloths=["fabric_1"], settings=settings)

    def test_key_follows_whatever_decides_the_numbers(self, dataset, monkeypatch):
        def key(solver="homo", seed=0, settings=SMALL, cloth="fabric_1"):
            return plan(dataset, solvers=[solver], cloths=[cloth], seeds=[seed], settings=settings)[0].key

        others = {
            key(solver="homo,search=3"),
            key(seed=1),
            key(settings=ProblemSettings(vertices=120, drape=DrapeSettings(steps=20), budget=Budget(8))),
            key(settings=ProblemSettings(vertices=100, drape=DrapeSettings(steps=21), budget=Budget(8))),
            key(settings=ProblemSettings(vertices=100, drape=DrapeSettings(steps=20), budget=Budget(9))),
        }
        assert key() == key()
        assert len(others | {key()}) == 6
        before = key()
        monkeypatch.setattr("cusick_bench.sim.engine.NUMERICS_VERSION", 99)
        assert key() != before

    def test_cells_are_named_by_a_mended_clamp_only(self, dataset):
        """Records of before there was a choice say nothing of it: their hinges were whole, and their names stay."""

        def cell(**changes) -> Cell:
            drape = DrapeSettings(steps=20, **changes)
            settings = ProblemSettings(vertices=100, drape=drape, budget=Budget(8))
            return plan(dataset, solvers=["homo"], cloths=["fabric_1"], settings=settings)[0]

        drapes = {name: cell(clamp=name).record()["settings"]["drape"] for name in ("half", "whole")}
        assert drapes["half"] == drapes["whole"] | {"clamp": "half"}
        assert "clamp" not in drapes["whole"]
        assert cell().key == cell(clamp="half").key != cell(clamp="whole").key
        assert cell().problem_hash() != cell(clamp="whole").problem_hash()
        for other in ({"law": "published"}, {"support": "springs"}):
            assert cell(**other).key == cell(**other, clamp="whole").key

    @pytest.mark.parametrize(
        ("part", "touched"),
        [
            ("cusick_bench.solvers.variational.bdp.Bdp.version", {"bdp"}),
            ("cusick_bench.sim.render.NUMERICS_VERSION", {"homo", "bdp"}),
            ("cusick_bench.problem.NUMERICS_VERSION", {"homo", "bdp"}),
            ("cusick_bench.metrics.NUMERICS_VERSION", {"homo", "bdp", "null:disc"}),
            ("cusick_bench.sim.contact.NUMERICS_VERSION", set()),
            ("cusick_bench.sim.effects.NUMERICS_VERSION", set()),
        ],
    )
    def test_a_new_version_touches_only_cells_that_use_the_part(self, dataset, monkeypatch, part, touched):
        def keys():
            cells = plan(dataset, solvers=["homo", "bdp", "null:disc"], cloths=["fabric_1"], settings=SMALL)
            return {cell.solver: cell.key for cell in cells}

        before = keys()
        monkeypatch.setattr(part, 99)
        after = keys()
        assert {solver for solver in before if before[solver] != after[solver]} == touched

    def test_effects_and_contact_count_where_they_are_simulated(self, dataset):
        with_cause = ProblemSettings(vertices=100, causes=("plate-tilt:angle=2",), budget=Budget(8))
        homo, disc = plan(dataset, solvers=["homo", "null:disc"], cloths=["fabric_1"], settings=with_cause)
        assert {"effects", "contact"} <= homo.record()["numerics"].keys()
        assert disc.record()["numerics"].keys() == {"datasets", "metrics", "solver null:disc"}
        apart = ProblemSettings(vertices=100, drape=DrapeSettings(mode="equilibrium", self_contact=1e-3))
        (cell,) = plan(dataset, solvers=["homo"], cloths=["fabric_1"], settings=apart)
        assert "contact" in cell.record()["numerics"]

    def test_a_new_version_of_an_effect_touches_only_cells_with_it(self, dataset, monkeypatch):
        def cell(cause: str) -> Cell:
            settings = ProblemSettings(vertices=100, causes=(cause,), budget=Budget(8))
            return plan(dataset, solvers=["homo"], cloths=["fabric_1"], settings=settings)[0]

        tilted, near = cell("plate-tilt:angle=2"), cell("perspective")
        monkeypatch.setattr(PlateTilt, "version", 2)
        assert dict(cell("plate-tilt:angle=2").numerics) == dict(tilted.numerics) | {"effect plate-tilt": 2}
        assert cell("plate-tilt:angle=2").key != tilted.key
        assert cell("perspective").key == near.key

    def test_shards_are_the_whole_once(self, dataset):
        cells = plan(dataset, solvers=["null:disc", "null:copy"], seeds=[0, 1, 2], settings=SMALL)
        parts = [shard(cells, f"{part}/4") for part in (1, 2, 3, 4)]
        assert sorted(cell.key for part in parts for cell in part) == sorted(cell.key for cell in cells)
        assert max(map(len, parts)) - min(map(len, parts)) <= 1

    @pytest.mark.parametrize("text", ["0/2", "3/2", "1", "a/b", "-1/2", ""])
    def test_shard_must_be_a_fraction(self, text):
        with pytest.raises(RunnerError, match="i/n"):
            shard([], text)

    def test_density_is_needed_before_anything_is_simulated(self, dataset):
        with pytest.raises(CusickError, match=r"areal density.*fabric_2.*fabrics\.csv"):
            plan(dataset, solvers=["null:disc", "homo"], cloths=["fabric_2"], settings=SMALL)
        assert plan(dataset, solvers=["null:disc"], cloths=["fabric_2"], settings=SMALL)

    def test_errors_before_the_start(self, dataset):
        with pytest.raises(CusickError, match="unknown cloth"):
            plan(dataset, solvers=["homo"], cloths=["silk"])
        with pytest.raises(CusickError, match="unknown solver"):
            plan(dataset, solvers=["hobo"])
        with pytest.raises(RunnerError, match="no solver given"):
            plan(dataset, solvers=[])
        with pytest.raises(ProblemError, match="unknown space 'cubic'"):
            ProblemSettings(space="cubic")


class TestCells:
    def test_folder_holds_what_was_asked_done_and_found(self, data, tmp_path):
        (cell,), (result,) = _run(data, tmp_path, ["homo"], command=["cusick-bench", "run"])
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
        (first,), _ = _run(lab, tmp_path / "out", ["sobol"])
        table = lab / "fabrics.csv"
        table.write_text(table.read_text().replace(f",{DENSITY},", ",0.3,"))
        (second,), (result,) = _run(lab, tmp_path / "out", ["sobol"])
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
        (cell,), (result,) = _run(data, tmp_path, ["null:disc"])
        assert result["code"] == code_state()
        other = {"package": "0.1.0", "commit": "0123456789ab", "dirty": True}
        for module in ("cell", "environment"):
            monkeypatch.setattr(f"cusick_bench.runner.{module}.code_state", lambda: other)
        (again,), (kept,) = _run(data, tmp_path, ["null:disc"])
        assert (again.key, kept) == (cell.key, result)
        made = json.loads((tmp_path / "run.json").read_text())
        assert code_text(made, {"metrics": 1}) == "metrics 1; commit 0123456789ab (changed)"
        _, (fresh,) = _run(data, tmp_path, ["null:disc"], seeds=[1])
        assert fresh["code"] == other

    def test_finished_cells_are_not_touched_again(self, data, tmp_path, monkeypatch):
        (cell,), first = _run(data, tmp_path, ["null:disc"])
        stamp = (tmp_path / "cells" / cell.key / "result.json").stat().st_mtime_ns
        monkeypatch.setattr("cusick_bench.runner.execute.run_cell", None)
        _, again = _run(data, tmp_path, ["null:disc"])
        assert again == json.loads(json.dumps(again)) == [json.loads(json.dumps(first[0]))]
        assert (tmp_path / "cells" / cell.key / "result.json").stat().st_mtime_ns == stamp
        assert len(json.loads((tmp_path / "run.json").read_text())["history"]) == 1

    def test_one_failure_stays_alone_and_is_tried_again(self, data, tmp_path, monkeypatch):
        def explode(self, problem, generator, progress):
            problem.observe(np.zeros(39))
            raise ZeroDivisionError("planted")

        with monkeypatch.context() as patch:
            patch.setattr(Homo, "_solve", explode)
            cells, results = _run(data, tmp_path, ["homo", "null:copy"])
        assert [result["status"] for result in results] == ["failed", "done"]
        assert results[0]["failure"] == "ZeroDivisionError: planted"
        assert "explode" in results[0]["traceback"]
        assert results[0]["spent"]["forward"] == 1
        assert not Store(tmp_path).is_done(cells[0].key)
        _, results = _run(data, tmp_path, ["homo", "null:copy"])
        assert [result["status"] for result in results] == ["done", "done"]

    def test_diverging_drapes_fail_the_cell_with_a_reason(self, data, tmp_path):
        settings = ProblemSettings(
            vertices=100, drape=DrapeSettings(mode="equilibrium", iterations=1), budget=Budget(4)
        )
        _, (result,) = _run(data, tmp_path, ["homo"], settings=settings)
        assert result["status"] == "failed"
        assert "did not come to rest" in result["failure"]
        assert result["spent"]["failed"] == result["spent"]["forward"] > 0

    def test_seeds_decide(self, data, tmp_path):
        cells, _ = _run(data, tmp_path, ["null:random-phase,draws=3"], seeds=[0, 1])
        first, second = (load_prediction(tmp_path / "cells" / cell.key)["draws"] for cell in cells)
        assert (first != second).any()

    def test_oracles_are_shown_the_held_out_images(self, data, tmp_path, dataset):
        (mean, repeat), results = _run(data, tmp_path, ["oracle:mean", "oracle:repeat"])
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

    def test_the_end_of_a_generator_behind_an_error_is_no_stop(self, data, tmp_path, dataset, monkeypatch):
        def failing(self, problem, generator, progress):
            raise ValueError("planted") from GeneratorExit()

        monkeypatch.setattr(Homo, "_solve", failing)
        (cell,) = plan(dataset, solvers=["homo"], cloths=["fabric_1"], settings=SMALL)
        store = Store(tmp_path)
        store.prepare()
        assert run_cell(dataset, cell, store, lambda *_: None)["failure"] == "ValueError: planted"


class TestKill:
    def test_killed_process_resumes_to_the_same_numbers(self, data, tmp_path):
        """kill -9 in the middle of a fit, then the same command again."""
        (cell,), _ = _run(data, tmp_path / "whole", ["homo"])
        command = [sys.executable, "-m", "cusick_bench.cli", *_arguments(data, tmp_path / "killed", "homo")]
        process = subprocess.Popen(command, stderr=subprocess.DEVNULL, env=os.environ | {"NUMBA_NUM_THREADS": "1"})
        trace = tmp_path / "killed" / "cells" / cell.key / "trace.jsonl"
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline and process.poll() is None:
            if trace.exists() and trace.read_text().count("\n") >= 2:
                break
            time.sleep(0.002)
        process.kill()
        assert process.wait() == -signal.SIGKILL, "it ended by itself"
        assert trace.exists()
        assert not (trace.parent / "done").exists(), "killed too late to prove anything"
        _run(data, tmp_path / "killed", ["homo"])
        assert _numbers(trace.parent) == _numbers(tmp_path / "whole" / "cells" / cell.key)

    def test_two_runs_of_one_cell_do_not_mix(self, data, tmp_path, dataset):
        (cell,) = plan(dataset, solvers=["null:disc"], cloths=["fabric_1"], settings=SMALL)
        store = Store(tmp_path)
        store.prepare()
        with store.claimed(cell.key), pytest.raises(RunnerError, match="another process is running"):
            run_cell(dataset, cell, store, lambda *_: None)

    @pytest.mark.parametrize("threads", [0, 1])
    def test_a_cell_that_another_process_runs_comes_last(self, data, tmp_path, dataset, monkeypatch, caplog, threads):
        """The others are not kept waiting for it, and it is waited for, in this process as on an executor."""
        monkeypatch.setattr("cusick_bench.runner.executors.turns.WAIT_SECONDS", 0.05)
        (held,) = plan(dataset, solvers=["null:disc"], cloths=["fabric_1"], settings=SMALL)
        store, ended = Store(tmp_path), []
        store.prepare()

        class LetGo(Unwatched):
            def end(self, cell: Cell, status: str, failure: str) -> None:
                ended.append(cell.solver)
                other.close()

        with ExitStack() as other, ThreadPoolExecutor(1) as executor:
            other.enter_context(store.claimed(held.key))
            options = {"executor": executor} if threads else {}
            _, results = _run(data, tmp_path, ["null:disc", "null:copy"], watcher=LetGo(), **options)
        assert ended == ["null:copy", "null:disc"]
        assert [result["status"] for result in results] == ["done", "done"]
        (said,) = [record.getMessage() for record in caplog.records]
        assert f"another process is running null:disc on fabric_1, seed 0 (cell {held.key})" in said

    def test_a_cell_that_was_finished_before_it_could_be_claimed_is_left_alone(
        self, data, tmp_path, dataset, monkeypatch
    ):
        (cell,), _ = _run(data, tmp_path, ["null:disc"])
        path, looks, is_done = tmp_path / "cells" / cell.key / "result.json", [], Store.is_done

        def not_at_first(store: Store, key: str) -> bool:
            looks.append(key)
            return len(looks) > 1 and is_done(store, key)

        monkeypatch.setattr(Store, "is_done", not_at_first)
        before = path.stat()
        assert run_cell(dataset, cell, Store(tmp_path), lambda *_: None)["status"] == "done"
        assert (path.stat().st_ino, path.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
        assert len(looks) == 2


def _arguments(data: Path, out: Path, *solvers: str) -> list[str]:
    options = [
        "run",
        "--data",
        str(data),
        "--out",
        str(out),
        "--cloth",
        "fabric_1",
        "--vertices",
        "100",
        "--law",
        "paper",
    ]
    for solver in solvers:
        options += ["--solver", solver]
    return [*options, "--budget", "8", "--steps", "20"]


class TestPool:
    def test_workers_give_the_numbers_of_one_process(self, data, tmp_path):
        cells, _ = _run(data, tmp_path / "one", ["homo", "null:disc"])
        _, results = _run(data, tmp_path / "two", ["homo", "null:disc"], workers=2)
        assert [result["status"] for result in results] == ["done", "done"]
        for cell in cells:
            one, two = (_numbers(tmp_path / name / "cells" / cell.key) for name in ("one", "two"))
            assert two["spent"] == one["spent"]
            assert two["metrics"]["test_mse"] == pytest.approx(one["metrics"]["test_mse"], rel=1e-6)

    def test_workers_do_not_say_again_what_is_odd_about_the_data(self, data, tmp_path, caplog, capfd):
        """Every worker reads the data set, and wrote the reader's warnings between the lines of progress."""
        lab = shutil.copytree(data, tmp_path / "lab")
        shutil.copy(next(lab.glob("data/*/silhouettes/*")), lab / "stray.jpg")
        _run(lab, tmp_path / "run", ["null:disc", "null:copy"], workers=2)
        assert "stray.jpg" in caplog.text
        assert "stray.jpg" not in capfd.readouterr().err

    def test_dead_worker_costs_its_own_cell_only(self, data, tmp_path, monkeypatch):
        """A broken pool loses every cell under way; the innocent ones are run again."""
        monkeypatch.setattr("cusick_bench.runner.executors.pool.process_pool", lambda workers, **settings: _Mortal())
        _, results = _run(data, tmp_path, ["null:copy", "null:disc"], workers=2)
        assert [result["status"] for result in results] == ["failed", "done"]
        assert "Worker process died" in results[0]["failure"]

    def test_the_death_of_a_worker_leaves_the_others_their_pool(self, data, tmp_path, monkeypatch):
        """Cells that were not begun go on in a new pool of all workers; those under way share one process."""
        pools: list[int] = []

        def pool(workers: int, **_) -> _Mortal:
            pools.append(workers)
            return _Mortal()

        monkeypatch.setattr("cusick_bench.runner.executors.pool.process_pool", pool)
        monkeypatch.setattr("cusick_bench.runner.executors.pool.SUBMITTED_AHEAD", 1)
        solvers = ["null:copy", "null:disc", "null:rotation", "null:random-phase,draws=2"]
        _, results = _run(data, tmp_path, solvers, workers=2)
        assert [result["status"] for result in results] == ["failed", "done", "done", "done"]
        assert pools == [2, 1, 1, 2]

    def test_a_cell_that_had_finished_before_its_worker_died_keeps_its_result(self, data, tmp_path):
        """The answer is lost with the worker, but what it has written is not."""
        cells, results = _run(data, tmp_path, ["null:disc"], executor=_Mortal(after=True))
        assert [result["status"] for result in results] == ["done"]
        assert Store(tmp_path).is_done(cells[0].key)

    def test_number_of_workers(self, data, tmp_path):
        with pytest.raises(RunnerError, match="workers must be >= 1"):
            _run(data, tmp_path, ["null:disc"], workers=0)


def test_threads_of_an_executor_run_one_cell_at_a_time(data, tmp_path, monkeypatch):
    """They share simulators and the random numbers of libraries: side by side, cells had other numbers every time."""
    at_once: list[int] = []
    running = 0

    def watched(*arguments):
        nonlocal running
        running += 1
        at_once.append(running)
        time.sleep(0.05)
        running -= 1
        return run_cell(*arguments)

    monkeypatch.setattr("cusick_bench.runner.executors.pool.run_cell", watched)
    with ThreadPoolExecutor(3) as threads:
        _, results = _run(data, tmp_path, ["null:disc", "null:copy"], seeds=[0, 1], executor=threads)
    assert [result["status"] for result in results] == ["done"] * 4
    assert at_once == [1] * 4


class _Mortal(Executor):
    """A pool that dies of every null:copy cell, and takes along what else it was given.

    Or, with `after`, of every cell, right after that was finished.
    """

    def __init__(self, *, after: bool = False):
        self.broken, self.after = False, after

    def submit(self, function, /, *arguments, **options):
        future: Future = Future()
        if self.after:
            function(*arguments, **options)
        self.broken = self.broken or self.after or arguments[1].solver == "null:copy"
        if self.broken:
            future.set_exception(BrokenProcessPool("planted"))
        else:
            future.set_result(function(*arguments, **options))
        return future


class TestDisk:
    def test_unwritable_output_is_found_first(self, data, tmp_path, monkeypatch):
        file = tmp_path / "file"
        file.write_text("")
        monkeypatch.setattr("cusick_bench.runner.execute.run_cell", None)
        with pytest.raises(RunnerError, match=r"is \(or lies under\) a file"):
            _run(data, file, ["null:disc"])

    @pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
    def test_forbidden_output(self, data, tmp_path):
        tmp_path.chmod(0o500)
        with pytest.raises(RunnerError, match=r"Permission denied.*--out"):
            _run(data, tmp_path / "out", ["null:disc"])

    def test_full_disk_ends_the_grid_and_loses_nothing(self, data, tmp_path, monkeypatch):
        _run(data, tmp_path, ["null:disc"])
        device = Path("/dev/full")
        if not device.exists():
            pytest.skip("no /dev/full on this system")

        def full(file, **arrays):
            with device.open("wb", buffering=0) as file:
                file.write(b"x")

        with monkeypatch.context() as patch:
            patch.setattr(np, "savez_compressed", full)
            with pytest.raises(RunnerError, match=r"No space left.*finished cells are kept"):
                _run(data, tmp_path, ["null:disc", "null:copy"])
        _, results = _run(data, tmp_path, ["null:disc", "null:copy"])
        assert [result["status"] for result in results] == ["done", "done"]


class TestCommand:
    def test_run_prints_one_document(self, data, tmp_path):
        result = CliRunner().invoke(app, [*_arguments(data, tmp_path, "homo", "null:copy"), "--json"])
        assert result.exit_code == 0, result.output
        cells = json.loads(result.stdout)["cells"]
        assert [cell["solver"] for cell in cells] == ["homo", "null:copy"]
        for cell in cells:
            assert cell["status"] == "done"
            assert Path(cell["path"], "done").exists()
            assert {"cloth", "seed", "train_mse", "test_mse", "hausdorff_m", "seconds"} <= cell.keys()
        assert 0 < cells[0]["forward_equivalents"] <= 8
        assert cells[1]["train_mse"] == pytest.approx(0, abs=1e-12)

    def test_failed_cell_is_exit_status_1(self, data, tmp_path):
        result = CliRunner().invoke(app, _arguments(data, tmp_path, "oracle:repeat"))
        assert result.exit_code == 1

    @pytest.mark.parametrize(
        ("extra", "message"),
        [
            (["--solver", "hobo"], "unknown solver"),
            (["--budget", "0"], "greater than or equal to 1"),
            (["--shard", "5/4"], "i/n"),
            (["--executor", "cloud"], "unknown executor"),
            (["--law", "hooke"], "law"),
            (["--data", "/nowhere"], "/nowhere"),
            (["--cloth", "silk"], "unknown cloth"),
        ],
    )
    def test_bad_usage_is_exit_status_2(self, data, tmp_path, extra, message):
        result = CliRunner().invoke(app, [*_arguments(data, tmp_path, "homo"), *extra])
        assert result.exit_code == 2, result.output
        assert message in result.stderr
        assert not list(tmp_path.glob("cells/*/trace.jsonl"))

    def test_solvers_are_listed(self):
        result = CliRunner().invoke(app, ["solvers", "--json"])
        rows = {row["name"]: row for row in json.loads(result.stdout)["solvers"]}
        assert rows["homo"]["needs_gradient"]
        assert rows["null:random-phase"]["options"] == {"draws": 1000}
        assert {"nlopt:LD_LBFGS", "nlopt:LN_BOBYQA", "oracle:mean"} <= rows.keys()
