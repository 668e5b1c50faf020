"""Law `plate`: compiled kernels against plain torch autograd written from the equations."""

from functools import cache

import numpy as np
import pytest
import torch
from plate_cloths import STATES, dense_matrix, plate_unknowns, random_cloths, random_state, taut_laid

from cusick_bench.sim.engine.dynamics.drop import drop, drop_adjoint
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.plate.unknowns import ShellUnknowns
from cusick_bench.sim.laws.plate import curvature_shares, plate_bending, plate_stiffness, squared_curvature
from cusick_bench.sim.reference.plate import PlateParameters, PlateReference, mean_weights
from cusick_bench.sim.reference.tables import weights_bending_paper

pytestmark = pytest.mark.usefixtures("one_torch_thread")

NAMES = ("stretch", "bending", "mass", "rest_angle", "poisson")


@cache
def _case() -> tuple[ShellUnknowns, PlateReference]:
    unknowns = plate_unknowns()
    return unknowns, PlateReference(unknowns.system)


def _torch(p: Parameters, *, grad: bool = False) -> PlateParameters:
    arrays = (getattr(p.member(0), name) for name in NAMES)
    return PlateParameters(*(torch.from_numpy(np.array(array)).requires_grad_(grad) for array in arrays))


def _relative(found, expected) -> float:
    found, expected = (a.detach().numpy() if isinstance(a, torch.Tensor) else a for a in (found, expected))
    return float(np.abs(found - expected).max() / np.abs(expected).max())


@pytest.mark.parametrize("elementwise", [False, True], ids=["shared", "per element"])
@pytest.mark.parametrize("state", STATES)
def test_energy_forces_and_step_stiffness_equal_plain_torch(state: str, elementwise: bool):
    unknowns, reference = _case()
    system = unknowns.system
    p, x = random_cloths(system, 1, elementwise=elementwise), random_state(system, state)
    evaluated = system.evaluate(x, x, unknowns.parameters(p), exact=False)
    there, cloth = torch.from_numpy(x[0]), _torch(p)
    assert float(evaluated.energy()[0]) == pytest.approx(float(reference.energy(there, cloth)), rel=1e-10)
    assert _relative(evaluated.force()[0, system.free], reference.forces(there, cloth)) < 1e-10
    assert not evaluated.force()[0, system.fixed].any()
    blocks = evaluated.matrix(diagonal=np.zeros((1, system.mesh.vertices)))[0]
    assert _relative(dense_matrix(system, blocks), reference.gauss_newton(there, cloth)) < 1e-10


@pytest.mark.parametrize("state", list(STATES)[1:])
def test_exact_stiffness_is_the_hessian_of_the_energy(state: str):
    unknowns, reference = _case()
    system = unknowns.system
    p, x = random_cloths(system, 1, elementwise=True), random_state(system, state)
    blocks = system.evaluate(x, x, unknowns.parameters(p), exact=True).matrix(
        diagonal=np.zeros((1, system.mesh.vertices))
    )[0]
    cloth, there = _torch(p), torch.from_numpy(x[0])

    direction = np.random.default_rng(8).normal(size=(len(system.free), 3))
    moving = there.requires_grad_()
    along = (reference.forces(moving, cloth) * torch.from_numpy(direction)).sum()
    product = -torch.autograd.grad(along, moving)[0][reference.free]
    assert _relative(dense_matrix(system, blocks) @ direction.ravel(), product.flatten()) < 1e-10


@pytest.mark.parametrize("state", STATES)
def test_curvatures_and_moments_equal_plain_torch(state: str):
    unknowns, reference = _case()
    system = unknowns.system
    p, x = random_cloths(system, 1, elementwise=True), random_state(system, state)
    own, there, cloth = unknowns.parameters(p).member(0), torch.from_numpy(x[0]), _torch(p)
    curvature = system.curvature(x[0]) - own.rest_angle.reshape(-1, 3)
    assert np.abs(curvature - reference.bent(there, cloth).numpy()).max() < 1e-10 * np.abs(curvature).max()
    shares, stiffness, moments = np.empty((3, 5)), np.empty((3, 4)), np.empty_like(curvature)
    for edge, k in enumerate(curvature):
        curvature_shares(squared_curvature(k), shares)
        plate_stiffness(own.bending[edge], float(own.poisson), shares, stiffness)
        moments[edge] = plate_bending(k, stiffness)[1]
    assert _relative(moments, reference.moments(there, cloth)) < 1e-10


def test_states_reach_every_piece_of_the_bending_tables():
    unknowns, reference = _case()
    p = _torch(random_cloths(unknowns.system, 1, elementwise=True))
    sizes, floored = [], 0
    for state in STATES:
        k = reference.bent(torch.from_numpy(random_state(unknowns.system, state)[0]), p)
        sizes.append((k[:, 0] ** 2 + k[:, 1] ** 2 + k[:, 2] ** 2 / 2).sqrt())
        d = reference.bending_matrix(k, p)
        floored += int((d[:, 2, 2] < 0.1 * (d[:, 0, 0] * d[:, 1, 1]).sqrt()).sum())
    pieces = torch.bucketize(torch.cat(sizes), torch.tensor([5.0, 15.0, 25.0, 35.0, 45.0], dtype=torch.float64))
    assert set(pieces.tolist()) == set(range(6))
    assert 0 < floored < len(torch.cat(sizes)) / 2


@pytest.mark.parametrize("curvature", [0.3, 7.0, 23.0, 44.0, 80.0])
def test_a_cylinder_has_the_moment_that_the_table_says(curvature: float):
    """B(k) k as law `paper` reads B: the means over curvature are made for it."""
    row = torch.tensor([1.0, 3.0, 2.0, 5.0, 4.0], dtype=torch.float64)
    k = torch.tensor([curvature], dtype=torch.float64, requires_grad=True)
    (moment,) = torch.autograd.grad((mean_weights(k**2) @ row * k**2 / 2).sum(), k)
    expected = float(weights_bending_paper(k.detach())[0] @ row) * curvature
    assert float(moment) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("state", list(STATES)[1:])
@pytest.mark.parametrize("elementwise", [False, True], ids=["shared", "per element"])
def test_adjoint_products_equal_autograd(state: str, elementwise: bool):
    """Derivatives of S = h lambda . F - h^2 lambda . K v."""
    unknowns, reference = _case()
    system = unknowns.system
    p, x = random_cloths(system, 1, elementwise=elementwise), random_state(system, state)
    generator = np.random.default_rng(9)
    multiplier, velocity = np.zeros_like(x), np.zeros_like(x)
    for field in (multiplier, velocity):
        field[:, system.free] = generator.normal(size=(1, len(system.free), 3))
    gradient = system.zero_gradient(1)
    by_x, _ = system.adjoint(
        x, multiplier, velocity, unknowns.parameters(p), gradient, force_factor=0.05, stiffness_factor=0.0025
    )
    found, _ = unknowns.gradient(gradient, np.zeros_like(x))
    cloth, there = _torch(p, grad=True), torch.from_numpy(x[0]).requires_grad_()
    along, across = (torch.from_numpy(field[0, system.free]) for field in (multiplier, velocity))
    product = 0.05 * (along * reference.forces(there, cloth)).sum()
    product = product - 0.0025 * along.flatten() @ reference.gauss_newton(there, cloth) @ across.flatten()
    product.backward()
    assert _relative(by_x[0], there.grad) < 1e-9
    for name in NAMES:
        ours, expected = getattr(found, name)[0], getattr(cloth, name).grad.numpy()
        ours = ours.sum(0, keepdims=True) if ours.shape != expected.shape else ours
        assert _relative(ours, expected) < 1e-9, name


def test_drop_and_its_adjoint_equal_autograd_through_every_step():
    unknowns, reference = _case()
    system = unknowns.system
    p, laid = random_cloths(system, 1, elementwise=True), taut_laid(system, 1)
    own, start = unknowns.parameters(p).member(0), unknowns.configuration(laid)[0]
    rollout = drop(system, own, start, steps=4, step_seconds=0.05)
    weight = np.random.default_rng(7).normal(size=start.shape)
    by_last = unknowns.by_configuration(weight[None])
    gradient, by_start = drop_adjoint(system, own, rollout, by_last[0], step_seconds=0.05)
    found, by_laid = unknowns.gradient(gradient.batch(), by_start[None])
    cloth, begin = _torch(p, grad=True), torch.from_numpy(start).requires_grad_()
    last = reference.drop(cloth, begin, steps=4, step_seconds=0.05)
    positions = reference.positions(last)
    assert np.abs(unknowns.positions(rollout.positions[-1][None])[0] - positions.detach().numpy()).max() < 1e-11
    assert float((positions.detach() - reference.positions(begin).detach()).abs().max()) > 5e-3
    (positions * torch.from_numpy(weight)).sum().backward()
    assert begin.grad is not None
    assert _relative(by_start, begin.grad) < 1e-8
    assert by_laid.shape == (1, *start.shape)
    for name in NAMES:
        assert _relative(getattr(found, name)[0], getattr(cloth, name).grad) < 1e-8, name
