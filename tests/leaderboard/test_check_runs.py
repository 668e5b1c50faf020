"""The regression check on runs of real solvers on small cloths."""

import json
import shutil
from pathlib import Path

import numba
import pandas as pd
import pytest
from typer.testing import CliRunner

from cusick_bench import metrics
from cusick_bench.cli import app
from cusick_bench.datasets import load
from cusick_bench.leaderboard.cells.loading import load_cells
from cusick_bench.leaderboard.cells.variants import variants
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.leaderboard.gate.baseline import read_cells, write_baseline
from cusick_bench.leaderboard.gate.check import Gate, check
from cusick_bench.problem import Budget
from cusick_bench.runner import ProblemSettings, Source, Store, plan, run, shard
from cusick_bench.runner.labels import numerics_text
from cusick_bench.sim.engine.settings import DrapeSettings

pytestmark = pytest.mark.usefixtures("fewer_permutations")

CLOTHS_RUN = 4


@pytest.fixture(scope="module")
def lab(make_lab) -> Path:
    """Small cloths of four stiffnesses, two samples each."""
    return make_lab([0.7 * fabric for fabric in range(1, CLOTHS_RUN + 1)], samples=2)


def solve(
    lab: Path, out: Path, seeds: list[int], solvers=("homo,search=2", "null:random-phase,draws=10"), **options
) -> Path:
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    settings = ProblemSettings(vertices=100, drape=DrapeSettings(steps=20), budget=Budget(4))
    run(Source(str(lab)), plan(load(lab), solvers=list(solvers), seeds=seeds, settings=settings, **options), out)
    numba.set_num_threads(before)
    return out


@pytest.fixture(scope="module")
def first(lab, tmp_path_factory) -> Path:
    return solve(lab, tmp_path_factory.mktemp("first"), [0])


class TestRun:
    """The gate on runs of real solvers on small cloths."""

    def test_a_baseline_is_made_of_one_look_at_each_cell(self, first, tmp_path, monkeypatch):
        """Predictions are hashed at that, and were hashed twice."""
        looked_at, changed = [], Store.changed

        def counted(store, key, *names):
            looked_at.append(key)
            return changed(store, key, *names)

        monkeypatch.setattr(Store, "changed", counted)
        words = ["check", str(first), "--against", str(tmp_path / "baseline.csv"), "--write"]
        assert CliRunner().invoke(app, words).exit_code == 0
        assert sorted(looked_at) == sorted(path.name for path in (first / "cells").iterdir())
        assert "# command:" in (tmp_path / "baseline.csv").read_text()

    def test_a_rerun_with_another_seed_passes_and_five_per_cent_do_not(self, lab, first, tmp_path):
        other = solve(lab, tmp_path / "other", [7])
        baseline = read_cells(first)
        assert not check(read_cells(other), baseline).regressions
        for path in other.glob("cells/*/result.json"):
            result = json.loads(path.read_text())
            if result["solver"].startswith("homo"):
                result["metrics"]["train_mse"] *= 1.05
                path.write_text(json.dumps(result))
                Store(other).mark_done(path.parent.name)
        found = check(read_cells(other), baseline).regressions
        assert [(finding.solver, finding.metric) for finding in found] == [("homo,search=2", "train_mse")]

    def test_failures_now_are_regressions(self, first, tmp_path):
        failing = Path(shutil.copytree(first, tmp_path / "failing"))
        for path in failing.glob("cells/*/result.json"):
            result = json.loads(path.read_text())
            if (result["solver"], result["cloth"]) == ("homo,search=2", "fabric_2"):
                path.write_text(json.dumps(result | {"status": "failed", "failure": "boom", "metrics": {}}))
                (path.parent / "done").unlink()
        (finding,) = check(read_cells(failing), read_cells(first)).regressions
        assert (finding.solver, finding.metric) == ("homo,search=2", "cells")

    def test_cells_of_older_code_in_the_same_folder_do_not_count(self, lab, tmp_path, monkeypatch):
        with monkeypatch.context() as patch:
            patch.setattr("cusick_bench.metrics.NUMERICS_VERSION", 0)
            folder = solve(lab, tmp_path / "both", [0], ["null:disc"])
        solve(lab, folder, [0], ["null:disc"])
        assert len(list(folder.glob("cells/*"))) == 2 * CLOTHS_RUN
        versions = {"datasets": 1, "metrics": metrics.NUMERICS_VERSION, "solver null:disc": 1}
        assert set(read_cells(folder)["code_version"]) == {numerics_text(versions)}
        solve(lab, folder, [0], ["null:copy"])  # a later command, which asks for other cells
        table = read_cells(folder)
        assert set(table.loc[table["solver"] == "null:disc", "code_version"]) == {numerics_text(versions)}
        assert len(table) == 2 * CLOTHS_RUN

    def test_seeds_of_older_code_that_were_not_repeated_do_not_count(self, lab, tmp_path, monkeypatch):
        few = "null:random-phase,draws=20"
        with monkeypatch.context() as patch:
            patch.setattr("cusick_bench.metrics.NUMERICS_VERSION", 0)
            folder = solve(lab, tmp_path / "both", [0, 1], [few, "null:disc"])
        before = read_cells(folder)
        assert set(before["seed"]) == {0, 1}
        solve(lab, folder, [0], [few])
        table = read_cells(folder)
        assert set(table.loc[table["solver"] == few, "seed"]) == {0}
        others = [one.loc[one["solver"] == "null:disc"].reset_index(drop=True) for one in (before, table)]
        assert others[0].equals(others[1])

    def test_cells_of_older_code_do_not_stand_for_what_a_stopped_run_lacks(self, lab, tmp_path, monkeypatch):
        """As in a folder that continuous integration keeps from commit to commit."""
        with monkeypatch.context() as patch:
            patch.setattr("cusick_bench.metrics.NUMERICS_VERSION", 0)
            folder = solve(lab, tmp_path / "both", [0], ["null:disc"])
        old = set(folder.glob("cells/*"))
        new = set(solve(lab, folder, [0], ["null:disc"]).glob("cells/*")) - old
        assert len(read_cells(folder)) == CLOTHS_RUN
        shutil.rmtree(new.pop())
        with pytest.raises(LeaderboardError, match=r"is not finished: 1 cells were cut off or not begun.*repeat"):
            read_cells(folder)

    def test_a_part_of_the_grid_that_was_stopped_is_not_made_up_for_by_another_part(self, lab, tmp_path):
        cells = plan(load(lab), solvers=["null:disc", "null:copy"], settings=ProblemSettings(vertices=97))
        folder = tmp_path / "shards"
        run(Source(str(lab)), shard(cells, "1/2"), folder, grid=cells)
        with pytest.raises(LeaderboardError, match=f"{len(cells) // 2} cells .* not begun, such as {cells[1].key}"):
            read_cells(folder)
        run(Source(str(lab)), shard(cells, "2/2"), folder, grid=cells)
        assert len(read_cells(folder)) == len(cells)
        shutil.rmtree(folder / "cells" / cells[0].key)  # as where it was never begun
        with pytest.raises(LeaderboardError, match=rf"is not finished: 1 cells .* such as {cells[0].key}"):
            read_cells(folder)

    def test_a_damaged_cell_of_a_run_ends_with_status_2(self, first, tmp_path):
        run = Path(shutil.copytree(first, tmp_path / "run"))
        path = next(run.glob("cells/*/result.json"))
        result = json.loads(path.read_text())
        path.write_text(json.dumps(result | {"metrics": result["metrics"] | {"train_mse": -1e9}}))
        result = CliRunner().invoke(app, ["check", str(run), "--against", str(first)])
        assert result.exit_code == 2, result.output
        assert f"{path}: train_mse must lie in [0, 1]" in " ".join(result.output.split())


@pytest.fixture(scope="module")
def left_out(lab, tmp_path_factory) -> Path:
    solvers = ["null:copy", "null:disc"]
    return solve(lab, tmp_path_factory.mktemp("left-out"), [0], solvers, protocol="leave-one-sample-out")


class TestLeftOut:
    """Samples that are left out in turn: each is a cell of its own."""

    def test_cells_whose_samples_show_other_faces_are_of_one_code(self, lab, tmp_path):
        """Some cells train on both faces or are scored on repeats, others of the same run do not."""
        own = Path(shutil.copytree(lab, tmp_path / "own"))
        up = own / "data" / "Fabric 1" / "silhouettes" / "Fabric_1_Sample_1_Capture_1.jpg"
        shutil.copy(up, up.with_name("Fabric_1_Sample_1_Capture_3.jpg"))
        folder = solve(own, tmp_path / "run", [0], ["null:disc"], protocol="leave-one-sample-out")
        table = load_cells(folder).table
        assert len(set(table["code_version"])) == 3
        ((name, group),) = variants(table)
        assert name == ("null:disc", "")
        assert len(group) == 2 * CLOTHS_RUN
        assert set(group["code_version"]) == {
            f"both faces 1, datasets 1, metrics {metrics.NUMERICS_VERSION}, repeats 1, solver null:disc 1"
        }
        solve(own, folder, [0], ["null:disc"], protocol="leave-one-sample-out", cloths=["fabric_2"])
        assert len(read_cells(folder)) == 2 * CLOTHS_RUN

    def test_each_is_compared_with_itself(self, left_out, tmp_path):
        baseline = tmp_path / "baseline.csv"
        write_baseline(read_cells(left_out), baseline, [])
        table = read_cells(baseline)
        assert len(table) == 2 * 2 * CLOTHS_RUN
        assert table.groupby(["solver", "cloth"])["left_out"].agg(list).map(sorted).map([1, 2].__eq__).all(), "samples"
        assert check(read_cells(left_out), table.sample(frac=1, random_state=0)).regressions == []
        swapped = table.copy()
        for _, rows in table.groupby(["solver", "cloth"]).indices.items():
            swapped.loc[rows, "test_mse"] = table["test_mse"].to_numpy()[rows[::-1]]
        outcome = check(swapped, table, Gate(("test_mse",)))
        (disc,) = (finding for finding in outcome.findings if finding.solver == "null:disc")
        assert disc.comparison is not None
        assert disc.comparison.units == 2 * CLOTHS_RUN
        assert disc.ratio.low < 0.999 < 1.001 < disc.ratio.high  # some are worse, as many are better

    def test_data_that_have_changed_tell_no_numbers_of_samples(self, lab, tmp_path):
        """Rows of the index have moved: other samples were named, and of rows that are gone there was a traceback."""
        own, cloths = Path(shutil.copytree(lab, tmp_path / "own")), ["fabric_2", "fabric_3"]
        folder = solve(own, tmp_path / "run", [0], ["null:disc"], protocol="leave-one-sample-out", cloths=cloths)
        columns = ["solver", "cloth", "seed", "left_out", "test_mse"]

        def numbers() -> pd.DataFrame:
            return read_cells(folder)[columns].sort_values(columns, ignore_index=True)

        before = numbers()
        shutil.rmtree(own / "data" / "Fabric 1")
        with pytest.raises(LeaderboardError, match=r"own must be the data of .*, since they tell which samples"):
            read_cells(folder)
        solve(own, folder, [0], ["null:disc"], protocol="leave-one-sample-out", cloths=cloths)
        assert numbers().equals(before), "of the data as they are now"

    def test_one_split_is_not_compared_with_it(self, left_out):
        table = read_cells(left_out)
        one = table.groupby(["solver", "cloth"], as_index=False).first().drop(columns=["left_out", "protocol"])
        for now, then in ((table, one), (one, table)):
            with pytest.raises(LeaderboardError, match=r"must have .* as in the baseline, got .*--protocol"):
                check(now, then, Gate(("test_mse",)))

    def test_splits_are_named_in_full(self, left_out):
        table = read_cells(left_out)
        for now, then in ((table, table.assign(protocol="paper")), (table.assign(protocol="paper"), table)):
            with pytest.raises(LeaderboardError, match=r"leave-one-sample-out[,;]"):
                check(now, then, Gate(("test_mse",)))

    def test_what_gets_worse_is_seen(self, left_out, tmp_path):
        table = read_cells(left_out)
        worse = table.assign(test_mse=table["test_mse"].where(table["solver"] != "null:copy", 1.05 * table["test_mse"]))
        found = check(worse, table, Gate(("test_mse",))).regressions
        assert [finding.solver for finding in found] == ["null:copy"]

    def test_a_run_that_was_cut_off_is_refused(self, left_out, tmp_path):
        """Also where two samples of one cloth and seed are not finished, which are not the same cell twice."""
        run = Path(shutil.copytree(left_out, tmp_path / "run"))
        for path in run.glob("cells/*/result.json"):
            result = json.loads(path.read_text())
            if (result["solver"], result["cloth"]) == ("null:disc", "fabric_2"):
                path.unlink()
        with pytest.raises(LeaderboardError, match=r"is not finished: 2 cells were cut off"):
            read_cells(run)

    def test_the_table_of_all_cells_is_compared_like_the_run(self, left_out, tmp_path):
        """It told no samples, so that it seemed to hold cells twice; its number of samples seemed to be a metric."""
        cells = tmp_path / "cells.csv"
        result = CliRunner().invoke(app, ["leaderboard", str(left_out), "--cells", str(cells)])
        assert result.exit_code == 0, result.output
        columns = ["solver", "cloth", "seed", "left_out", "settings", "test_mse"]
        order = ["solver", "cloth", "left_out"]
        tables = [read_cells(path)[columns].sort_values(order, ignore_index=True) for path in (cells, left_out)]
        pd.testing.assert_frame_equal(*tables, rtol=1e-12)
        for path in (cells, left_out):
            write_baseline(read_cells(path), tmp_path / f"{path.stem}-baseline.csv", [])
        heads = [
            set(baseline.read_text().partition("\n")[0].split(",")) for baseline in tmp_path.glob("*-baseline.csv")
        ]
        assert heads[0] == heads[1] >= {"left_out", "test_mse"}

    def test_a_table_of_all_cells_without_the_data_says_what_it_lacks(self, lab, tmp_path):
        own, cells = Path(shutil.copytree(lab, tmp_path / "own")), tmp_path / "cells.csv"
        folder = solve(own, tmp_path / "run", [0], ["null:disc"], protocol="leave-one-sample-out")
        shutil.rmtree(own)
        result = CliRunner().invoke(app, ["leaderboard", str(folder), "--cells", str(cells)])
        assert result.exit_code == 0, result.output
        assert "which samples were left out cannot be told" in " ".join(result.output.split())
        with pytest.raises(LeaderboardError, match=r"more than once; give the numbers of the samples .* left_out"):
            read_cells(cells)

    def test_a_sample_that_is_there_twice_is_refused(self, left_out, tmp_path):
        table = read_cells(left_out)
        write_baseline(pd.concat([table, table.iloc[:1]]), tmp_path / "twice.csv", [])
        with pytest.raises(LeaderboardError, match="more than once"):
            read_cells(tmp_path / "twice.csv")
