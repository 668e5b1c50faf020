"""The table of optimisers on test functions: runs are kept, never made twice, and read honestly."""

import json
import shlex
from dataclasses import asdict, replace

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from cusick_bench.benchmark.optimisers import runs
from cusick_bench.benchmark.optimisers.functions import BenchmarkError, branin
from cusick_bench.benchmark.optimisers.runs import PUBLISHED, Finished, Plan, compare, run_numerics
from cusick_bench.benchmark.optimisers.table import REMARKS, RunFile, markdown_table, table_rows
from cusick_bench.cli import app

PLAN = Plan("hartmann6", runs=3, methods=("sobol", "cmaes"))


def finished(method: str, best: float, run: int = 0, function: str = "hartmann6", evaluations: int = 200) -> Finished:
    return Finished(
        function, 100, evaluations, method, run, 0, best, 1.5, run_numerics(function, method), "commit 1a2b3c"
    )


def spread(method: str, mean: float, error: float, runs: int = 16) -> list[Finished]:
    """Runs with exactly that mean and that standard error."""
    noise = np.random.default_rng(0).normal(size=runs)
    noise = (noise - noise.mean()) / noise.std(ddof=1) * error * np.sqrt(runs)
    return [finished(method, float(mean + value), run) for run, value in enumerate(noise)]


class TestRuns:
    def test_no_run_is_made_twice_and_the_numbers_are_those_of_one_go(self, tmp_path, monkeypatch):
        whole = compare(PLAN)
        file, made = RunFile(tmp_path), []
        compare(replace(PLAN, runs=1), keep=file.keep)
        run_once = runs.run_once
        monkeypatch.setattr(runs, "run_once", lambda plan, *words: made.append(words[:2]) or run_once(plan, *words))
        resumed = compare(PLAN, known=file.read(), keep=file.keep)
        assert made == [("sobol", 1), ("cmaes", 1), ("sobol", 2), ("cmaes", 2)]
        assert [row["best"] for row in resumed["methods"]] == [row["best"] for row in whole["methods"]]
        assert len(file.read()) == 6

    def test_other_questions_and_other_numerics_do_not_count(self, tmp_path):
        run = finished("sobol", -2.0)
        assert run.answers(PLAN, "sobol", 0)
        others = [(PLAN, "sobol", 1), (PLAN, "cmaes", 0), (replace(PLAN, seed=1), "sobol", 0)]
        others += [(replace(PLAN, dimension=50), "sobol", 0), (replace(PLAN, evaluations=50), "sobol", 0)]
        assert not any(run.answers(*other) for other in others)
        file = RunFile(tmp_path)
        file.keep(run)
        file.keep(replace(run, run=1, numerics="solver sobol 0, test functions 1"))
        before = {name: value for name, value in asdict(run).items() if name not in ("numerics", "code")}
        with file.path.open("a") as stream:
            stream.write(json.dumps(before | {"code_version": "0.1.0+1a2b3c4d5e6f"}) + "\n")
        assert file.read() == [run]

    def test_a_line_cut_off_is_dropped_and_a_strange_one_is_named(self, tmp_path):
        file = RunFile(tmp_path)
        file.keep(finished("sobol", -2.0))
        with file.path.open("a") as stream:
            stream.write('{"function": "hartm')
        assert len(file.read()) == 1
        file.keep(finished("sobol", -2.1, run=1))
        assert [run.best for run in file.read()] == [-2.0, -2.1]
        file.path.write_text('{"solver": "homo"}\n')
        with pytest.raises(BenchmarkError, match="line 1 is no finished run"):
            file.read()

    def test_a_line_of_another_process_is_neither_glued_to_one_cut_off_nor_lost(self, tmp_path):
        """One that a full disk has stopped left half a line; the other goes on, and the first is begun again."""
        file, going_on = RunFile(tmp_path), RunFile(tmp_path)
        file.keep(finished("sobol", -2.0))
        with file.path.open("a") as stream:
            stream.write('{"function": "hartm')
        before = file.path.read_bytes()
        assert len(file.read()) == 1
        assert file.path.read_bytes() == before, "what is only read may be the line that another one is writing"
        going_on.keep(finished("sobol", -2.1, run=1))
        file.keep(finished("sobol", -2.2, run=2))
        assert [run.best for run in file.read()] == [-2.0, -2.1, -2.2]


class TestTable:
    def test_what_differs_is_said_with_its_sign(self):
        theirs = PUBLISHED["hartmann6", 100, 200]
        turbo, hesbo, rembo = theirs["turbo"], theirs["hesbo"], theirs["rembo"]
        runs = spread("turbo", turbo.mean + 3 * np.hypot(0.05, turbo.standard_error), 0.05)
        runs += spread("hesbo", hesbo.mean - 3 * np.hypot(0.05, hesbo.standard_error), 0.05)
        runs += spread("rembo", rembo.mean + 1.9 * np.hypot(0.05, rembo.standard_error), 0.05)
        rows = {row["method"]: row for row in table_rows([*runs, finished("baxus", -2.0)])}
        assert {name: row["differs"] for name, row in rows.items()} == {
            "rembo": "no", "hesbo": "lower", "turbo": "higher", "baxus": "",
        }  # fmt: skip
        assert rows["turbo"]["z"] == pytest.approx(3)
        text = markdown_table(list(rows.values()))
        assert "no difference is shown: rembo (z +1.9); find less, which is better: hesbo (z -3.0)" in text
        assert "find more, which is worse: turbo (z +3.0); nothing is published to compare with: baxus" in text
        assert "not run here: sobol, cmaes, vanilla-bo." in text
        assert f"| turbo | 16 | {rows['turbo']['mean']:.3f} ± 0.050 |" in text

    @pytest.mark.parametrize(("runs", "differs"), [(2, "no"), (16, "higher")])
    def test_few_runs_tell_little_of_their_standard_error(self, runs, differs):
        """With a limit of 2 standard errors one in four pairs of runs of the published method would differ from it."""
        turbo = PUBLISHED["hartmann6", 100, 200]["turbo"]
        made = spread("turbo", turbo.mean + 2.3 * np.hypot(0.05, turbo.standard_error), 0.05, runs)
        (row,) = table_rows(made)
        assert (row["differs"], row["z"]) == (differs, pytest.approx(2.3))

    def test_functions_stand_apart(self):
        runs = [finished("sobol", -2.0), finished("sobol", 1.4, function="branin", evaluations=50)]
        text = markdown_table(table_rows(runs))
        assert "## branin, D = 100, 50 evaluations (optimum 0.398)" in text
        assert "## hartmann6, D = 100, 200 evaluations (optimum -3.322)" in text


def test_what_uniform_points_reach_on_branins_function_is_said_as_it_is():
    generator = np.random.default_rng(0)
    ten = np.mean([min(map(branin, generator.random((10, 2)))) for _ in range(4000)])
    fifty = np.mean([min(map(branin, generator.random((50, 2)))) for _ in range(1000)])
    said = REMARKS["branin", "sobol"]
    assert "10 uniform points reach (5.7)" in said
    assert "50 reach 1.43" in said
    assert (ten, fifty) == (pytest.approx(5.7, abs=0.25), pytest.approx(1.43, abs=0.1))


def test_a_run_counts_once_however_often_it_is_asked_for_or_kept(tmp_path):
    words = ["optimisers", "--runs", "2", "--solver", "sobol", "--solver", "sobol", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, [*words, "--json"])
    assert result.exit_code == 0, result.output
    assert len(json.loads(result.stdout)["methods"]) == 1
    file = tmp_path / "optimisers.jsonl"
    lines = file.read_text()
    file.write_text(lines + lines)
    assert len(lines.splitlines()) == len(RunFile(tmp_path).read()) == 2


def test_one_run_of_a_published_method_is_too_few_to_compare():
    rows = table_rows([finished("sobol", -2.0, 0)])
    assert rows[0]["differs"] == ""
    text = markdown_table(rows)
    assert "too few runs to compare: sobol" in text
    assert "nothing is published" not in text
    assert "| sobol | 1 | -2.000 | -2.000 | -2.325 ± 0.039 |" in text
    assert "nan" not in text


def test_the_tables_command_can_be_typed_again_and_one_run_has_no_error(tmp_path, monkeypatch):
    words = ["optimisers", "--runs", "1", "--solver", "sobol", "--out", str(tmp_path / "a folder")]
    monkeypatch.setattr("sys.argv", ["cusick-bench", *words])
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    assert "nan" not in result.stdout
    page = (tmp_path / "a folder" / "optimisers.md").read_text()
    assert f"Last command: `{shlex.join(['cusick-bench', *words])}`" in page


def test_command_adds_to_one_table(tmp_path):
    for function in ("hartmann6", "branin"):
        words = ["optimisers", "--function", function, "--runs", "2", "--solver", "sobol", "--out", str(tmp_path)]
        result = CliRunner().invoke(app, [*words, "--json"])
        assert result.exit_code == 0, result.output
    rows = pd.read_csv(tmp_path / "optimisers.csv").set_index("function")
    assert list(rows["runs"]) == [2, 2]
    assert rows.loc["branin", "published_mean"] == 5.179
    best = json.loads(result.stdout)["methods"][0]["best"]
    assert rows.loc["branin", "mean"] == pytest.approx(np.mean(best))
    assert "Hardware: " in (tmp_path / "optimisers.md").read_text()
