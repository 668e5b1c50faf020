"""A fit is posed as the protocol of its data says: sizes, gravity, camera."""

import json

import numpy as np
import pytest

from cusick_bench.datasets import load
from cusick_bench.runner import ProblemSettings, build_problem, plan
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.render.camera import ParallelCamera

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
    assert problem.space.plate_radius == 0.085


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
