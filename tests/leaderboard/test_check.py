"""The regression gate: it sees a planted 5 % degradation, and cries wolf no more often than it says."""

import json
import shutil
from pathlib import Path

import numba
import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from cusick_bench import metrics
from cusick_bench.cli import app
from cusick_bench.datasets import load
from cusick_bench.leaderboard.cells.cell_number import SEEDS
from cusick_bench.leaderboard.cells.loading import load_cells
from cusick_bench.leaderboard.cells.variants import variants
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.leaderboard.gate import paired
from cusick_bench.leaderboard.gate.baseline import read_cells, write_baseline
from cusick_bench.leaderboard.gate.check import Gate, check
from cusick_bench.leaderboard.gate.paired import compare, holm
from cusick_bench.problem import Budget
from cusick_bench.runner import ProblemSettings, Source, Store, plan, run, shard
from cusick_bench.runner.labels import numerics_text
from cusick_bench.sim.engine.settings import DrapeSettings

CLOTHS = ("a", "b", "c", "d", "e")
METRICS = ("train_mse", "test_mse")
SOLVERS = ("sampler", "noisy", "exact")
NOISE = {"sampler": 0.03, "noisy": 0.10, "exact": 0.0}  # of a metric, between seeds


def cells(seeds, generator: np.random.Generator, worse: dict[str, float] | None = None) -> pd.DataFrame:
    """A run whose solvers differ in how much seeds matter; cloths differ fivefold in difficulty."""
    rows = []
    for solver in SOLVERS:
        for place, cloth in enumerate(CLOTHS):
            for seed in seeds:
                factor = (worse or {}).get(solver, 1.0)
                values = {m: 0.01 * (1 + place) * factor * np.exp(NOISE[solver] * generator.normal()) for m in METRICS}
                rows.append({"solver": solver, "cloth": cloth, "seed": seed, "status": "done", **values})
    return pd.DataFrame(rows)


def verdicts(outcome) -> dict[tuple[str, str], str]:
    return {(finding.solver, finding.metric): finding.verdict for finding in outcome.findings}


@pytest.fixture(scope="module", autouse=True)
def _fewer_permutations():
    patch = pytest.MonkeyPatch()
    patch.setattr(paired, "PERMUTATIONS", 2000)
    yield
    patch.undo()


class TestStatistics:
    def test_the_interval_of_a_ratio_may_hold_1_whichever_way_all_cloths_went(self):
        generator = np.random.default_rng(0)
        before = {(cloth, 0): 1.0 for cloth in "abc"}
        after = {("a", 0): 1.05, ("b", 0): 3.0, ("c", 0): 1.1}
        worse = compare(before, after, level=0.05, generator=generator).ratio
        better = compare(after, before, level=0.05, generator=generator).ratio
        assert worse.low < 0.9
        assert better.high > 1.1

    def test_the_ratio_is_a_mean_over_cloths_however_many_seeds_each_has(self):
        changes = {("a", seed): 1 + 1e-3 * seed for seed in range(2)} | {
            ("b", seed): 2 + 1e-3 * seed for seed in range(6)
        }
        ratio = compare(dict.fromkeys(changes, 1.0), changes, level=0.05, generator=np.random.default_rng(0)).ratio
        assert ratio.value == pytest.approx(2**0.5, rel=2e-3)
        assert ratio.low < ratio.value < ratio.high

    def test_seeds_of_a_left_out_sample_do_not_narrow_the_interval_of_the_ratio(self):
        def width(seeds: int) -> float:
            factors = (
                (split * SEEDS + seed, one + 1e-4 * seed)
                for split, one in enumerate((1.0, 1.2, 1.5))
                for seed in range(seeds)
            )
            after = {("a", number): factor for number, factor in factors}
            found = compare(dict.fromkeys(after, 1.0), after, level=0.05, generator=np.random.default_rng(0))
            return found.ratio.high / found.ratio.low

        assert width(8) == pytest.approx(width(1), rel=0.02)

    @pytest.mark.parametrize(("old", "new"), [((0, 1, 2), (10, 11, 12)), ((0, 1), (0, 1)), ((0,), (7,))])
    def test_reruns_pass_as_often_as_promised(self, old, new):
        """120 reruns of the same code: at 5 % more than 13 alarms would come by chance once in 250 trials."""
        generator = np.random.default_rng([1, len(old)])
        alarms = sum(
            bool(check(cells(new, generator), cells(old, generator), Gate(METRICS)).regressions) for _ in range(120)
        )
        assert alarms <= 13

    @pytest.mark.parametrize("new", [(0, 1, 2), (10, 11, 12)])
    def test_five_per_cent_are_seen_through_three_per_cent_of_noise(self, new):
        generator = np.random.default_rng(2)
        seen = 0
        for _ in range(20):
            outcome = check(cells(new, generator, {"sampler": 1.05}), cells((0, 1, 2), generator), Gate(METRICS))
            seen += any(finding.solver == "sampler" for finding in outcome.regressions)
        assert seen >= 18

    def test_what_seeds_do_not_move_is_seen_at_once_and_blamed_alone(self):
        generator = np.random.default_rng(3)
        before, after = cells((0,), generator), cells((5,), generator, {"exact": 1.05})
        found = check(after, before, Gate(METRICS)).regressions
        assert {finding.solver for finding in found} == {"exact"}
        assert {finding.metric for finding in found} == set(METRICS)
        assert found[0].ratio.value == pytest.approx(1.05)

    @pytest.mark.parametrize(("factor", "expected"), [(1.015, "unchanged"), (0.9, "unchanged"), (1.03, "regression")])
    def test_small_changes_and_better_ones_are_none(self, factor, expected):
        generator = np.random.default_rng(4)
        outcome = check(cells((0,), generator, {"exact": factor}), cells((0,), generator), Gate(METRICS))
        assert verdicts(outcome)["exact", "test_mse"] == expected

    def test_repeated_seeds_that_change_nothing_count_once(self):
        before = {("a", seed): 1.0 for seed in range(9)} | {("b", seed): 2.0 for seed in range(9)}
        after = {(cloth, seed): value for cloth, value in (("a", 1.1), ("b", 1.9)) for seed in range(9)}
        found = compare(before, after, level=0.01, generator=np.random.default_rng(0))
        assert (found.units, found.test) == (2, "t")
        assert found.p > 0.1

    def test_seeds_of_a_left_out_sample_that_change_nothing_count_once(self):
        changes = dict(enumerate((1.1, 1.02, 1.05, 0.99)))
        before = {("a", split * SEEDS + seed): 1.0 + split for split in changes for seed in range(9)}
        after = {(cloth, number): value * changes[number // SEEDS] for (cloth, number), value in before.items()}
        found = compare(before, after, level=0.01, generator=np.random.default_rng(0))
        assert (found.units, found.test) == (4, "t")
        assert found.p > 0.05

    def test_students_t_is_about_the_mean_over_cloths_however_many_seeds_each_has(self):
        """One cloth half as bad again, four seeds of the other a seventh better: worse in the mean over cloths."""
        after = {("a", 0): 1.5} | {("b", seed): 0.86 + 0.005 * seed for seed in range(4)}
        before = dict.fromkeys(after, 1.0)
        worse, better = (
            compare(*pair, level=0.01, generator=np.random.default_rng(0))
            for pair in ((before, after), (after, before))
        )
        assert (worse.test, worse.units) == ("t", 5)
        assert worse.ratio.value > 1.1
        assert worse.p < 0.25
        assert worse.p + better.p == pytest.approx(1.0)

    def test_permutations_are_exact_where_all_can_be_counted(self):
        """Fourteen cloths all worse: one arrangement of 2^14 is as extreme."""
        generator = np.random.default_rng(5)
        before = {(str(cloth), 0): 1.0 for cloth in range(14)}
        after = {(str(cloth), 0): 1.0 + generator.uniform(0.01, 0.1) for cloth in range(14)}
        paired_p = compare(before, after, level=0.05, generator=generator).p
        mixed = {cell: value if int(cell[0]) % 2 else 2 - value for cell, value in after.items()}
        assert paired_p <= 2 / 2001
        assert 0.05 < compare(before, mixed, level=0.05, generator=generator).p < 0.95

    def test_holm_multiplies_by_what_is_left(self):
        assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
        adjusted = holm([0.01, float("nan")])
        assert adjusted[0] == pytest.approx(0.01)
        assert np.isnan(adjusted[1])

    def test_one_cell_decides_nothing_and_says_so(self):
        before = pd.DataFrame([{"solver": "s", "cloth": "a", "seed": 0, "status": "done", "train_mse": 0.01}])
        outcome = check(before.assign(train_mse=0.02), before, Gate(("train_mse",)))
        assert verdicts(outcome) == {("s", "train_mse"): "undecided"}
        assert any("Too few cells" in note for note in outcome.notes)
        assert "(Holm over 0 tests," in outcome.notes[0]


class TestCells:
    @pytest.fixture
    def run(self) -> pd.DataFrame:
        return cells((0, 1), np.random.default_rng(6))

    def test_a_solver_that_is_gone_is_a_regression_and_a_new_one_is_none(self, run):
        renamed = run.replace({"solver": {"exact": "exact2"}})
        found = verdicts(check(renamed, run, Gate(METRICS)))
        assert found["exact", "cells"] == "regression"
        assert found["exact2", "cells"] == "new"

    def test_a_missing_cloth_is_a_regression(self, run):
        lost = run.loc[~((run["solver"] == "noisy") & (run["cloth"] == "c"))]
        assert [finding.detail for finding in check(lost, run, Gate(METRICS)).regressions] == ["lacks c"]

    def test_failures_are_a_regression_unless_they_were_as_common_before(self, run):
        failed = run.copy()
        failed.loc[0, ["status", *METRICS]] = ["failed", None, None]
        (finding,) = check(failed, run, Gate(METRICS)).regressions
        assert "1 of 10 cells failed, 0 of 10 in the baseline" in finding.detail
        elsewhere = run.copy()
        elsewhere.loc[1, ["status", *METRICS]] = ["failed", None, None]
        outcome = check(failed, elsewhere, Gate(METRICS))
        assert not outcome.regressions
        assert f"(Holm over {len(SOLVERS) * len(METRICS) + 1} tests," in outcome.notes[0]  # Fisher's is one of them

    def test_new_cloths_and_seeds_are_told_but_not_judged(self, run):
        cell = run[(run["solver"] == "noisy") & (run["cloth"] == "c")].head(1)
        for status, told in (
            ("done", ["new; 0 of 1"]),
            ("failed", ["new; 1 of 1", "seeds not in the baseline; 1 of 1"]),
        ):
            new = [cell.assign(cloth="new", status=status), cell.assign(seed=99, status=status)]
            outcome = check(pd.concat([run, *new], ignore_index=True), run, Gate(METRICS))
            assert outcome.regressions == []
            found = [finding.detail for finding in outcome.findings if finding.verdict == "new"]
            assert len(found) == len(told)
            assert all(words in detail for words, detail in zip(told, sorted(found), strict=True))

    def test_a_cloth_without_shared_seeds_is_judged_as_a_whole(self, run):
        """If other cloths shared theirs, it was said to be none of the baseline's, and its failures did not count."""
        later = run.assign(seed=run["seed"] + 10 * (run["cloth"] == "c"))
        assert not [finding for finding in check(later, run, Gate(METRICS)).findings if finding.metric == "cells"]
        failed = (later["solver"] == "noisy") & (later["seed"] == 10)
        later.loc[failed, ["status", *METRICS]] = ["failed", None, None]
        (finding,) = check(later, run, Gate(METRICS)).regressions
        assert "1 of 10 cells failed, 0 of 10 in the baseline" in finding.detail

    def test_other_data_or_settings_cannot_be_compared(self, run):
        old = run.assign(dataset_hash="abc", settings="one")
        with pytest.raises(LeaderboardError, match="dataset hash abc, got xyz"):
            check(old.assign(dataset_hash="xyz"), old, Gate(METRICS))
        with pytest.raises(LeaderboardError, match=r"settings one, got two.*--write"):
            check(old.assign(settings="two"), old, Gate(METRICS))
        with pytest.raises(LeaderboardError, match=r"protocol first-1, got first-8.*--protocol"):
            check(old.assign(protocol="first-8"), old.assign(protocol="first-1"), Gate(METRICS))

    def test_means_are_of_the_cells_that_are_compared(self):
        before, after = cells((0, 1, 2), np.random.default_rng(1)), cells((1,), np.random.default_rng(2))
        (found,) = (one for one in check(after, before, Gate(("test_mse",))).findings if one.solver == "noisy")
        same = (before["solver"] == "noisy") & (before["seed"] == 1)
        assert found.before == pytest.approx(before.loc[same, "test_mse"].mean())

    @pytest.mark.parametrize("metric", ["test_iou", "test_dc_cover_90", "train_dc_target", "test_fold_p", "draws"])
    def test_metrics_of_which_more_may_be_better_are_refused(self, metric):
        with pytest.raises(LeaderboardError, match=r"smaller is not better|nobody is better or worse"):
            Gate((metric,))


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
        for part in ("1/2", "2/2"):
            command = ["cusick-bench", "run", "--out", "shards", "--shard", part]
            run(Source(str(lab)), shard(cells, part), folder, command=command)
        assert len(read_cells(folder)) == len(cells)
        shutil.rmtree(folder / "cells" / cells[0].key)  # as where it was never begun
        with pytest.raises(LeaderboardError, match=rf"is not finished: 1 cells .* such as {cells[0].key}"):
            read_cells(folder)


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

    def test_a_sample_that_is_there_twice_is_refused(self, left_out, tmp_path):
        table = read_cells(left_out)
        write_baseline(pd.concat([table, table.iloc[:1]]), tmp_path / "twice.csv", [])
        with pytest.raises(LeaderboardError, match="more than once"):
            read_cells(tmp_path / "twice.csv")


class TestCommand:
    @pytest.fixture
    def files(self, tmp_path) -> tuple[Path, Path]:
        """A run and a baseline, as files of another project."""
        table = cells((0, 1, 2), np.random.default_rng(7))
        run = tmp_path / "run.json"
        run.write_text(json.dumps({"cells": table.to_dict("records")}))
        return run, tmp_path / "baseline.csv"

    def check(self, *words) -> tuple[int, dict]:
        result = CliRunner().invoke(app, ["check", *map(str, words), "--json"])
        return result.exit_code, json.loads(result.stdout) if result.stdout else {"error": result.output}

    def test_planted_degradation_ends_with_status_1_and_its_name(self, files, tmp_path):
        run, baseline = files
        assert self.check(run, "--against", baseline, "--write")[0] == 0
        assert self.check(run, "--against", baseline)[0] == 0
        worse = read_cells(run)
        for metric in METRICS:
            worse.loc[worse["solver"] == "sampler", metric] *= 1.05
        write_baseline(worse, tmp_path / "worse.csv", [])
        status, document = self.check(tmp_path / "worse.csv", "--against", baseline)
        assert status == 1
        assert {f["solver"] for f in document["findings"] if f["verdict"] == "regression"} == {"sampler"}
        assert document["regressions"] == 2

    def test_spaces_between_options_make_no_other_solver(self, files, tmp_path):
        run, baseline = files
        table = read_cells(run)
        write_baseline(table.assign(solver=table["solver"] + ", draws = 5"), baseline, [])
        write_baseline(table.assign(solver=table["solver"] + ",draws=5"), tmp_path / "run.csv", [])
        assert self.check(tmp_path / "run.csv", "--against", baseline)[0] == 0

    def test_the_table_says_which(self, files, tmp_path):
        run, baseline = files
        write_baseline(read_cells(run).assign(train_mse=lambda t: t["train_mse"] / 2), baseline, ["command: none"])
        assert baseline.read_text().startswith("# command: none\nsolver,cloth,seed,status,")
        result = CliRunner().invoke(app, ["check", str(run), "--against", str(baseline)])
        assert result.exit_code == 1
        assert "3 regressions" in result.output
        assert result.output.index("regression") < result.output.index("unchanged")

    def test_bad_input_is_said(self, files, tmp_path):
        run, baseline = files
        for words, message in (
            ((run, "--against", baseline), "no baseline at"),
            ((tmp_path / "nothing", "--against", baseline), "no cells at"),
            ((run, "--against", run, "--level", "0.7"), "level must lie between"),
            (
                (run, "--against", run, "--metric", "test_unheard"),
                "unknown metric 'test_unheard'; did you mean 'test_mse'",
            ),
            ((run, "--against", tmp_path / "b.txt", "--write"), "must end in .csv"),
            ((run, "--against", baseline, "--write", "--metric", "mse"), "--write compares nothing"),
            ((run, "--against", baseline, "--write", "--junit", tmp_path / "b.xml"), "--write compares nothing"),
        ):
            result = CliRunner().invoke(app, ["check", *map(str, words)])
            assert result.exit_code == 2
            assert message in " ".join(result.output.split())

    def test_a_leaderboard_is_no_table_of_cells(self, tmp_path):
        (tmp_path / "board.csv").write_text("solver,rank,cloths,test_mse\nhomo,1,a b,0.05\n")
        with pytest.raises(LeaderboardError, match="a line a solver, not a cell"):
            read_cells(tmp_path / "board.csv")

    def test_the_same_cell_twice_is_refused(self, files, tmp_path):
        table = read_cells(files[0])
        write_baseline(pd.concat([table, table.iloc[:1]]), tmp_path / "double.csv", [])
        with pytest.raises(LeaderboardError, match="more than once"):
            read_cells(tmp_path / "double.csv")

    @pytest.mark.parametrize(
        ("line", "message"),
        [
            ("homo,a,0,done,nan", "line 3: train_mse must be finite, got nan"),
            ("homo,a,0,done,inf", "line 3: train_mse must be finite, got inf"),
            ("homo,a,0,done,-1e9", "line 3: train_mse must lie in [0, 1], got -1e+09"),
            ("homo,a,0,done,2", "line 3: train_mse must lie in [0, 1], got 2"),
            ("homo,a,0,done,good", "line 3: train_mse must be a number"),
            ("null,a,0,done,0.01", "line 3: solver must be a name"),
            (",a,0,done,0.01", "line 3: solver must be a name"),
            ("homo,None,0,done,0.01", "line 3: cloth must be a name"),
            ("homo,a,-1,done,0.01", "line 3: seed must be a whole number"),
            ("homo,a,0,perfect,0.01", "line 3: status must be done or failed"),
        ],
    )
    @pytest.mark.parametrize("side", ["run", "baseline"])
    def test_what_no_cell_can_say_ends_with_status_2_and_the_line(self, tmp_path, line, message, side):
        good = "solver,cloth,seed,status,train_mse\nnull:disc,a,0,done,0.02\n"
        for name in ("run", "baseline"):
            (tmp_path / f"{name}.csv").write_text(good + (f"{line}\n" if name == side else ""))
        words = ["check", str(tmp_path / "run.csv"), "--against", str(tmp_path / "baseline.csv")]
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 2, result.output
        assert f"{side}.csv, {message}" in " ".join(result.output.split())

    def test_a_damaged_cell_of_a_run_ends_with_status_2(self, first, tmp_path):
        run = Path(shutil.copytree(first, tmp_path / "run"))
        path = next(run.glob("cells/*/result.json"))
        result = json.loads(path.read_text())
        path.write_text(json.dumps(result | {"metrics": result["metrics"] | {"train_mse": -1e9}}))
        result = CliRunner().invoke(app, ["check", str(run), "--against", str(first)])
        assert result.exit_code == 2, result.output
        assert f"{path}: train_mse must lie in [0, 1]" in " ".join(result.output.split())

    @pytest.mark.parametrize("lacking", ["run", "baseline"])
    def test_a_number_that_only_one_side_has_is_not_passed_over(self, files, tmp_path, lacking):
        table = read_cells(files[0])
        for name in ("run", "baseline"):
            found = table.copy()
            if name == lacking:
                found.loc[0, "train_mse"] = np.nan
            write_baseline(found, tmp_path / f"{name}.csv", [])
        result = CliRunner().invoke(
            app, ["check", str(tmp_path / "run.csv"), "--against", str(tmp_path / "baseline.csv")]
        )
        assert result.exit_code == 2
        assert f"has no train_mse in the {lacking}" in " ".join(result.output.split())

    def test_a_metric_that_the_run_has_lost_is_not_passed_over(self, files, tmp_path):
        """One that the run alone has is no matter: baselines say what is compared."""
        table = read_cells(files[0])
        write_baseline(table, tmp_path / "both.csv", [])
        write_baseline(table.drop(columns="test_mse"), tmp_path / "one.csv", [])
        result = CliRunner().invoke(app, ["check", str(tmp_path / "one.csv"), "--against", str(tmp_path / "both.csv")])
        assert result.exit_code == 2
        assert "the run has no test_mse, and the baseline has" in " ".join(result.output.split())
        assert self.check(tmp_path / "one.csv", "--against", tmp_path / "both.csv", "--metric", "train_mse")[0] == 0
        assert self.check(tmp_path / "both.csv", "--against", tmp_path / "one.csv")[0] == 0

    def test_where_nothing_can_be_decided_the_status_is_3(self, tmp_path):
        cell = {"solver": "s", "cloth": "a", "seed": 0, "status": "done", "train_mse": 0.01}
        write_baseline(pd.DataFrame([cell]), tmp_path / "one.csv", [])
        status, document = self.check(tmp_path / "one.csv", "--against", tmp_path / "one.csv")
        assert (status, document["decided"], document["regressions"]) == (3, False, 0)
        failed = pd.DataFrame([cell | {"status": "failed", "train_mse": None}, cell | {"cloth": "b"}])
        write_baseline(failed, tmp_path / "other.csv", [])
        write_baseline(failed.assign(cloth=["b", "a"]), tmp_path / "apart.csv", [])
        assert self.check(tmp_path / "apart.csv", "--against", tmp_path / "other.csv")[0] == 3

    def test_changes_are_told_as_ratios(self, files, tmp_path):
        """Ten times as large is x 10 and a tenth x 0.1; a symmetric change would say +163.6 and -163.6 %."""
        table = read_cells(files[0])
        write_baseline(table.loc[table["solver"] == "exact"], tmp_path / "before.csv", [])
        for factor in (10.0, 0.1):
            after = table.loc[table["solver"] == "exact"].assign(train_mse=lambda t, f=factor: t["train_mse"] * f)
            write_baseline(after, tmp_path / "after.csv", [])
            words = [tmp_path / "after.csv", "--against", tmp_path / "before.csv", "--metric", "train_mse"]
            (finding,) = self.check(*words)[1]["findings"]
            assert finding["ratio"] == pytest.approx(factor, rel=1e-6)
            shown = CliRunner().invoke(app, ["check", *map(str, words)]).output
            assert f"x {factor:g}" in shown
            assert "%" not in shown.split("could see")[1].split("A regression")[0]

    def test_help_says_what_the_statuses_mean(self):
        text = " ".join(CliRunner().invoke(app, ["check", "--help"]).output.split())
        assert "3 if nothing could be decided" in text
