"""The law of commands where none is asked for, its mesh, and what cannot be done by it."""

import inspect
import json
from importlib import import_module

import pytest
from typer.testing import CliRunner

from cusick_bench.cli import COMMANDS, app
from cusick_bench.cli.options import LAW, LawName, vertices_by_law
from cusick_bench.runner import RunnerError, plan
from cusick_bench.runner.grid import ProblemSettings
from cusick_bench.sim.constants import DEFAULT_LAW, VERTICES_OF_PAPER, VERTICES_TO_FIT
from cusick_bench.sim.engine.settings import DrapeSettings

BY_PAPER = ("convergence", "benchmark")  # measure the laws, and began with this one

pytestmark = pytest.mark.usefixtures("one_thread")


def _laws() -> dict[str, LawName]:
    found = {}
    for name, module in COMMANDS.items():
        for command in import_module(f"cusick_bench.cli.{module}").app.registered_commands:
            options = inspect.signature(command.callback).parameters
            if "law" in options and options["law"].default is not None:
                found[name] = options["law"].default
    return found


def _simulate(*words: str) -> dict:
    words = ("simulate", "--density", "0.2", "--bending", "1e-5", "--steps", "3", "--json", *words)
    result = CliRunner().invoke(app, list(words))
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    return {name: document[name] for name in ("drape_coefficient", "residual", "vertices")}


def test_every_command_that_takes_a_law_has_the_same_default():
    assert LAW.value == DEFAULT_LAW == "plate"
    laws = _laws()
    assert {"run", "simulate", "robustness", "population", "fold-selection", *BY_PAPER} <= set(laws)
    for name, law in laws.items():
        assert law is (LawName.paper if name in BY_PAPER else LAW), name


def test_a_drape_is_by_that_law_and_by_another_where_it_is_asked_for():
    default, plate, paper = (
        _simulate("--vertices", "80", *words) for words in ((), ("--law", "plate"), ("--law", "paper"))
    )
    assert default == plate
    assert default["residual"] != pytest.approx(paper["residual"], rel=1e-3)


def test_meshes_are_as_large_as_the_law_needs():
    assert _simulate()["vertices"] == 1205
    assert vertices_by_law(None, LawName.plate, VERTICES_TO_FIT) == VERTICES_TO_FIT
    assert vertices_by_law(None, LawName.paper, VERTICES_TO_FIT) == VERTICES_OF_PAPER
    assert vertices_by_law(97, LawName.plate, VERTICES_TO_FIT) == 97


def test_cells_of_a_run_and_of_the_papers_tables_name_their_laws(toy_data, tmp_path):
    grids = {
        "run": (["run"], {"law": "plate", "vertices": VERTICES_TO_FIT}),
        "table": (["paper", "table-2"], {"law": "plate", "vertices": VERTICES_OF_PAPER}),
    }
    for name, (command, expected) in grids.items():
        words = [*command, "--data", str(toy_data), "--solver", "null:disc", "--out", str(tmp_path / name), "--json"]
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 0, result.output
        records = [json.loads(path.read_text())["settings"] for path in tmp_path.glob(f"{name}/cells/*/cell.json")]
        assert records
        for record in records:
            assert {"law": record["drape"]["law"], "vertices": record["vertices"]} == expected


@pytest.mark.parametrize("clamp", ["half", "whole"])
def test_a_clamp_of_hinges_wants_a_law_of_hinges(clamp, tmp_path):
    for words in (
        ["simulate", "--density", "0.2", "--bending", "1e-5"],
        ["run", "--solver", "null:disc", "--out", str(tmp_path)],
        ["convergence", "--law", "plate"],
    ):
        result = CliRunner().invoke(app, [*words, "--clamp", clamp])
        assert result.exit_code == 2
        assert "leave --clamp out, or add --law paper" in " ".join(result.output.split())


def test_a_solver_that_balances_hinges_is_refused_by_a_law_without(toy_dataset):
    by_plate = ProblemSettings(vertices=97, drape=DrapeSettings(law="plate"))
    with pytest.raises(RunnerError, match="run it with --law paper"):
        plan(toy_dataset, solvers=["null:disc", "equilibrium-gap"], settings=by_plate)
