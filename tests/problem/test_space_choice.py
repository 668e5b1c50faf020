"""The parameter space that a run is asked for: any registered one, refused where a solver cannot work in it."""

import json

import numpy as np
import pytest
from toy_problem import toy_problem
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.problem import SPACES, Budget
from cusick_bench.runner import require_space
from cusick_bench.sim.errors import CusickError
from cusick_bench.solvers.base import SolverError
from cusick_bench.solvers.registry import make_solver, registered

TINY = ["--cloth", "fabric_1", "--vertices", "100", "--steps", "20", "--budget", "6", "--json"]
_SLOW = "nlopt:LD_SLSQP"  # its work grows with the cube of the dimension
ANYWHERE = [
    pytest.param(name, marks=[pytest.mark.slow] if name == _SLOW else [])
    for name, solver in registered().items()
    if solver.kind == "solver" and solver.space is None
]

pytestmark = pytest.mark.usefixtures("one_thread")


def _run(out, *words: str) -> tuple[int, list[dict], str]:
    result = CliRunner().invoke(app, ["run", *TINY, "--out", str(out), *words])
    cells = json.loads(result.stdout)["cells"] if result.stdout.startswith("{") else []
    return result.exit_code, cells, " ".join(result.stderr.split())


def test_help_names_every_space():
    shown = CliRunner().invoke(app, ["run", "--help"], env={"COLUMNS": "200"}).output
    assert f"{', '.join(SPACES)}; by default" in " ".join(shown.split())


@pytest.mark.parametrize("space", SPACES)
def test_a_run_works_in_every_space(tmp_path, space):
    code, (cell,), _ = _run(tmp_path, "--solver", "sobol", "--space", space)
    assert code == 0
    record = json.loads((tmp_path / "cells" / cell["path"].split("/")[-1] / "cell.json").read_text())
    assert record["space"] == record["settings"]["space"] == space


def test_without_a_space_every_solver_gets_its_own(tmp_path):
    code, cells, _ = _run(tmp_path, "--solver", "sobol", "--solver", "heter")
    assert code == 0
    spaces = [json.loads((tmp_path / "cells" / c["path"].split("/")[-1] / "cell.json").read_text()) for c in cells]
    assert [record["space"] for record in spaces] == ["homo", "heter"]


@pytest.mark.parametrize(("solver", "space"), [("bdp", "field"), ("bdp-field,draws=3", "homo"), ("heter", "homo")])
def test_a_solver_about_another_space_is_refused_before_anything_is_run(tmp_path, solver, space):
    code, _, said = _run(tmp_path, "--solver", "sobol", "--solver", solver, "--space", space)
    own = make_solver(solver).space
    assert code == 2
    assert f"{solver} works in the space {own} only, not in {space}" in said
    assert not list(tmp_path.glob("cells/*"))
    require_space([solver], str(own))


def test_an_unknown_space_lists_those_there_are(tmp_path):
    code, _, said = _run(tmp_path, "--solver", "sobol", "--space", "hyper")
    assert code == 2
    assert "use one of homo, heter, field" in said
    with pytest.raises(CusickError, match="unknown space"):
        require_space([], "hyper")


def test_tables_refuse_it_too(toy_data, tmp_path):
    words = ["paper", "table-2", "--data", str(toy_data), "--out", str(tmp_path), "--solver", "bdp@field"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2
    assert "works in the space heter only" in " ".join(result.output.split())


@pytest.mark.parametrize("name", ANYWHERE)
def test_solvers_of_any_space_answer_in_the_field_space(name):
    problem = toy_problem(space="field", budget=Budget(6))
    answer = make_solver(name).solve(problem, np.random.default_rng(0))
    assert answer.tau is not None
    assert len(answer.tau) == problem.dimension


@pytest.mark.parametrize("algorithm", ["LD_SLSQP", "LN_BOBYQA", "LN_COBYLA", "GN_CRS2_LM"])
def test_algorithms_with_tables_of_the_square_are_refused_where_these_are_too_large(algorithm):
    problem = toy_problem(space="heter")
    with pytest.raises(
        SolverError, match=rf"takes at most 2000 of them, and the space 'heter' has {problem.dimension}"
    ):
        make_solver(f"nlopt:{algorithm}").solve(problem, np.random.default_rng(0))
    assert problem.meter.forward == 0


@pytest.mark.parametrize("algorithm", ["LD_LBFGS", "LD_MMA", "LN_SBPLX", "GN_ESCH"])
def test_the_others_work_there(algorithm):
    problem = toy_problem(space="heter", budget=Budget(4))
    make_solver(f"nlopt:{algorithm}").solve(problem, np.random.default_rng(0))
    assert problem.meter.forward > 0


def test_the_list_of_solvers_says_the_space():
    rows = {row["name"]: row for row in json.loads(CliRunner().invoke(app, ["solvers", "--json"]).stdout)["solvers"]}
    assert (rows["bdp"]["space"], rows["rembo"]["space"]) == ("heter", "any")
