"""Effects in fits, on the command line, and in what is kept of both."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from toy_problem import toy_problem
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.datasets import load
from cusick_bench.leaderboard import load_cells
from cusick_bench.leaderboard.verification.resimulate import read_record, repeat
from cusick_bench.leaderboard.verification.verify import verify_cell
from cusick_bench.problem import (
    Budget,
    DrapeProblem,
    ProblemError,
    Scene,
    canonical,
    parse_causes,
    profile_in_cloth_frame,
)
from cusick_bench.runner import (
    Cell,
    ProblemSettings,
    RunnerError,
    Source,
    Store,
    build_problem,
    load_prediction,
    plan,
    run,
    run_cell,
)
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.effects import registered
from cusick_bench.sim.effects.imaging.camera_scale import CameraScale
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.setup import Side
from cusick_bench.solvers.base import SolverError
from cusick_bench.solvers.registry import make_solver

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")

SMALL = ProblemSettings(vertices=100, drape=DrapeSettings(steps=20), budget=Budget(8))
CAUSES = ("plate-tilt:angle=6,direction=90", "perspective")
STATEFUL = ("bending-friction", "shear-friction", "face-asymmetry")


@pytest.fixture(scope="module")
def data(make_lab) -> Path:
    return make_lab((2.0,))


def _with(causes: tuple[str, ...], side: Side = "up", *, problem: DrapeProblem | None = None) -> DrapeProblem:
    """The toy problem, its simulator knowing of causes."""
    plain = problem or toy_problem(laid_as_true=True, budget=Budget())
    scene = Scene(parse_causes(causes), plain.simulator.mesh, plain.simulator.settings, side=side)
    return replace(
        plain,
        simulator=DrapeSimulator(scene.warped, scene.simulated),
        space=replace(plain.space, mesh=scene.warped, plate_radius=scene.simulated.plate_radius),
        scene=scene,
    )


def _cells(data: Path, causes: tuple[str, ...] = CAUSES, solvers=("homo,search=2",)) -> list[Cell]:
    return plan(load(data), solvers=list(solvers), settings=replace(SMALL, causes=causes))


def _invoke(*arguments: str) -> dict:
    found = CliRunner().invoke(app, [*arguments, "--json"])
    assert found.exit_code == 0, found.output
    return json.loads(found.stdout)


class TestProblem:
    def test_severity_nought_is_the_very_problem_without(self):
        plain, tau = toy_problem(laid_as_true=True, budget=Budget()), toy_problem().space.bending_level(2.0)
        causes = tuple(f"{name}:{effect.severity.name}=0" for name, effect in registered().items())
        loss, gradient = plain.evaluate_and_gradient(tau)
        again, slope = _with(causes).evaluate_and_gradient(tau)
        assert again == loss
        np.testing.assert_array_equal(slope, gradient)

    @pytest.mark.parametrize(
        "causes",
        [
            ("plate-tilt:angle=5", "camera-tilt:angle=8,direction=20", "density-bias:bias=.2"),
            ("off-centre:shift=.005", "plate-radius:error=.004", "rim-stiffening", "threshold"),
        ],
    )
    def test_gradients_are_those_of_the_loss_with_the_causes(self, causes):
        problem = _with(causes)
        tau = problem.space.bending_level(2.0)
        direction = np.random.default_rng(5).normal(size=problem.dimension)
        slope = problem.evaluate_and_gradient(tau)[1] @ direction
        step = 1e-5
        high, low = (problem.evaluate(tau + sign * step * direction) for sign in (1, -1))
        assert slope == pytest.approx((high - low) / (2 * step), rel=1e-3)
        assert abs(problem.evaluate(tau) - toy_problem(laid_as_true=True).evaluate(tau)) > 1e-4  # and they act

    def test_a_fit_sees_through_the_camera_of_the_causes(self):
        plain, tau = toy_problem(laid_as_true=True, budget=Budget()), toy_problem().space.bending_level(2.0)
        moved = _with((f"camera-offset:shift={4 / 723},direction=90",))
        np.testing.assert_allclose(moved.image(tau), np.roll(plain.image(tau), -4, axis=0), atol=1e-9)
        np.testing.assert_array_equal(moved.drape(tau), plain.drape(tau))  # the cloth is where it was

    @pytest.mark.parametrize("name", STATEFUL)
    def test_internal_variables_leave_losses_but_no_gradients(self, name):
        problem = _with((name,))
        tau = problem.space.bending_level(2.0)
        assert 0 < problem.evaluate(tau) != toy_problem(laid_as_true=True).evaluate(tau)
        with pytest.raises(ProblemError, match=rf"effect {name} has internal variables.*gradient-free solver"):
            problem.evaluate_and_gradient(tau)

    @pytest.mark.parametrize("text", ["homo", "heter", "bdp", "bdp-field"])
    def test_a_solver_that_needs_gradients_refuses_internal_variables_before_its_first_drape(self, text):
        solver = make_solver(text)
        problem = _with(("shear-friction",), problem=toy_problem(laid_as_true=True, space=solver.space or "homo"))
        with pytest.raises(SolverError, match=r"needs gradients.* effect shear-friction .*bdp-field,refinement=0"):
            solver.solve(problem, np.random.default_rng(0))
        assert problem.meter.forward == 0

    def test_internal_variables_need_a_drop(self):
        with pytest.raises(ProblemError, match=r"shear-friction acts in the course of a drop, got mode 'equilibrium'"):
            _with(("shear-friction",), problem=toy_problem(mode="equilibrium"))

    def test_equilibria_are_followed_on_a_tilted_plate(self):
        problem = _with(("plate-tilt:angle=8", "off-centre"), problem=toy_problem(mode="equilibrium", budget=Budget()))
        problem.evaluate(problem.space.bending_level(2.0))
        near = torch.as_tensor(problem.space.bending_level(2.05))[None]
        cold, warm = replace(problem, follow=False).simulate(near), problem.simulate(near)
        assert warm.iterations[0] <= max(cold.iterations[0], 8)
        torch.testing.assert_close(warm.vertices, cold.vertices, atol=1e-6, rtol=0)

    def test_face_down_is_the_mirror_image_to_the_laboratory(self):
        """Of a cloth without a face and laid symmetrically, on a plate that slopes along y, the picture is mirrored."""
        problem = replace(toy_problem(budget=Budget()), initial=None)
        causes = ("plate-tilt:angle=10,direction=90", "camera-offset:shift=.004,direction=90")
        up, down = (_with(causes, side, problem=problem) for side in ("up", "down"))
        tau = problem.space.bending_level(3.0)
        np.testing.assert_allclose(down.drape(tau), up.drape(tau) * [-1, 1, 1], atol=1e-12)
        np.testing.assert_allclose(down.image(tau), up.image(tau)[:, ::-1], atol=1e-9)
        radii = np.arange(720.0)
        np.testing.assert_array_equal(profile_in_cloth_frame(radii, down.scene)[[0, 180, 360]], [360, 180, 0])
        for scene in (up.scene, None):
            np.testing.assert_array_equal(profile_in_cloth_frame(radii, scene), radii)


class TestGrid:
    def test_a_cause_is_written_in_one_way(self):
        full = "plate-tilt:angle=2,direction=90"
        assert {canonical(text) for text in (full, "plate-tilt: direction=90.0, angle=2e0", canonical(full))} == {full}
        assert canonical("plate-tilt") == "plate-tilt:angle=1,direction=0"

    def test_friction_that_is_given_twice_is_refused_before_anything_runs(self):
        twice = ("shear-friction:ratio=2", "plate-tilt", "shear-friction")
        for read in (parse_causes, lambda causes: ProblemSettings(causes=causes)):
            with pytest.raises(SimulationError, match="effect shear-friction must be given once, got it 2 times"):
                read(twice)
        assert len(ProblemSettings(causes=("plate-slip", "plate-slip")).causes) == 2

    def test_causes_make_other_cells_and_nothing_else_does(self, data):
        (with_both,), (without,), (other,) = (_cells(data, causes) for causes in (CAUSES, (), CAUSES[:1]))
        assert len({with_both.key, without.key, other.key}) == 3
        assert len({with_both.problem_hash(), without.problem_hash()}) == 2
        assert "causes" not in without.record()["settings"]  # so that cells of earlier runs keep their names
        assert _cells(data, ("plate-tilt:direction=90,angle=6.0", "perspective"))[0].key == with_both.key
        assert with_both.label == f"homo,search=2 + {' + '.join(canonical(cause) for cause in CAUSES)}"

    def test_cells_that_follow_a_branch_have_its_version(self, data):
        """Contact of the cloth with itself is known at rest only, so its cells follow a branch in every mode."""
        for causes, mode in (((), "equilibrium"), (("self-contact",), "drop"), (("plate-tilt",), "drop")):
            settings = replace(SMALL, causes=causes, drape=replace(SMALL.drape, mode=mode))
            (cell,) = plan(load(data), solvers=["homo"], settings=settings)
            scene = Scene(parse_causes(causes), disc_mesh(100), settings.drape)
            assert ("branch" in dict(cell.numerics)) == (scene.simulated.mode == "equilibrium")

    def test_causes_that_are_possible_only_together_make_a_scene(self):
        causes = ("off-centre:shift=0.03", "creep", "cut-size:error=0.01")
        scene = Scene(parse_causes(causes), disc_mesh(100, radius=0.12), SMALL.drape, later=True)
        assert scene.stateful == "creep"
        assert np.hypot(*scene.warped.material[scene.warped.boundary].T).min() > 0.09

    def test_rows_without_physics_stay_what_they_are(self, data):
        (null,) = _cells(data, solvers=["null:disc"])
        assert null.key == _cells(data, (), ["null:disc"])[0].key

    def test_who_cannot_know_effects_is_refused_at_once(self, data):
        with pytest.raises(RunnerError, match=r"equilibrium-gap .* knows no effects; run it without"):
            _cells(data, solvers=["equilibrium-gap"])
        with pytest.raises(SimulationError, match=r"did you mean 'plate-tilt'"):
            _cells(data, ("plate-tilts",))

    def test_an_effect_that_changes_nothing_is_told(self, data, caplog):
        """Creep shows in later pictures only, such as the second of a series over time."""
        plain = load(data)
        first, second = (replace(plain, table=plain.table.assign(observation=number)) for number in (1, 2))
        for dataset, acts in ((plain, False), (first, False), (second, True)):
            caplog.clear()
            (cell,) = plan(dataset, solvers=["homo"], settings=replace(SMALL, causes=("creep", "plate-tilt")))
            scene = build_problem(dataset, cell).scene
            assert scene is not None
            assert (scene.later, scene.stateful) == ((True, "creep") if acts else (False, ""))
            assert ("series" in dict(cell.numerics)) == acts
            told = [
                "effect creep acts in later pictures of a drape only, but the picture of fabric_1 that is fitted is "
                "the first one: it changes nothing there; leave it out"
            ]
            assert [record.getMessage() for record in caplog.records] == ([] if acts else told)

    @pytest.mark.parametrize("refusing", [True, False])
    def test_an_effect_of_one_law_is_planned_by_that_law(self, data, monkeypatch, caplog, refusing):
        """It was tried by law paper, whatever the run's: refused, or said to change nothing."""

        class OfPlates(CameraScale):
            name = "of-plates"

            def _apply(self, setup, value):
                if setup.settings.law != "plate":
                    if refusing:
                        raise SimulationError("of-plates needs --law plate")
                    return setup
                return super()._apply(setup, value)

        known = {**registered(), "of-plates": OfPlates()}
        monkeypatch.setattr("cusick_bench.sim.effects.registry.registered", lambda: known)
        settings = replace(SMALL, drape=replace(SMALL.drape, law="plate"), causes=("of-plates",))
        assert len(plan(load(data), solvers=["homo"], settings=settings)) == 1
        assert "changes nothing" not in caplog.text

    def test_the_problem_of_a_cell_is_posed_on_the_causes_mesh_and_plate(self, data):
        (cell,) = _cells(data, ("plate-radius:error=.005", "cut-size:error=-.002"))
        problem = build_problem(load(data), cell)
        assert problem.simulator.settings.plate_radius == problem.space.plate_radius == 0.095
        assert problem.space.mesh is problem.simulator.mesh
        assert np.hypot(*problem.simulator.mesh.material.T).max() == pytest.approx(0.148, abs=1e-12)


@pytest.fixture(scope="module")
def finished(data, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("effects")
    for causes in (CAUSES, (), ("bending-friction",)):
        solvers = ["cmaes"] if causes == ("bending-friction",) else ["homo,search=2", "null:disc"]
        run(Source(str(data)), _cells(data, causes, solvers), out, command=["run"])
    return out


class TestRun:
    def test_leaderboards_say_which_row_knew_of_what(self, finished):
        assert sorted(load_cells(finished).table["solver"]) == [
            "cmaes + bending-friction:ratio=20",
            "homo,search=2",
            "homo,search=2 + plate-tilt:angle=6,direction=90 + perspective:inverse_height=0.7",
            "null:disc",
        ]

    def test_every_cell_is_verified_with_its_causes(self, finished, data):
        for folder in load_cells(finished).table["folder"]:
            found = verify_cell(folder, load(data))
            assert found.status == "verified", found.record()

    def test_a_cell_is_not_verified_with_other_causes(self, finished, data, tmp_path, monkeypatch):
        table = load_cells(finished).table
        folder = table.loc[table["solver"].str.contains("plate-tilt"), "folder"].iloc[0]

        def without_causes(folder: Path, cell: Cell, *words, **named):
            return repeat(folder, replace(cell, settings=replace(cell.settings, causes=())), *words, **named)

        monkeypatch.setattr("cusick_bench.leaderboard.verification.verify.repeat", without_causes)
        assert {"shape [m]", "fit"} <= {check.name for check in verify_cell(folder, load(data)).broken}

    def test_a_stopped_fit_goes_on_to_the_same_numbers(self, finished, data, tmp_path):
        (cell,) = _cells(data)
        whole, part = finished / "cells" / cell.key, tmp_path / "cells" / cell.key
        assert Cell.from_record(read_record(whole)) == cell
        calls = iter(range(5))

        def stopped(*_) -> None:
            if next(calls) == 4:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            run_cell(load(data), cell, Store(tmp_path), stopped)
        before = (part / "trace.jsonl").read_text()
        assert before
        run_cell(load(data), cell, Store(tmp_path), lambda *_: None)
        assert (part / "trace.jsonl").read_text().startswith(before)  # what was done is not done again
        first, second = (json.loads((folder / "result.json").read_text())["metrics"] for folder in (whole, part))
        assert first == second
        np.testing.assert_array_equal(load_prediction(part)["tau"], load_prediction(whole)["tau"])


class TestCommands:
    def test_effects_are_listed_with_what_they_take(self):
        found = {effect["name"]: effect for effect in _invoke("effects")["effects"]}
        assert set(found) == set(registered())
        angle, direction = found["plate-tilt"]["parameters"]
        assert (angle["name"], angle["unit"], angle["high"], direction["role"]) == ("angle", "deg", 20, "direction")
        assert found["plate-tilt"]["class"] == "boundary"
        text = CliRunner().invoke(app, ["effects"]).output
        assert all(name in text for name in found)

    def test_simulate_with_effects(self, tmp_path):
        base = ("simulate", "--density", ".192", "--bending", "2e-5", "--vertices", "150", "--steps", "30")
        plain, nought = _invoke(*base), _invoke(*base, "--with-effect", "plate-tilt:angle=0")
        assert nought["drape_coefficient"] == plain["drape_coefficient"]
        grown = _invoke(*base, "--with-effect", "camera-scale:error=.1", "--out", str(tmp_path))
        plate, cloth = 0.09**2, 0.15**2
        area = plate + plain["drape_coefficient"] * (cloth - plate)
        assert grown["drape_coefficient"] == pytest.approx((1.21 * area - plate) / (cloth - plate), abs=0.01)
        slipped = _invoke(*base, "--with-effect", "plate-slip:slide=.01", "--with-effect", "creep", "--draws", "2")
        assert len({draw["drape_coefficient"] for draw in slipped["draws"]}) == 2
        assert slipped["converged"] is None  # nobody knows of a drop with history

    def test_run_with_effects(self, data, tmp_path):
        options = ("--solver", "homo", "--vertices", "100", "--steps", "20", "--budget", "4")
        causes = ("--with-effect", "plate-tilt:angle=6", "--with-effect", "perspective")
        (cell,) = _invoke("run", "--data", str(data), "--out", str(tmp_path), *options, *causes)["cells"]
        assert cell["causes"] == ["plate-tilt:angle=6,direction=0", "perspective:inverse_height=0.7"]
        assert cell["status"] == "done"

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("plate-tilt:angle=50", "angle must lie within 0 to 20 deg, got 50"),
            ("plate-tilt:slope=5", "no parameter 'slope'; use angle, direction"),
            ("tilt", "unknown effect 'tilt'"),
        ],
    )
    def test_bad_causes_end_with_one_line(self, tmp_path, text, message):
        for command in (("run", "--out", str(tmp_path)), ("simulate", "--density", ".2", "--bending", "1e-5")):
            found = CliRunner().invoke(app, [*command, "--with-effect", text])
            assert found.exit_code == 2
            assert message in " ".join(found.output.split())
