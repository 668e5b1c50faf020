"""Performance profiles: by hand, for what has no answer, and from traces."""

import json
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shown_cells import write_cell

from cusick_bench.leaderboard import load_cells
from cusick_bench.leaderboard.anytime import steps_of
from cusick_bench.leaderboard.performance import cost_profiles, error_profiles, performance_profiles

NEEDS = {
    "one": {("a", 0): 1.0, ("b", 0): 4.0, ("c", 0): 3.0, ("d", 0): inf},
    "other": {("a", 0): 2.0, ("b", 0): 2.0, ("c", 0): inf, ("d", 0): 5.0},
}


def test_shares_by_hand():
    one, other = performance_profiles(NEEDS)
    assert (one.label, other.label) == ("one", "other")
    np.testing.assert_array_equal(one.ratios, [1, 1, 2, inf])
    np.testing.assert_array_equal(other.ratios, [1, 1, 2, inf])
    assert [other.share(factor) for factor in (1, 1.9, 2, 1e9)] == [0.5, 0.5, 0.75, 0.75]


def test_who_is_most_often_the_best_comes_first_and_among_equals_who_is_more_often_near_it():
    problems = [("a", 0), ("b", 0), ("c", 0), ("d", 0)]
    needs = {"1 never": (9.0, 9.0, 9.0, 9.0), "2 far": (1.0, 9.0, 9.0, 9.0), "3 near": (3.0, 1.0, 1.9, 1.9)}
    needs |= {"4 often": (9.0, 9.0, 1.0, 1.0)}
    found = performance_profiles({label: dict(zip(problems, row, strict=True)) for label, row in needs.items()})
    assert [one.label for one in found] == ["4 often", "3 near", "2 far", "1 never"]


def test_a_problem_that_some_method_was_not_run_on_does_not_count():
    more = NEEDS["one"] | {("e", 0): 1.0, ("a", 1): 1.0}
    found = performance_profiles({"one": more, "other": NEEDS["other"]})
    assert [profile.ratios.tolist() for profile in found] == [[1, 1, 2, inf], [1, 1, 2, inf]]
    assert performance_profiles({"one": {("a", 0): 1.0}, "other": {("b", 0): 1.0}}) == []


def test_a_problem_that_nobody_solves_does_not_count():
    (only,) = performance_profiles({"one": {("a", 0): 1.0, ("b", 0): inf}})
    assert only.ratios.tolist() == [1.0]
    assert performance_profiles({"one": {("a", 0): inf}}) == []


def test_who_needs_nothing_leaves_others_behind_without_bound():
    profiles = {one.label: one for one in performance_profiles({"one": {("a", 0): 0.0}, "two": {("a", 0): 0.1}})}
    assert profiles["one"].share(1) == 1
    assert profiles["two"].share(1e12) == 0


def _cell(
    run: Path, solver: str, test_mse: float, losses: list[float | None], seed: int = 0, changes: Any = None, **more: Any
) -> None:
    cell = write_cell(run, solver, seed=seed)
    result = json.loads((cell / "result.json").read_text()) | (changes or {}) | more
    result["metrics"]["test_mse"] = test_mse
    (cell / "result.json").write_text(json.dumps(result))
    lines = [
        {"kind": "value", "forward_equivalents": 1 + place, "wall_seconds": 2.0 * (1 + place), "best_loss": loss}
        for place, loss in enumerate(losses)
    ]
    (cell / "trace.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))


@pytest.fixture
def table(tmp_path):
    _cell(tmp_path, "homo", 0.02, [None, 0.5, 0.105, 0.1])
    _cell(tmp_path, "sobol", 0.03, [0.4, 0.3, 0.2, 0.2, 0.2, 0.108])
    _cell(tmp_path, "cmaes", 0.05, [0.4, 0.3])
    _cell(tmp_path, "null:disc", 0.01, [])
    return load_cells(tmp_path).table


def test_solvers_compete_by_the_error_that_is_left(table):
    profiles = {one.label: one for one in error_profiles(table)}
    assert set(profiles) == {"homo", "sobol", "cmaes"}  # a row without physics is no solver
    assert profiles["homo"].ratios.tolist() == [1.0]
    assert profiles["sobol"].ratios == pytest.approx([1.5])


def test_solvers_compete_by_the_cost_of_coming_near_the_lowest_loss(table):
    profiles = {one.label: one for one in cost_profiles(table)}
    assert profiles["homo"].ratios.tolist() == [1.0]  # within a tenth of .1 at its third drape
    assert profiles["sobol"].ratios == pytest.approx([6 / 3])
    assert profiles["cmaes"].ratios.tolist() == [inf]


def test_a_solver_without_traces_has_no_cost_to_compare(tmp_path):
    """It was not said never to come near: nobody knows what it had spent by then."""
    for solver in ("homo", "sobol"):
        _cell(tmp_path, solver, 0.02, [0.2, 0.1])
    _cell(tmp_path, "equilibrium-gap", 0.03, [])
    table = load_cells(tmp_path).table
    assert {one.label for one in cost_profiles(table)} == {"homo", "sobol"}
    assert {one.label for one in error_profiles(table)} == {"homo", "sobol", "equilibrium-gap"}


def test_a_failed_cell_counts_and_one_that_was_not_run_does_not(tmp_path):
    for seed in (0, 1, 2):
        _cell(tmp_path, "homo", 0.02, [0.2, 0.1], seed)
    failed = {"status": "failed", "failure": "the cloth flies apart"}
    _cell(tmp_path, "sobol", 0.01, [0.2, 0.1])
    _cell(tmp_path, "sobol", 0.01, [0.2, 0.1], 1, **failed)
    _cell(tmp_path, "sobol", 0.01, [0.2, 0.1], 2, **failed, settings={"budget": 3})  # no cell of that row
    cells = load_cells(tmp_path)
    for profiles_of in (error_profiles, cost_profiles):
        profiles = {one.label: one.ratios.tolist() for one in profiles_of(cells.table, skipped=cells.skipped)}
        assert profiles["sobol"] == [1, inf]
        assert len(profiles["homo"]) == 2


def test_of_samples_left_out_in_turn_each_that_fails_counts(tmp_path):
    for place in range(4):
        problem = {"seed": 0, "protocol": "leave-one-sample-out", "test": [place]}
        failed = {"status": "failed", "failure": "the cloth flies apart"} if place > 1 else {}
        _cell(tmp_path, "homo", 0.02, [0.2, 0.1], place, problem)
        _cell(tmp_path, "sobol", 0.01, [0.2, 0.1], place, problem | failed)
    cells = load_cells(tmp_path)
    for profiles_of in (error_profiles, cost_profiles):
        profiles = {one.label: one.ratios.tolist() for one in profiles_of(cells.table, skipped=cells.skipped)}
        assert profiles["sobol"] == [1, 1, inf, inf]


def test_values_below_0_have_no_profile(tmp_path):
    """No value is a multiple of a negative one: whoever was above 0 was said to have no answer."""
    _cell(tmp_path, "homo", 0.02, [0.2, 0.1])
    _cell(tmp_path, "sobol", 0.03, [0.2, 0.1])
    table = load_cells(tmp_path).table
    assert error_profiles(table.assign(test_energy_distance=[0.001, 0.0005]), "test_energy_distance")
    assert error_profiles(table.assign(test_energy_distance=[-0.001, 0.0005]), "test_energy_distance") == []


def test_one_solver_alone_is_not_compared(tmp_path):
    _cell(tmp_path, "homo", 0.02, [0.2, 0.1])
    table = load_cells(tmp_path).table
    assert error_profiles(table) == []
    assert cost_profiles(table) == []


def test_steps_of_a_cell_are_those_of_its_search(tmp_path: Path):
    """A loss is there from its evaluation on, before it none; draws of a posterior are prediction, not search."""
    run = tmp_path / "run"
    _cell(run, "homo", 0.05, [None, 0.3, 0.1])
    (trace,) = run.rglob("trace.jsonl")
    draw = {"kind": "draw", "forward_equivalents": 3, "wall_seconds": 60.0, "best_loss": 0.1}
    trace.write_text(trace.read_text() + json.dumps(draw) + "\n")
    drapes, seconds = (steps_of(trace.parent, cost) for cost in ("forward_equivalents", "wall_seconds"))
    np.testing.assert_array_equal(
        drapes.at(np.array([0.5, 1.0, 1.9, 2.0, 2.9, 3.0, 9.0])), [inf, inf, inf, 0.3, 0.3, 0.1, 0.1]
    )
    assert drapes.cost.tolist() == [1, 2, 3]
    assert seconds.cost.tolist() == [2, 4, 6]
