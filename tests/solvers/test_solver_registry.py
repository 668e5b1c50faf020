"""Solvers by their names with options, and those of other packages."""

import json
from dataclasses import dataclass, field
from typing import ClassVar

import nlopt
import numpy as np
import pytest
from solver_answers import answer_of
from toy_problem import toy_problem
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.problem import Budget
from cusick_bench.sim import plugins
from cusick_bench.solvers import registry
from cusick_bench.solvers.base import Solver, SolverError
from cusick_bench.solvers.gradient.homo import Homo
from cusick_bench.solvers.registry import make_solver

NLOPT = [name for name in dir(nlopt) if name[:3] in ("LD_", "LN_", "GD_", "GN_")]
UNUSABLE = ("AUGLAG", "AUGLAG_EQ", "MLSL", "MLSL_LDS", "STOGO", "STOGO_RAND", "AGS", "LBFGS_NOCEDAL", "NEWUOA")


pytestmark = pytest.mark.usefixtures("one_thread")


def test_unknown_name_lists_what_there_is():
    with pytest.raises(SolverError, match=r"did you mean 'homo'.*null:disc"):
        make_solver("homer")


def test_unknown_nlopt_algorithm_lists_them():
    with pytest.raises(SolverError, match=r"no algorithm 'LD_MAGIC'.*LN_BOBYQA"):
        make_solver("nlopt:LD_MAGIC")
    with pytest.raises(SolverError, match="second optimiser"):
        make_solver("nlopt:LD_AUGLAG")


@pytest.mark.parametrize("algorithm", [name for name in NLOPT if not name.endswith(UNUSABLE)])
def test_any_other_nlopt_algorithm_ends_with_its_budget(algorithm):
    problem = toy_problem(budget=Budget(9))
    answer = make_solver(f"nlopt:{algorithm}").solve(problem, np.random.default_rng(0))
    assert 1 < problem.meter.forward_equivalents <= 9
    assert np.abs(answer.tau).max() <= problem.bounds[1].max()


@pytest.mark.parametrize("algorithm", ["GD_STOGO", "GD_STOGO_RAND", "GN_AGS", "LD_LBFGS_NOCEDAL", "LN_NEWUOA"])
def test_nlopt_algorithms_that_do_not_end_or_leave_the_box_are_refused(algorithm):
    with pytest.raises(SolverError, match=rf"{algorithm} cannot be used: it .*use one of .*LN_BOBYQA"):
        make_solver(f"nlopt:{algorithm}")


def test_options_in_the_name():
    assert make_solver("null:random-phase,draws=7").options == {"draws": 7}
    assert make_solver("homo, adam_steps=3,adam_rate=0.5") == Homo(adam_steps=3, adam_rate=0.5)
    for text in ("homo,speed=3", "homo,adam_steps", "oracle:mean,heldout=3"):
        with pytest.raises(SolverError, match="has no option"):
            make_solver(text)


@pytest.mark.parametrize("text", [
    "nlopt:LN_BOBYQA,step=0.0", "nlopt:LN_BOBYQA,search=-3", "homo,search=-3",
    "homo,adam_rate=0", "homo,adam_steps=-1", "heter,length=0", "turbo,candidates=0", "baxus,candidates=0",
    "hesbo,embedded=0", "rembo,embedded=0", "bdp,search=-1", "bdp-field,search=-1",
    "equilibrium-gap,position_error=0", "equilibrium-gap,force_error=-1.0", "equilibrium-gap,rest_height=-1.0",
    "equilibrium-gap,unevenness=-0.1",
])  # fmt: skip
def test_options_out_of_bounds_are_refused(text):
    with pytest.raises(SolverError, match="must be >"):
        make_solver(text)


@pytest.mark.parametrize("text", ["null:rotation,draws=0", "null:random-phase,draws=100001"])
def test_reference_rows_of_no_draws_or_too_many_are_refused(text):
    with pytest.raises(SolverError, match="draws must be from 1 to 100000"):
        make_solver(text)


def test_an_option_of_few_values_names_them():
    with pytest.raises(SolverError, match="option pace of bdp-field must be one of steady, brisk, got 'fast'"):
        make_solver("bdp-field,pace=fast")


def test_other_packages_register_theirs(monkeypatch):
    @dataclass(frozen=True)
    class Foreign(Solver):
        name: ClassVar[str] = "foreign"

        def _solve(self, problem, generator, progress):
            raise NotImplementedError

    class Entry:
        name = "foreign"

        def load(self):
            return Foreign

    monkeypatch.setattr(plugins, "entry_points", lambda group: [Entry()] if group == registry.ENTRY_POINTS else [])
    assert isinstance(make_solver("foreign"), Foreign)


def test_options_of_other_packages_are_told_and_refused_in_a_line(monkeypatch):
    @dataclass(frozen=True)
    class Foreign(Solver):
        name: ClassVar[str] = "foreign"
        iterations: int
        sizes: list = field(default_factory=lambda: [1, 2])

        def __post_init__(self):
            if self.iterations < 1:
                raise ValueError("iterations must be > 0")

        def _solve(self, problem, generator, progress):
            raise NotImplementedError

    monkeypatch.setattr(registry, "registered_classes", lambda *_: {"foreign": Foreign})
    with pytest.raises(SolverError, match="foreign needs the option iterations; write foreign,iterations=VALUE"):
        make_solver("foreign")
    with pytest.raises(SolverError, match="foreign,iterations=0: iterations must be > 0"):
        make_solver("foreign,iterations=0")
    assert make_solver("foreign,iterations=2").options == {"iterations": 2, "sizes": [1, 2]}
    listed = CliRunner().invoke(app, ["solvers", "--json"])
    options = {one["name"]: one["options"] for one in json.loads(listed.stdout)["solvers"]}
    assert options["foreign"] == {"iterations": "(must be given)", "sizes": "[1, 2]"}
    assert options["null:random-phase"] == {"draws": 1000}


def test_options_whose_module_imports_a_type_for_type_checkers_only_can_be_given(monkeypatch):
    @dataclass(frozen=True)
    class Foreign(Solver):
        name: ClassVar[str] = "foreign"
        count: int = 3
        sizes: "NobodyImportsThis" = ()

        def _solve(self, problem, generator, progress):
            raise NotImplementedError

    monkeypatch.setattr(registry, "registered_classes", lambda *_: {"foreign": Foreign})
    assert make_solver("foreign,count=4").options == {"count": 4, "sizes": ()}


def test_global_search_needs_an_end():
    with pytest.raises(SolverError, match="give --budget"):
        answer_of("nlopt:GN_ESCH", toy_problem(budget=Budget()))
