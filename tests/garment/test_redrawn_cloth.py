"""Garments of a posterior that a solver of another package has learned, and that it alone can draw from."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from other_package import REPLIES, install
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.garment import GarmentError, cloth_of_cell
from cusick_bench.problem import StiffnessPrior

pytestmark = pytest.mark.usefixtures("one_thread")

LEARNING = f"""{REPLIES}
@dataclass(frozen=True)
class Learner(Solver):
    name: ClassVar[str] = "learner"
    kind: ClassVar[str] = "null"  # no warm-up

    def _solve(self, problem, generator, progress):
        # of another meaning than the arrays of `bdp`: the scale is the width of an interval
        own = dict(mean=np.full(problem.dimension, 5.0), scale=np.full(problem.dimension, 9.0), draws=np.arange(1))
        return answer(problem, tau=np.zeros(problem.dimension), posterior=own)

    def redraw(self, problem, posterior, index):
        return np.full(problem.dimension, 0.5 * (-1) ** index)


@dataclass(frozen=True)
class Forgetful(Learner):
    name: ClassVar[str] = "forgetful"

    redraw = Solver.redraw
"""


@pytest.fixture
def site(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    install(
        monkeypatch, tmp_path / "site", "cusick_learning", LEARNING, {"learner": "Learner", "forgetful": "Forgetful"}
    )
    return tmp_path / "site"


@pytest.fixture
def cell(site: Path, tmp_path: Path) -> Path:
    return _run(tmp_path, "homo")


def _run(folder: Path, space: str) -> Path:
    words = ["run", "--cloth", "fabric_1", "--solver", "learner", "--space", space, "--vertices", "97", "--steps", "3"]
    result = CliRunner().invoke(app, [*words, "--out", str(folder / space), "--json"])
    assert result.exit_code == 0, result.output
    return Path(json.loads(result.stdout)["cells"][0]["path"])


def _of_learner(cell: Path, **changes: object) -> None:
    record = json.loads((cell / "cell.json").read_text())
    (cell / "cell.json").write_text(json.dumps(record | changes))


def test_garments_are_of_the_cloths_that_the_solver_draws(cell: Path):
    cloth = cloth_of_cell(cell)
    assert cloth.source == "cloths"
    prior = StiffnessPrior("plate", cloth.density)
    for sign, bending in ((1, cloth.bending[0]), (-1, cloth.bending[1])):
        np.testing.assert_allclose(bending, prior.bending(torch.full((15,), sign * 0.5, dtype=torch.float64)))
    assert len(np.unique(cloth.bending[:, 0, 0])) == 2


def test_draws_of_a_field_are_cloths_too(site: Path, tmp_path: Path):
    cloth = cloth_of_cell(_run(tmp_path, "field"))
    assert cloth.source == "cloths"
    assert len(np.unique(cloth.bending[:, 0, 0])) == 2


def test_draws_of_elements_are_refused(site: Path, tmp_path: Path):
    with pytest.raises(GarmentError, match="run the solver with --space homo or field"):
        cloth_of_cell(_run(tmp_path, "heter"))


def test_a_solver_that_cannot_draw_is_refused(cell: Path):
    _of_learner(cell, solver="forgetful")
    with pytest.raises(GarmentError, match="forgetful keeps a posterior, but defines no `redraw`"):
        cloth_of_cell(cell)


def test_a_solver_that_is_not_here_is_refused(cell: Path):
    _of_learner(cell, solver="elsewhere")
    with pytest.raises(GarmentError, match=r"its solver must be installed .* unknown solver 'elsewhere'"):
        cloth_of_cell(cell)


def test_a_solver_of_another_version_is_refused(cell: Path):
    _of_learner(cell, numerics={"solver learner": 7})
    with pytest.raises(GarmentError, match="the cell is of its version 7, and 1 is here"):
        cloth_of_cell(cell)


def test_data_that_have_changed_are_refused(cell: Path):
    _of_learner(cell, dataset_hash="another")
    with pytest.raises(GarmentError, match="has changed since the run"):
        cloth_of_cell(cell)
