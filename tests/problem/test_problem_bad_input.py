"""What a problem makes of vectors, images and losses that are wrong, and of callers that write to its answers."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from toy_problem import toy_problem

from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.problem import (
    Budget,
    DrapeProblem,
    HeterogeneousSpace,
    ProblemError,
)
from cusick_bench.problem.cloth_prior import amplitude_entry
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.errors import DrapeDiverged

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_parameters_must_be_finite(bad):
    problem = toy_problem()
    tau = np.zeros(39)
    tau[5] = bad
    with pytest.raises(ProblemError, match=r"finite, got .* at index 5"):
        problem.evaluate(tau)
    assert problem.meter.forward == 0


def test_parameters_must_have_the_right_number():
    with pytest.raises(ProblemError, match=r"takes 39 numbers, got shape \(3,\)"):
        toy_problem().evaluate(np.zeros(3))


@pytest.mark.unchecked_arrays
def test_what_is_no_batch_is_told_with_its_shape():
    """A single vector was said to have the shape ()."""
    problem = toy_problem()
    for batch in (problem.evaluate_batch, problem.evaluate_and_gradient_batch, problem.observe_batch):
        with pytest.raises(ProblemError, match=r"39 numbers in each row, got shape \(39,\); .* vector\[None\]"):
            batch(np.zeros(39))
        with pytest.raises(ProblemError, match=r"takes 39 numbers, got shape \(3,\)"):
            batch(np.zeros((2, 3)))
    for one in (problem.evaluate, problem.evaluate_and_gradient, problem.observe):
        for tau in (np.zeros((2, 39)), np.zeros(())):
            with pytest.raises(ProblemError, match=re.escape(f"takes 39 numbers, got shape {tau.shape}")):
                one(tau)
    assert problem.meter.forward == 0


def test_a_batch_of_no_vectors_has_no_losses_and_no_gradients():
    problem = toy_problem()
    losses, gradients = problem.evaluate_and_gradient_batch(np.zeros((0, 39)))
    assert (losses.shape, gradients.shape) == ((0,), (0, 39))
    assert problem.evaluate_batch(np.zeros((0, 39))).shape == (0,)
    assert problem.meter.forward_equivalents == 0


def test_failed_drape_is_a_loss_of_infinity_and_paid_for(fail_drapes):
    problem = toy_problem()
    fail_drapes(lambda count: True)
    assert problem.evaluate(np.zeros(39)) == math.inf
    loss, gradient = problem.evaluate_and_gradient(np.zeros(39))
    assert loss == math.inf
    assert (gradient == 0).all()
    with pytest.raises(DrapeDiverged, match="planted"):
        problem.observe(np.zeros(39))
    assert (problem.meter.failed, problem.meter.forward_equivalents) == (3, 4)
    assert problem.meter.trace[0].failure == "planted"


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("space", ["homo", "field"])
def test_vectors_that_stand_for_no_cloth_fail_and_spoil_no_other(space):
    problem = toy_problem(space=space, budget=Budget())
    near, seen = np.zeros(problem.dimension), []
    far, unshaped = np.full(problem.dimension, 2000.0), near.copy()
    assert problem.evaluate(far) == math.inf
    assert "the parameters stand for no cloth: stretch must be finite" in problem.meter.trace[-1].failure
    losses = problem.evaluate_batch(np.stack([far, near]))
    assert losses.tolist() == [math.inf, problem.evaluate(near)]
    expected = problem.evaluate_and_gradient(near)
    found = problem.evaluate_and_gradient_batch(
        np.stack([far, near]), lambda images: seen.extend(images) or images[1].square().sum()
    )
    assert seen == [1]
    assert found[0].tolist() == [math.inf, expected[0]]
    assert not found[1][0].any()
    assert np.abs(found[1][1]).max() > 0
    if space == "field":
        unshaped[amplitude_entry("laying")] = 1e4
        assert problem.evaluate(unshaped) == math.inf
        assert "its shape as laid down or at rest is not finite" in problem.meter.trace[-1].failure


def test_gradient_that_is_not_finite_is_a_failed_drape():
    problem, taus = toy_problem(budget=Budget()), np.zeros((2, 39))
    losses, gradients = problem.evaluate_and_gradient_batch(
        taus, lambda images: images[0].sum() + (images[1] - images[1].detach()).abs().sqrt().sum()
    )
    assert np.isfinite(losses).tolist() == [True, False]
    assert "its gradient is not finite" in problem.meter.trace[-1].failure
    assert np.abs(gradients[0]).max() > 0


def test_what_is_done_to_an_observed_drape_changes_no_later_one():
    problem = toy_problem(mode="equilibrium", budget=Budget())
    seen = problem.observe(np.zeros(39)).vertices
    start = problem._branch.start(1)
    assert start is not None
    before = start.clone()
    seen *= 1000
    assert torch.equal(start, before)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_training_image_may_be_a_mirrored_or_protected_array():
    problem = toy_problem(budget=Budget())
    mirrored = np.flipud(problem.train_image)
    protected = np.ascontiguousarray(mirrored)
    protected.setflags(write=False)
    losses = [replace(problem, train_image=image).evaluate(np.zeros(39)) for image in (mirrored, protected)]
    assert losses[0] == losses[1] != problem.evaluate(np.zeros(39))


def test_errors_of_set_up_are_no_failed_drapes():
    problem = toy_problem()
    wrong = replace(problem)
    object.__setattr__(wrong, "space", HeterogeneousSpace(disc_mesh(90), problem.space.prior))  # else refused at once
    with pytest.raises(ValueError, match="the mesh has"):
        wrong.evaluate(np.zeros(wrong.dimension))


def test_unknown_loss_and_odd_image():
    problem = toy_problem()
    with pytest.raises(ProblemError, match="unknown loss 'l1'"):
        DrapeProblem(problem.train_image, problem.simulator, problem.space, loss="l1")
    with pytest.raises(ProblemError, match="256 x 256"):
        DrapeProblem(np.zeros((64, 64)), problem.simulator, problem.space)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"plate_radius": 0.08}, "plate_radius of the simulator must be that of the space, got 0.08 and 0.09 m"),
        ({"gravity": 9.7}, r"gravity of the simulator must be that of the protocol, got 9\.7 and 9\.8"),
        ({"law": "published"}, r"got 'paper' and 'published', which read .*; give StiffnessPrior\('published'"),
    ],
)
def test_a_simulator_of_another_experiment_is_refused(changes, message):
    """A prior of law `paper` with a simulator of law `published` found four times the stiffness without a word."""
    problem = toy_problem()
    other = DrapeSimulator(problem.simulator.mesh, replace(problem.simulator.settings, **changes))
    with pytest.raises(ProblemError, match=message):
        replace(problem, simulator=other)


def test_a_space_of_another_mesh_is_refused():
    """Fields lay on the wrong elements without a word."""
    problem = toy_problem()
    other = DrapeSimulator(disc_mesh(problem.simulator.mesh.vertices, seed=1), problem.simulator.settings)
    with pytest.raises(ProblemError, match="mesh must be that of the space, got 100 vertices and 100, or the same"):
        replace(problem, simulator=other)
    same = DrapeSimulator(disc_mesh(100), problem.simulator.settings)
    assert replace(problem, simulator=same).simulator is same


def test_a_protocol_with_another_plate_is_refused():
    with pytest.raises(ProblemError, match=r"of the protocol, got 0\.09 and 0\.06 m; give both those of the data"):
        replace(toy_problem(), protocol=replace(RELEASE, plate_radius_m=0.06))


@pytest.mark.unchecked_arrays
def test_bytes_are_no_training_image():
    problem = toy_problem()
    with pytest.raises(ProblemError, match=r"floats in \[0, 1\].* got uint8 from 0 to 255; divide bytes by 255"):
        replace(problem, train_image=np.rint(255 * problem.train_image).astype(np.uint8))
