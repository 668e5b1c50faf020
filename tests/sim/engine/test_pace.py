"""Brisk drops: the same beginning as steady ones, two thirds of the steps, nearly the same end, and no gradient."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numba import get_num_threads, set_num_threads

from cusick_bench.benchmark.robustness import specimen
from cusick_bench.problem import DrapeProblem
from cusick_bench.problem.population.derivation import PopulationPlan, population_problem
from cusick_bench.runner.grid import ProblemSettings
from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.cloth.ring_mesh import ring_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.dynamics.drop import drop
from cusick_bench.sim.engine.pace import Pace, pace_of
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.errors import SimulationError

MESH = ring_mesh(150)
STEADY = DrapeSettings(law="plate", backend="lockstep")
CLOTHS = [uniform_material(density=0.2, bending=bending) for bending in (2e-6, 4e-6, 8e-6, 1.6e-5, 3e-5)]


def _fallen(settings: DrapeSettings, cloths=CLOTHS):
    simulator = DrapeSimulator(MESH, settings)
    laid = torch.stack([torch.from_numpy(simulator.laid_down(seed)) for seed in range(len(cloths))])
    with torch.no_grad():
        return simulator.drape_batch(cloths, initial=laid)


def _moved(one, other) -> np.ndarray:
    return (one.vertices - other.vertices).abs().amax((1, 2)).numpy()


def test_a_steady_pace_is_all_steps_without_a_push():
    pace = pace_of("steady", 100)
    assert pace.steps == 100
    assert not any(pace.push_of(step) for step in range(100))


def test_a_brisk_pace_pushes_between_the_first_steps_and_the_last():
    pace = pace_of("brisk", 100)
    pushed = [step for step in range(pace.steps) if pace.push_of(step)]
    assert pace.steps == 65
    assert pushed == list(range(31, 55))


def test_a_brisk_drop_ends_nearer_to_all_steps_than_as_many_steady_ones():
    """Without the push, or with one of the other sign, it does not."""
    cloths = [cloth for cloth in CLOTHS for _ in range(6)]  # each laid down in six ways
    whole, brisk = _fallen(STEADY, cloths), _fallen(replace(STEADY, pace="brisk"), cloths)
    short = _fallen(replace(STEADY, steps=65), cloths)
    assert brisk.failures == [None] * len(cloths)
    assert brisk.iterations.tolist() == [65] * len(cloths)
    assert np.median(_moved(brisk, whole)) < 0.7 * np.median(_moved(short, whole))


def _ends(steps: int, push: float = 0.0, first: int = 0) -> np.ndarray:
    """Where a cloth of law `paper` is after some steps."""
    mesh = disc_mesh(97)
    radius = np.hypot(*mesh.material.T)
    system = DrapeSystem(mesh, "paper", 9.8, radius <= 0.09, np.zeros(mesh.vertices))
    cloth = uniform_material(density=0.2, bending=1e-5)
    tables = cloth.stretch.reshape(-1, 6, 4).numpy(), cloth.bending.reshape(-1, 3, 5).numpy()
    p = Parameters(*tables, cloth.vertex_mass(mesh).numpy(), np.zeros(len(mesh.hinges)))
    pace = Pace(steps, first, push=push)
    return drop(system, p, mesh.flat, steps=steps, step_seconds=0.05, record=False, pace=pace).positions[-1]


def test_a_push_adds_a_share_of_the_last_displacement():
    """x_5 = x_5' + b (x_4 - x_3), where x_5' is where the step leads by itself."""
    plain = {steps: _ends(steps) for steps in (3, 4, 5)}
    pushed = plain[5] + 0.7 * (plain[4] - plain[3])
    assert np.abs(pushed - plain[5]).max() > 1e-4
    np.testing.assert_allclose(_ends(5, 0.7, first=3), pushed, atol=1e-12)


@pytest.mark.threads
def test_a_drape_is_the_same_to_the_bit_with_one_thread_and_in_any_batch():
    settings, threads = replace(STEADY, pace="brisk"), get_num_threads()
    together = _fallen(settings)
    try:
        set_num_threads(1)
        alone = _fallen(settings)
    finally:
        set_num_threads(threads)
    assert torch.equal(together.vertices, alone.vertices)
    assert torch.equal(_fallen(settings, CLOTHS[:3]).vertices, together.vertices[:3])


def test_a_cloth_that_flies_apart_falls_again_steadily_and_spoils_no_other():
    settings = replace(STEADY, steps=15, pace="brisk")
    wild = [specimen(3).material, specimen(16).material, specimen(5).material]
    batch = _fallen(settings, wild)
    halvings = int(batch.halvings[1])
    assert halvings >= 1
    assert batch.iterations.tolist() == [10, 15 * 2**halvings, 10]


def test_a_cloth_that_flies_apart_has_the_same_drape_alone_and_among_others():
    simulator = DrapeSimulator(MESH, replace(STEADY, steps=15, pace="brisk"))
    cloths = [specimen(number).material for number in (16, 5, 16)]
    laid = torch.stack([torch.from_numpy(simulator.laid_down(seed)) for seed in range(len(cloths))])
    with torch.no_grad():
        batch = simulator.drape_batch(cloths, initial=laid)
        alone = [simulator.drape(cloth, initial=one) for cloth, one in zip(cloths, laid, strict=True)]
    assert (batch.halvings > 0).tolist() == [True, False, True]
    assert torch.equal(batch.vertices, torch.stack([drape.vertices for drape in alone]))


def test_a_laid_shape_with_a_gradient_is_dropped_where_none_is_asked_for():
    simulator = DrapeSimulator(MESH, replace(STEADY, steps=5, pace="brisk"))
    laid = torch.from_numpy(simulator.laid_down())
    with torch.no_grad():
        found = simulator.drape(CLOTHS[0], initial=laid.clone().requires_grad_()).vertices
        assert torch.equal(found, simulator.drape(CLOTHS[0], initial=laid).vertices)


def test_a_gradient_is_refused():
    cloth = uniform_material(density=0.2, bending=1e-5)
    cloth.bending.requires_grad_()
    with pytest.raises(SimulationError, match="brisk drop has no gradient"):
        DrapeSimulator(MESH, replace(STEADY, steps=5, pace="brisk")).drape(cloth)


@pytest.mark.parametrize("wrong", [{"pace": "quick"}, {"pace": "brisk", "mode": "equilibrium"}])
def test_other_paces_are_refused(wrong):
    with pytest.raises(SimulationError, match="pace"):
        DrapeSettings(law="plate", **wrong)


def test_records_tell_of_a_brisk_pace_only():
    """Cells of before there was a choice keep their names."""
    assert "pace" not in ProblemSettings().record()["drape"]
    brisk = ProblemSettings(drape=DrapeSettings(law="plate", pace="brisk"))
    assert brisk.record()["drape"]["pace"] == "brisk"


def test_a_problem_drops_briskly_where_its_settings_can():
    problem: DrapeProblem = population_problem(PopulationPlan(vertices=97))
    assert problem.at_pace("steady") is problem
    brisk = problem.at_pace("brisk")
    settings = brisk.simulator.settings
    assert (settings.pace, settings.backend, brisk.simulator.mesh) == ("brisk", "lockstep", problem.simulator.mesh)
    assert brisk.meter is problem.meter, "both are paid from one budget"
    resting = replace(problem.simulator.settings, mode="equilibrium")
    still = replace(problem, simulator=DrapeSimulator(problem.simulator.mesh, resting))
    assert still.at_pace("brisk") is still
