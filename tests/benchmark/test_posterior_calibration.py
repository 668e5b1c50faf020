"""Simulation-based calibration: statistics on ranks that are known, fits that resume, and who cannot be calibrated."""

import json
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from cusick_bench.benchmark.posterior_calibration import calibration
from cusick_bench.benchmark.posterior_calibration.calibration import (
    CalibrationError,
    CalibrationFit,
    CalibrationPlan,
    calibration_fit,
    calibration_table,
    plan_numerics,
)
from cusick_bench.benchmark.posterior_calibration.table import FitFile
from cusick_bench.cli import app
from cusick_bench.problem.cloth_prior import CLOTH
from cusick_bench.problem.cloth_tables import cloth_tables
from cusick_bench.solvers.variational.bdp_field import BdpField

QUICK = CalibrationPlan("bdp-field,draws=1,first=8,rounds=1,cloths=4,search=3,refinement=0", fits=2, vertices=80)
pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")


def alike(value: float) -> tuple[float, float, float]:
    return float(value), float(value), float(value)


def fits_of(draws: np.ndarray, truths: np.ndarray) -> list[CalibrationFit]:
    """Fits with a posterior of given draws of one number (fits, draws), alike in all directions."""
    ranks = (draws < truths[:, None]).mean(1)
    return [
        CalibrationFit(i, 0.1, alike(truth), alike(np.median(row)), alike(rank), 1.0, "")
        for i, (row, truth, rank) in enumerate(zip(draws, truths, ranks, strict=True))
    ]


def example(width: float, shift: float) -> dict:
    """A table's row of a normal posterior that is too wide by a factor, and shifted by so many standard deviations."""
    generator = np.random.default_rng(0)
    truth = generator.normal(size=500)
    middle = truth + generator.normal(size=500)  # one observation with noise of standard deviation 1, a flat prior
    draws = middle[:, None] + shift + width * generator.normal(size=(500, 400))
    return calibration_table(fits_of(np.exp(draws), np.exp(truth)))[0]


def test_a_right_posterior_passes() -> None:
    row = example(1.0, 0.0)
    assert row["cover_90"] == pytest.approx(0.9, abs=0.04)
    assert row["cover_50"] == pytest.approx(0.5, abs=0.06)
    assert row["cover_90_low"] < 0.9 < row["cover_90_high"]
    assert row["p_uniform"] > 0.01
    assert sum(row["ranks"]) == 500
    assert row["bias"] == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(("width", "shift"), [(0.5, 0.0), (2.0, 0.0), (1.0, 0.7)])
def test_narrow_wide_and_shifted_posteriors_are_found(width: float, shift: float) -> None:
    row = example(width, shift)
    assert row["p_uniform"] < 1e-6
    if shift:
        assert row["bias"] > 1.5
        assert row["ranks"][0] > 2 * row["ranks"][-1], "truths lie low among draws that are too large"
    else:
        assert (row["cover_90"] < 0.9) == (width < 1)


def test_a_fit_depends_on_its_number_alone_and_is_kept(tmp_path: Path) -> None:
    first, second = calibration_fit(QUICK, 0), calibration_fit(QUICK, 1)
    again = calibration_fit(QUICK, 1)
    assert replace(again, seconds=0.0) == replace(second, seconds=0.0)
    assert first.true != second.true
    assert all(0 <= rank <= 1 for rank in second.rank)
    file = FitFile(tmp_path)
    file.keep(first)
    file.keep(second)
    with file.path.open("a") as broken:
        broken.write('{"number": 3, "dens')  # what a crash leaves
    assert file.read(QUICK) == {0: first, 1: second}
    assert file.read(replace(QUICK, seed=1)) == {}, "other cloths"
    assert file.read(replace(QUICK, fits=1)) == {0: first}
    rows = [{"solver": QUICK.solver, **row} for row in calibration_table([first, second])]
    csv, page = file.write_table(rows, [QUICK])
    assert csv.read_text().startswith("solver,direction,fits,cover_50")
    assert plan_numerics(QUICK) in page.read_text()


def test_the_truth_is_that_of_the_cloth_without_its_specimen_and_its_rank_the_share_of_draws_below(monkeypatch):
    """With the uneven stiffness of one specimen in the truth intervals, which are of cloths, would seem narrow."""
    drawn, truth, draped = [], [], calibration._draped

    def kept(problem, generator):
        drawn.append(draped(problem, generator))
        return drawn[-1]

    def found(solver, problem, prediction):
        ((tau, _),) = drawn
        _, bending = cloth_tables(problem.space.prior, torch.as_tensor(tau[:CLOTH]))
        weft, bias, warp = bending.log().mean(1).exp().tolist()
        truth.extend((warp, weft, bias))
        return None, np.outer([0.5, 0.8, 0.9, 2.0], truth)

    monkeypatch.setattr(calibration, "_draped", kept)
    monkeypatch.setattr(BdpField, "solve", lambda self, problem, generator: None)
    monkeypatch.setattr("cusick_bench.metrics.found_stiffness.find_stiffness", found)
    fit = calibration_fit(replace(QUICK, law="paper"), 0)
    assert fit.true == pytest.approx(truth)
    assert fit.rank == (0.75, 0.75, 0.75)
    assert fit.median == pytest.approx([0.85 * one for one in truth])
    monkeypatch.setattr("cusick_bench.metrics.found_stiffness.find_stiffness", lambda *_: (None, None))
    with pytest.raises(CalibrationError, match="gives no posterior of stiffness"):
        calibration_fit(replace(QUICK, law="paper"), 0)


def test_a_fit_that_fails_stops_no_other_and_is_told(tmp_path: Path, monkeypatch) -> None:
    def fit(plan: CalibrationPlan, number: int, simulators: object = None) -> CalibrationFit:
        if number == 1:
            raise ValueError("singular")
        return CalibrationFit(number, 0.1, alike(1.0), alike(1.0), alike(0.5), 1.0, plan_numerics(plan))

    monkeypatch.setattr(calibration, "calibration_fit", fit)
    words = ["posterior-calibration", "--solver", QUICK.solver, "--fits", "3", "--vertices", "80", "--budget", "1000"]
    result = CliRunner().invoke(app, [*words, "--workers", "1", "--out", str(tmp_path), "--json"])
    assert result.exit_code == 1
    document = json.loads(result.stdout)
    assert document["failed"] == [f"{QUICK.solver}, fit 1: ValueError: singular"]
    assert [row["fits"] for row in document["directions"]] == [2, 2, 2]
    assert set(FitFile(tmp_path).read(replace(QUICK, fits=3))) == {0, 2}
    assert "fit 1: ValueError: singular; it is not in the table" in " ".join(result.stderr.split())


def test_a_solver_whose_fits_all_fail_costs_no_other_its_table(tmp_path: Path, monkeypatch) -> None:
    def fit(plan: CalibrationPlan, number: int, simulators: object = None) -> CalibrationFit:
        if plan.solver == "bdp":
            raise ValueError("singular")
        return CalibrationFit(number, 0.1, alike(1.0), alike(1.0), alike(0.5), 1.0, plan_numerics(plan))

    monkeypatch.setattr(calibration, "calibration_fit", fit)
    words = ["posterior-calibration", "--solver", QUICK.solver, "--solver", "bdp", "--fits", "2", "--workers", "1"]
    result = CliRunner().invoke(app, [*words, "--out", str(tmp_path), "--json"])
    assert result.exit_code == 1
    assert {row["solver"] for row in json.loads(result.stdout)["directions"]} == {QUICK.solver}
    assert (tmp_path / "calibration.csv").exists()


def test_the_tables_command_can_be_typed_again(tmp_path: Path, monkeypatch) -> None:
    def fit(plan: CalibrationPlan, number: int, simulators: object = None) -> CalibrationFit:
        return CalibrationFit(number, 0.1, alike(1.0), alike(1.0), alike(0.5), 1.0, plan_numerics(plan))

    monkeypatch.setattr(calibration, "calibration_fit", fit)
    out = tmp_path / "a folder"
    words = ["posterior-calibration", "--solver", "bdp, draws=1", "--fits", "2", "--workers", "1", "--out", str(out)]
    monkeypatch.setattr("sys.argv", ["cusick-bench", *words])
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    assert f"Command: `{shlex.join(['cusick-bench', *words])}`. " in (out / "calibration.md").read_text()


def test_what_no_fit_can_do_is_told_before_the_first(tmp_path: Path, monkeypatch) -> None:
    """A folder that cannot be made cost a fit, and too few vertices were told once for each fit."""
    made: list[int] = []

    def fit(plan: CalibrationPlan, number: int, simulators: object = None) -> CalibrationFit:
        made.append(number)
        return CalibrationFit(number, 0.1, alike(1.0), alike(1.0), alike(0.5), 1.0, plan_numerics(plan))

    monkeypatch.setattr(calibration, "calibration_fit", fit)
    words = ["posterior-calibration", "--solver", "bdp", "--fits", "2", "--workers", "1"]
    (tmp_path / "file").write_text("")
    for more, says in (
        (["--out", str(tmp_path / "file")], "File exists"),
        (["--vertices", "40"], "a disc needs at least 60 vertices, got 40"),
    ):
        result = CliRunner().invoke(app, [*words, *more])
        assert result.exit_code == 2
        assert " ".join(result.stderr.split()).count(says) == 1
    assert made == []


def test_a_solver_that_is_named_twice_is_fitted_once_and_its_fits_are_counted(monkeypatch) -> None:
    made: list[int] = []

    def fit(plan: CalibrationPlan, number: int, simulators: object = None) -> CalibrationFit:
        made.append(number)
        if number == 1:
            raise ValueError("singular")
        return CalibrationFit(number, 0.1, alike(1.0), alike(1.0), alike(0.5), 1.0, plan_numerics(plan))

    monkeypatch.setattr(calibration, "calibration_fit", fit)
    words = ["posterior-calibration", "--solver", "bdp", "--solver", "bdp", "--fits", "37", "--workers", "1"]
    result = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert result.exit_code == 1
    assert made == list(range(37))
    (line,) = (line for line in result.stdout.splitlines() if "warp" in line)
    assert [words.strip() for words in line.split("│")][1:4] == ["bdp", "warp", "36"], "of 37"


def test_a_damaged_file_says_where(tmp_path: Path) -> None:
    FitFile(tmp_path).path.write_text('{"number": 1}\n')
    with pytest.raises(CalibrationError, match="line 1 is no finished fit"):
        FitFile(tmp_path).read(QUICK)


@pytest.mark.parametrize("solver", ["null:disc", "homo", "equilibrium-gap"])
def test_who_has_no_posterior_is_refused(solver: str) -> None:
    with pytest.raises(CalibrationError, match="no posterior of stiffness; use bdp-field or bdp"):
        CalibrationPlan(solver)


def test_a_solver_without_posterior_is_refused_before_another_is_fitted(monkeypatch) -> None:
    """It was after all fits of the other one, which then had no table, and a fit of its own."""
    monkeypatch.setattr(calibration, "calibration_fit", lambda *_: pytest.fail("a cloth was fitted"))
    words = ["posterior-calibration", "--solver", "bdp", "--solver", "homo", "--fits", "2", "--workers", "1"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2
    assert "homo has no posterior of stiffness; use bdp-field or bdp" in " ".join(result.stderr.split())


def test_plans_that_fit_nothing_are_refused() -> None:
    with pytest.raises(CalibrationError, match="fits must be >= 1"):
        CalibrationPlan(fits=0)
    with pytest.raises(CalibrationError, match="no finished fit"):
        calibration_table([])


def test_fits_of_another_budget_are_others_however_near_it_is():
    assert plan_numerics(CalibrationPlan(budget=1234567.0)) != plan_numerics(CalibrationPlan(budget=1234568.0))
    assert "budget 1000, law" in plan_numerics(CalibrationPlan(budget=1000.0))
