"""A cloth whose training samples show both faces: what problems are shown, what is stored, that it is verified."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets import DrapeDataset, Split, load
from cusick_bench.identify.fits import plan_fits, turned_rows, typical_rows
from cusick_bench.identify.options import Options
from cusick_bench.leaderboard.verification.verify import verify_cell
from cusick_bench.problem.cloth_prior import CLOTH, trait_entry
from cusick_bench.runner import load_prediction
from cusick_bench.runner.cell import solve_cell
from cusick_bench.runner.cell_problem import build_problem
from cusick_bench.runner.errors import RunnerError
from cusick_bench.runner.grid import ProblemSettings, plan
from cusick_bench.runner.samples import training_rows
from cusick_bench.solvers.registry import make_solver

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")

CHEAP = "bdp-field,draws=3,search=2,first=6,rounds=1,cloths=4,refinement=0"
FACE_UP, FACE_DOWN = (1, 2), (3, 4)  # captures of the release


@pytest.fixture(scope="module")
def dataset() -> DrapeDataset:
    return load("synthetic")


@pytest.fixture(scope="module")
def left_out(dataset):
    """The first sample of a cloth is left out."""
    return dataset.split("leave-one-sample-out", ["fabric_3"])[0]


def test_each_sample_trains_once_with_either_face(dataset, left_out):
    own, other = training_rows(dataset, left_out.train)
    table = dataset.index
    assert own[0] == left_out.train[0]
    assert len(own) == len(other) == 11
    assert list(table["capture"][list(own)]) == [FACE_UP[0]] * 11
    assert list(table["capture"][list(other)]) == [FACE_DOWN[0]] * 11
    assert list(table["sample"][list(own)]) == list(table["sample"][list(other)])
    assert training_rows(dataset, other) == (other, ())
    assert training_rows(dataset, [other[0], own[0]]) == ((other[0],), (own[0],))


def test_a_problem_is_shown_the_other_face(dataset, left_out):
    (cell,) = plan(dataset, solvers=["null:disc"], splits=[left_out], settings=ProblemSettings(vertices=97))
    problem = build_problem(dataset, cell)
    _, other = training_rows(dataset, left_out.train)
    assert len(problem.train_images) == len(problem.other_face_images) == 11
    assert np.array_equal(problem.other_face_images[3], dataset.image(other[3]).numpy())


def test_effects_are_refused_where_both_faces_are_learned(dataset, left_out):
    """They act on the other face with another sign or from another side, and one face is simulated only."""
    settings = ProblemSettings(vertices=97, causes=("rest-curvature:curvature=15",))
    with pytest.raises(RunnerError, match="learns from both faces of fabric_3, but effects are simulated for the face"):
        plan(dataset, solvers=["bdp-field"], splits=[left_out], settings=settings)
    assert plan(dataset, solvers=["homo", "null:rotation"], splits=[left_out], settings=settings)
    assert plan(dataset, solvers=["bdp-field"], cloths=["fabric_3"], settings=settings)


def test_only_cells_that_show_a_sample_twice_are_new_to_a_run(dataset, left_out):
    def numerics(protocol: str) -> dict[str, int]:
        cells = plan(dataset, solvers=["null:disc"], cloths=["fabric_3"], protocol=protocol)
        return dict(cells[0].numerics)

    assert numerics("leave-one-sample-out") == numerics("paper") | {"both faces": 1, "repeats": 1}


def test_oracles_of_other_samples_do_not_see_other_captures_of_the_one_that_is_left_out(dataset, left_out):
    table = dataset.index
    draws = {}
    for name in ("oracle:mean", "oracle:best-other"):
        (cell,) = plan(dataset, solvers=[name], splits=[left_out], settings=ProblemSettings(vertices=97))
        draws[name] = solve_cell(build_problem(dataset, cell), dataset, cell).draws
    for place, row in enumerate(left_out.test):
        others = table[(table["sample"] != table["sample"][row]) & (table["side"] == table["side"][row])]
        assert len(others[others["cloth"] == "fabric_3"]) == 22
        images = np.stack([dataset.image(one).numpy() for one in others.index[others["cloth"] == "fabric_3"]])
        errors = np.square(images - dataset.image(row).numpy()).mean((1, 2))
        assert draws["oracle:mean"][place] == pytest.approx(images.mean(0))
        assert np.square(draws["oracle:best-other"][place] - dataset.image(row).numpy()).mean() == errors.min()


@pytest.mark.parametrize("name", ["oracle:mean", "oracle:best-other"])
def test_an_oracle_of_a_sample_that_alone_lies_face_down_knows_those_that_lie_face_up(dataset, name):
    """As the first sample of wool_red in the public release, in the paper's split."""
    table = dataset.index[dataset.index["cloth"] == "fabric_3"].groupby(["sample", "side"]).head(1)
    up = table.index[table["side"] == "up"].tolist()
    (down,) = table.index[(table["side"] == "down") & (table["sample"] == table["sample"].min())].tolist()
    split = Split("fabric_3", train=(up[1],), test=(down, *up[2:]))
    (cell,) = plan(dataset, solvers=[name], splits=[split], settings=ProblemSettings(vertices=97))
    draws = solve_cell(build_problem(dataset, cell), dataset, cell).draws
    images = np.stack([dataset.image(row).numpy() for row in up[1:]])
    errors = np.square(images - dataset.image(down).numpy()).mean((1, 2))
    expected = images.mean(0) if name == "oracle:mean" else images[errors.argmin()]
    assert draws[0] == pytest.approx(expected)


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("both")
    words = ["run", "--data", "synthetic", "--cloth", "fabric_3", "--protocol", "leave-one-sample-out"]
    words += ["--vertices", "97", "--steps", "10", "--budget", "40", "--shard", "1/12", "--out", str(out)]
    solvers = [CHEAP, "null:copy", "null:disc", "null:random-phase,draws=4", "homo"]
    result = CliRunner().invoke(app, [*words, *(word for solver in solvers for word in ("--solver", solver))])
    assert result.exit_code == 0, result.output
    return out


@pytest.fixture(scope="module")
def folders(run) -> dict[str, Path]:
    found = {}
    for folder in (run / "cells").iterdir():
        result = json.loads((folder / "result.json").read_text())
        assert result["status"] == "done", result
        found[result["solver"].partition(",")[0]] = folder
    assert len(found) == 5
    return found


def test_draws_of_either_face_are_stored_in_turn(folders):
    for name, count in (("bdp-field", 3), ("null:copy", 1), ("null:disc", 1), ("null:random-phase", 4)):
        stored = load_prediction(folders[name])
        assert list(stored["draw_turned"]) == [False, True] * count
        assert json.loads((folders[name] / "result.json").read_text())["metrics"]["draws"] == count
    assert "draw_turned" not in load_prediction(folders["homo"])


def test_a_copy_is_of_either_face(folders, dataset):
    cell = json.loads((folders["null:copy"] / "cell.json").read_text())
    own, other = training_rows(dataset, cell["train"])
    draws = load_prediction(folders["null:copy"])["draws"] / 255
    for row, draw in zip((own[0], other[0]), draws, strict=True):
        assert draw == pytest.approx(dataset.image(row).numpy(), abs=0.5 / 255)


def test_turned_draws_are_of_cloths_that_curl_the_other_way(folders, dataset):
    """With the other specimen's noise: what turns is the rest shape, not the stiffness."""
    stored = load_prediction(folders["bdp-field"])
    posterior = {"cloths": stored["posterior_cloths"], "seed": stored["posterior_seed"], "faces": np.array(2)}
    (cell,) = plan(dataset, solvers=[CHEAP], cloths=["fabric_3"], settings=ProblemSettings(vertices=97))
    problem, solver = build_problem(dataset, cell), make_solver(CHEAP)
    curl = trait_entry("curl")
    for index in range(3):
        shown, turned = (solver.redraw(problem, posterior, 2 * index + face) for face in (0, 1))
        assert turned[curl] == -shown[curl] == -stored["posterior_cloths"][index][curl]
        cloth = np.delete(np.arange(CLOTH), curl)
        assert turned[cloth] == pytest.approx(shown[cloth])


def test_cells_are_verified(folders, dataset):
    for folder in folders.values():
        verification = verify_cell(folder, dataset, redrawn=6)
        assert verification.status in ("verified", "rescored"), verification
        assert not [note for note in verification.notes if "run by code" in note]


@pytest.mark.parametrize(
    ("solver", "samples", "faces"), [("bdp-field", 12, 2), ("bdp-field,samples=2", 2, 2), ("homo", 1, 1)]
)
def test_identify_learns_from_both_faces_of_the_samples_in_use(dataset, solver, samples, faces):
    cell = plan_fits(dataset, ["fabric_3"], Options(solver=solver)).cells["fabric_3"]
    own, other = training_rows(dataset, cell.train)
    assert (len(own), len(other)) == (samples, samples * (faces - 1))
    assert own == typical_rows(dataset, "fabric_3")[:samples]
    assert other == (turned_rows(dataset, own) if faces == 2 else ())


def test_faces_that_are_not_known_are_not_paired(toy_dataset):
    rows = typical_rows(toy_dataset, toy_dataset.cloths[0])
    assert turned_rows(toy_dataset, rows) == ()
