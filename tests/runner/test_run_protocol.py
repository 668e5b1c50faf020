"""A fit is posed as the protocol of its data and the settings of its cell say: sizes, gravity, camera, and the rest."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from cusick_bench.datasets import load
from cusick_bench.problem import Budget, laid_like
from cusick_bench.runner import ProblemSettings, build_problem, plan
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.render.camera import ParallelCamera, PinholeCamera

PROTOCOL = {
    "cloth_radius_m": 0.14,
    "plate_radius_m": 0.085,
    "gravity_m_s2": 9.81,
    "px_per_m": 700.0,
    "centre_px": [128.5, 126.0],
    "image_y": "down",
}


@pytest.mark.usefixtures("one_thread")
def test_a_fit_follows_the_protocol_of_its_data(make_lab):
    lab = make_lab([4e-5])
    (lab / "protocol.json").write_text(json.dumps(PROTOCOL))
    dataset = load(lab)
    (cell,) = plan(dataset, solvers=["homo"], settings=ProblemSettings(vertices=100))
    problem = build_problem(dataset, cell)
    settings, mesh = problem.simulator.settings, problem.simulator.mesh
    assert (settings.gravity, settings.plate_radius) == (9.81, 0.085)
    assert np.hypot(*mesh.material.T).max() == pytest.approx(0.14)
    assert problem.camera == ParallelCamera(700.0, (128.5, 126.0), "down")
    assert (problem.space.plate_radius, problem.space.cloth_radius) == (0.085, 0.14)


@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize("seed", [0, 7])
def test_a_fit_follows_the_settings_of_its_cell(make_lab, seed: int):
    """A cell is named by them, whether they are used or not."""
    dataset, drape = load(make_lab([4e-5])), DrapeSettings(mode="equilibrium", iterations=400)
    settings = ProblemSettings("homo", 100, drape, "parallel", "soft", "profile", "random", Budget(9))
    (cell,) = plan(dataset, solvers=["sobol"], seeds=[seed], settings=settings)
    problem = build_problem(dataset, cell)
    assert (problem.space.name, problem.renderer, problem.loss) == ("homo", "soft", "profile")
    assert problem.initial is None
    assert problem.meter.budget == Budget(9)
    assert problem.simulator.settings == replace(drape, seed=seed)


@pytest.mark.usefixtures("one_thread")
def test_the_other_projection_has_the_scale_and_the_place_of_the_data(make_lab):
    """The published scripts' camera, whose own scale is 1 % less than the release's, sees the plate as the data's."""
    lab = make_lab([4e-5])
    (lab / "protocol.json").write_text(json.dumps(PROTOCOL | {"px_per_m": 600.0}))
    dataset, points = load(lab), torch.tensor([[0.08, 0.01, 0.0], [-0.03, 0.05, 0.0]], dtype=torch.float64)
    seen, own = [], PinholeCamera()
    for name in ("parallel", "pinhole"):
        (cell,) = plan(dataset, solvers=["sobol"], settings=ProblemSettings(vertices=100, camera=name))
        camera = build_problem(dataset, cell).camera
        seen.append(camera.project(points) - torch.tensor(PROTOCOL["centre_px"]))
    assert isinstance(camera, PinholeCamera)
    assert (camera.eye_height_m, camera.fov_rad) == (own.eye_height_m, own.fov_rad)
    np.testing.assert_allclose(seen[1], seen[0], rtol=0.02)


@pytest.mark.usefixtures("one_thread")
def test_a_face_that_lies_down_is_laid_with_its_own_folds(make_lab):
    """Effects are simulated in the frame of the cloth, of which a picture shows the mirror image."""
    lab = make_lab([4e-5])
    (lab / "protocol.json").write_text(json.dumps({"captures": {"1": "down"}}))
    dataset = load(lab)
    (cell,) = plan(
        dataset, solvers=["sobol"], seeds=[7], settings=ProblemSettings(vertices=100, causes=("off-centre",))
    )
    problem, radii = build_problem(dataset, cell), dataset.sample(cell.train[0]).profile.radii
    assert (problem.scene.side, problem.scene.seed) == ("down", 7)
    mirrored = np.roll(radii[::-1], 361)  # of angle 180 deg - theta
    assert torch.equal(problem.initial, laid_like(mirrored, problem.simulator.mesh))
    assert not torch.equal(problem.initial, laid_like(radii, problem.simulator.mesh))


@pytest.mark.usefixtures("one_thread")
def test_a_fit_by_law_plate_has_its_mesh_and_gradients(make_lab):
    lab = make_lab([4e-5])
    (lab / "protocol.json").write_text(json.dumps(PROTOCOL))
    dataset = load(lab)
    settings = ProblemSettings(vertices=100, drape=DrapeSettings(law="plate", steps=6))
    (cell,) = plan(dataset, solvers=["homo"], settings=settings)
    assert dict(cell.numerics)["law plate"] > 0
    problem = build_problem(dataset, cell)
    assert problem.simulator.mesh is cloth_mesh("plate", 100, radius=0.14, plate_radius=0.085)
    tau, step = np.zeros(39), 1e-4 * np.eye(39)[-8]
    _, gradient = problem.evaluate_and_gradient(tau)
    change = problem.evaluate(tau + step) - problem.evaluate(tau - step)
    assert gradient[-8] == pytest.approx(change / 2e-4, rel=1e-3)
