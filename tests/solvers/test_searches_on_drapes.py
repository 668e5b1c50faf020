"""Gradient-free searches on drapes: resumption, failures, budgets, options."""

import math
import subprocess
import sys

import numpy as np
import pytest
from toy_problem import toy_problem

from cusick_bench.problem import Budget
from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.solvers.base import SolverError
from cusick_bench.solvers.bayesian_optimisation.vanilla_bo import VanillaBo
from cusick_bench.solvers.registry import make_solver

BAYESIAN = ("rembo", "hesbo", "vanilla-bo", "turbo", "baxus")


class TestDrapes:
    def _answer(self, text, problem, seed=0):
        return make_solver(text).solve(problem, np.random.default_rng(seed))

    @pytest.mark.parametrize("text", ["rembo,embeddings=2,embedded=3", "hesbo,initial=3,embedded=4", "cmaes", "sobol"])
    def test_heterogeneous_cloth_and_resumption(self, text, tmp_path):
        """A parameter for every element; a killed run ends with the numbers of an undisturbed one."""
        problem = toy_problem(space="heter", budget=Budget(8), folder=tmp_path / "whole")
        expected = self._answer(text, problem)
        assert expected.tau is not None
        assert expected.tau.shape == (problem.dimension,)
        assert np.abs(expected.tau).max() <= 3
        killed = toy_problem(space="heter", budget=Budget(8), folder=tmp_path / "killed")

        def kill(evaluation):
            if killed.meter.forward == 6:
                raise KeyboardInterrupt

        killed.meter.observers.append(kill)
        with pytest.raises(KeyboardInterrupt):
            self._answer(text, killed)
        resumed = toy_problem(space="heter", budget=Budget(8), folder=tmp_path / "killed")
        answer = self._answer(text, resumed)
        assert (answer.tau == expected.tau).all()
        assert [e.loss for e in resumed.meter.trace] == [e.loss for e in problem.meter.trace]

    def test_hesbo_fits_a_homogeneous_cloth(self):
        problem = toy_problem(budget=Budget(16))
        answer = self._answer("hesbo,embedded=3,initial=6", problem, seed=1)
        first = min(evaluation.loss for evaluation in problem.meter.trace[:6])
        assert problem.meter.best_loss < 0.6 * first
        assert not answer.finished

    def test_failures_are_told_as_such(self, monkeypatch, fail_drapes):
        problem, told = toy_problem(budget=Budget(6)), []
        fail_drapes(lambda count: True)

        def listen(self, dimension, evaluations, generator):
            while True:
                told.append((yield np.zeros(dimension)))

        monkeypatch.setattr(VanillaBo, "search", listen)
        with pytest.raises(DrapeDiverged):
            self._answer("vanilla-bo", problem)
        assert told == [math.inf] * 5

    @pytest.mark.parametrize(("budget", "expected"), [(Budget(6), 5), (Budget(1), 1), (Budget(seconds=60), 500)])
    def test_a_search_plans_with_what_the_last_drape_leaves_of_the_budget(self, budget, expected, monkeypatch):
        plans = []

        def planned(self, dimension, evaluations, generator):
            plans.append(evaluations)
            return (np.zeros(dimension) for _ in range(1))

        monkeypatch.setattr(VanillaBo, "search", planned)
        self._answer("vanilla-bo", toy_problem(budget=budget, vertices=60))
        assert plans == [expected]

    def test_progress_is_told(self):
        heard: list[tuple[str, float]] = []
        make_solver("sobol").solve(
            toy_problem(budget=Budget(5)), np.random.default_rng(0), lambda *news: heard.append(news)
        )
        assert [fraction for _, fraction in heard] == pytest.approx([0.2, 0.4, 0.6, 0.8])

    @pytest.mark.parametrize("name", [*BAYESIAN, "cmaes", "sobol"])
    def test_a_budget_is_needed(self, name):
        with pytest.raises(SolverError, match="give --budget"):
            self._answer(name, toy_problem(budget=Budget()))

    @pytest.mark.parametrize(
        "text", ["rembo,initial=1", "hesbo,initial=0", "rembo,embeddings=0", "baxus,parts=1", "cmaes,sigma=0"]
    )
    def test_odd_options_are_refused(self, text):
        with pytest.raises(SolverError, match="got"):
            make_solver(text)

    @pytest.mark.parametrize("search", [0, 2])
    def test_a_first_step_that_has_no_room_in_the_box_is_refused(self, search):
        """BOBYQA refuses it without a word; after a search for the level that was the answer, as if it had searched."""
        problem = toy_problem(budget=Budget(6), vertices=60)
        with pytest.raises(SolverError, match=r"step must be <= 3 prior standard deviations, .* got 3\.5; leave"):
            self._answer(f"nlopt:LN_BOBYQA,step=3.5,search={search}", problem)
        assert problem.meter.forward == 0
        self._answer("nlopt:LN_BOBYQA,step=3", problem)
        assert problem.meter.forward == 6


def test_the_list_of_solvers_waits_for_no_slow_package():
    code = (
        "import sys; from cusick_bench.solvers.registry import registered; names = registered()\n"
        "print(*names, '|', *{'botorch', 'gpytorch', 'linear_operator', 'cma'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    names, loaded = done.stdout.split("|")
    assert {*BAYESIAN, "cmaes", "sobol"} <= set(names.split())
    assert not loaded.split()
