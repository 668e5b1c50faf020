"""`cusick-bench check`: its exit status, its table, and bad input."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_up_runs import METRICS, cells
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.leaderboard.gate.baseline import read_cells, settings_digest, write_baseline

pytestmark = pytest.mark.usefixtures("fewer_permutations")


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

    def test_a_baseline_keeps_every_metric_that_can_be_compared(self, files, tmp_path):
        run, baseline = files
        table = read_cells(run).assign(test_dc_crps=lambda t: 3 * t["test_mse"], test_dc_cover_90=0.9, train_dc=0.4)
        worse = table.assign(test_dc_crps=lambda t: 1.2 * t["test_dc_crps"])
        for name, one in (("run", table), ("worse", worse)):
            document = {"cells": one.drop(columns="repeat").to_dict("records")}
            (tmp_path / f"{name}.json").write_text(json.dumps(document))
        assert self.check(tmp_path / "run.json", "--against", baseline, "--write")[0] == 0
        kept = {name for name in read_cells(baseline) if name.startswith(("train_", "test_"))}
        assert kept == {*METRICS, "test_dc_crps"}
        assert self.check(tmp_path / "run.json", "--against", baseline, "--metric", "crps")[0] == 0
        assert self.check(tmp_path / "worse.json", "--against", baseline, "--metric", "crps")[0] == 1

    @pytest.mark.parametrize("form", ["json", "csv"])
    def test_settings_in_full_are_those_of_a_baseline(self, tmp_path, form):
        """A `result.json` has them as an object, a table of `leaderboard --cells` as the text of one."""
        settings = {"vertices": 97, "budget": {"seconds": None, "forward_equivalents": 8.0}}
        text = json.dumps(settings, sort_keys=True)
        cells = [
            {"solver": "s", "cloth": cloth, "seed": 0, "train_mse": 0.01, "protocol": "paper"}
            for cloth in ("a", "b", "c")
        ]
        baseline, run = tmp_path / "baseline.csv", tmp_path / f"run.{form}"
        write_baseline(pd.DataFrame([cell | {"settings": settings_digest(text)} for cell in cells]), baseline, [])
        for given, status in ((settings, 0), (settings | {"vertices": 150}, 2)):
            if form == "json":
                run.write_text(json.dumps({"cells": [cell | {"settings": given} for cell in cells]}))
            else:
                full = [cell | {"settings": json.dumps(given, sort_keys=True)} for cell in cells]
                pd.DataFrame(full).to_csv(run, index=False)
            result = CliRunner().invoke(app, ["check", str(run), "--against", str(baseline)])
            assert result.exit_code == status, result.output
        assert "s must have the baseline's settings" in " ".join(result.output.split())
        assert self.check(run, "--against", run)[0] == 0

    def test_a_leaderboard_is_no_table_of_cells(self, tmp_path):
        (tmp_path / "board.csv").write_text("solver,rank,cloths,test_mse\nhomo,1,a b,0.05\n")
        with pytest.raises(LeaderboardError, match="a line a solver, not a cell"):
            read_cells(tmp_path / "board.csv")

    def test_the_same_cell_twice_is_refused(self, files, tmp_path):
        table = read_cells(files[0])
        write_baseline(pd.concat([table, table.iloc[:1]]), tmp_path / "double.csv", [])
        with pytest.raises(LeaderboardError, match="more than once; keep one of them, or give repeats seeds"):
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

    def test_a_metric_that_this_project_does_not_know_is_said_to_be_better_where_smaller(self, tmp_path):
        """An accuracy that had halved was no regression, and nothing said why."""
        for name, factor in (("run", 0.5), ("baseline", 1.0)):
            lines = [f"a,{cloth},0,{factor * value}" for cloth, value in (("x", 0.9), ("y", 0.8), ("z", 0.7))]
            (tmp_path / f"{name}.csv").write_text("\n".join(["solver,cloth,seed,test_accuracy", *lines]) + "\n")
        words = (tmp_path / "run.csv", "--against", tmp_path / "baseline.csv")
        status, document = self.check(*words, "--metric", "accuracy")
        assert status == 0
        (told,) = (note for note in document["notes"] if "Smaller" in note)
        assert told.startswith("Smaller is taken to be better in test_accuracy; ")
        status, refused = self.check(*words)
        assert status == 2
        assert "both hold only test_accuracy" in " ".join(refused["error"].split())

    @pytest.mark.parametrize("options", [[], ["--metric", "mse"]])
    def test_a_table_without_a_metric_is_told_what_names_metrics_have(self, tmp_path, options):
        """It said `known are: ` and nothing."""
        (tmp_path / "run.csv").write_text("solver,cloth,seed,mse\na,x,0,0.02\n")
        result = CliRunner().invoke(
            app, ["check", str(tmp_path / "run.csv"), "--against", str(tmp_path / "run.csv"), *options]
        )
        assert result.exit_code == 2
        assert "none (a metric is a column whose name begins with train_ or test_)" in " ".join(result.output.split())

    def test_help_says_what_the_statuses_mean(self):
        text = " ".join(CliRunner().invoke(app, ["check", "--help"]).output.split())
        assert "3 if nothing could be decided" in text
