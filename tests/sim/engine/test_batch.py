"""Batches of drapes against single ones, memory limits of gradients, and branches of rests."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from cusick_bench.sim.cloth.material import Material, uniform_material
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.ring_mesh import ring_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.dynamics.drop import drop, drop_adjoint
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.engine.statics.branch import follow, rim_folds
from cusick_bench.sim.errors import SimulationError

pytestmark = pytest.mark.threads  # members of a batch are shared out among them

MESH, RINGS = disc_mesh(150, seed=2), ring_mesh(297)


def _cloths(count: int, mesh: Mesh = MESH, *, per_element: bool = False, track: bool = False) -> list[Material]:
    generator, cloths = np.random.default_rng(1), []
    for _ in range(count):
        density, bending = np.exp(generator.normal(0, [0.3, 0.7])) * [0.19, 1e-5]
        base = uniform_material(density=float(density), bending=float(bending))
        faces, hinges = (len(mesh.faces), len(mesh.hinges)) if per_element else (1, 1)
        stretch = base.stretch * torch.from_numpy(np.exp(generator.normal(0, 0.1, (faces, 6, 4))))
        bending = base.bending * torch.from_numpy(np.exp(generator.normal(0, 0.1, (hinges, 3, 5))))
        tables = (stretch, bending) if per_element else (stretch[0], bending[0])
        cloths.append(Material(*(table.clone().requires_grad_(track) for table in tables), base.density))
    return cloths


@pytest.mark.parametrize("per_element", [False, True], ids=["shared", "per element"])
@pytest.mark.parametrize("mode", ["drop", "equilibrium"])
def test_batch_equals_single_drapes_bit_for_bit(mode, per_element):
    simulator = DrapeSimulator(MESH, DrapeSettings(mode=mode, steps=25))
    cloths = _cloths(5, per_element=per_element)
    initial = torch.stack([torch.from_numpy(simulator.laid_down(seed)) for seed in range(5)])
    batch = simulator.drape_batch(cloths, initial=initial)
    for member, cloth in enumerate(cloths):
        single = simulator.drape(cloth, initial=initial[member])
        assert torch.equal(batch.vertices[member], single.vertices)
        assert (batch.residual[member], batch.iterations[member]) == (single.residual, single.iterations)
    assert float((batch.vertices[0] - batch.vertices[1]).abs().max()) > 1e-4


@pytest.mark.parametrize("mode", ["drop", "equilibrium"])
def test_batch_gradients_equal_single_ones(mode):
    simulator = DrapeSimulator(MESH, DrapeSettings(mode=mode, steps=15))
    weight = torch.from_numpy(np.random.default_rng(3).normal(size=(3, MESH.vertices, 3)))
    together, apart = _cloths(3, track=True), _cloths(3, track=True)
    (weight * simulator.drape_batch(together).vertices).sum().backward()
    for member, cloth in enumerate(apart):
        (weight[member] * simulator.drape(cloth).vertices).sum().backward()
        for name in ("stretch", "bending"):
            found, expected = getattr(together[member], name).grad, getattr(cloth, name).grad
            assert torch.allclose(found, expected, rtol=1e-9, atol=1e-12 * float(expected.abs().max()))


@pytest.mark.parametrize("per_element", [False, True], ids=["shared", "per element"])
def test_batch_in_lockstep_equals_single_drapes_to_rounding(per_element):
    """Ten cloths: a full pack and a part of one; rounding grows as the cloths buckle."""
    simulator = DrapeSimulator(MESH, DrapeSettings(steps=15, backend="lockstep"))
    cloths = _cloths(10, per_element=per_element)
    initial = torch.stack([torch.from_numpy(simulator.laid_down(seed)) for seed in range(10)])
    batch = simulator.drape_batch(cloths, initial=initial)
    for member in (0, 7, 8, 9):
        single = simulator.drape(cloths[member], initial=initial[member])
        assert float((batch.vertices[member] - single.vertices).abs().max()) < 1e-11
        assert batch.residual[member] == pytest.approx(single.residual, rel=1e-6)
    some = simulator.drape_batch([cloths[8], cloths[3]], initial=initial[[8, 3]])
    assert torch.equal(some.vertices, batch.vertices[[8, 3]])


@pytest.mark.parametrize("per_element", [False, True], ids=["shared", "per element"])
@pytest.mark.parametrize("backend", ["auto", "lockstep"])
def test_a_shell_is_the_same_to_the_bit_in_any_batch(backend, per_element):
    """Nine cloths are a pack of lanes and one more, where there is one thread."""
    simulator = DrapeSimulator(RINGS, DrapeSettings(steps=4, law="plate", backend=backend))
    cloths = _cloths(9, RINGS, per_element=per_element)
    initial = torch.stack([torch.from_numpy(simulator.laid_down(seed)) for seed in range(9)])
    batch = simulator.drape_batch(cloths, initial=initial).vertices
    for some in ([8, 3], [7, 0, 2, 4, 5]):
        again = simulator.drape_batch([cloths[place] for place in some], initial=initial[some]).vertices
        assert torch.equal(again, batch[some])


def test_batches_of_shells_equal_single_drapes():
    """Law `plate`: to the bit one after the other, to rounding in lockstep; three cloths do not part evenly in twos."""
    one_by_one = DrapeSimulator(MESH, DrapeSettings(steps=6, law="plate"))
    lockstep = DrapeSimulator(MESH, DrapeSettings(steps=6, law="plate", backend="lockstep"))
    cloths = _cloths(3)
    initial = torch.stack([torch.from_numpy(one_by_one.laid_down(seed)) for seed in range(3)])
    batches = [simulator.drape_batch(cloths, initial=initial).vertices for simulator in (one_by_one, lockstep)]
    for member, cloth in enumerate(cloths):
        single = one_by_one.drape(cloth, initial=initial[member]).vertices
        assert torch.equal(batches[0][member], single)
        assert float((batches[1][member] - single).abs().max()) < 1e-11


@pytest.mark.parametrize("memory", [2**30, 0], ids=["factors kept", "computed again"])
def test_gradients_in_lockstep_equal_single_ones(memory):
    settings = DrapeSettings(steps=15)
    simulator = DrapeSimulator(MESH, replace(settings, backend="lockstep"), factor_memory=memory)
    weight = torch.from_numpy(np.random.default_rng(3).normal(size=(10, MESH.vertices, 3)))
    together, apart = _cloths(10, track=True), _cloths(10, track=True)
    (weight * simulator.drape_batch(together).vertices).sum().backward()
    for member in (1, 9):
        (weight[member] * DrapeSimulator(MESH, settings).drape(apart[member]).vertices).sum().backward()
        for name in ("stretch", "bending"):
            found, expected = getattr(together[member], name).grad, getattr(apart[member], name).grad
            assert torch.allclose(found, expected, rtol=1e-8, atol=1e-10 * float(expected.abs().max()))


@pytest.mark.parametrize("backend", ["multifrontal", "lockstep", "splu"])
def test_diverged_member_is_reported_and_spoils_no_other(backend):
    simulator = DrapeSimulator(MESH, DrapeSettings(steps=10, backend=backend))
    cloths = _cloths(4, track=True)
    cloths[1] = Material(-cloths[1].stretch.detach() * 1e3, cloths[1].bending, cloths[1].density)
    batch = simulator.drape_batch(cloths)
    assert [failure is not None for failure in batch.failures] == [False, True, False, False]
    assert "positive definite" in str(batch.failures[1])
    assert torch.isnan(batch.vertices[1]).all()
    assert np.isnan(batch.residual[1])
    assert not batch.converged[1]
    rounding = 1e-12 if backend == "lockstep" else 0.0
    for member in (0, 2, 3):
        single = simulator.drape(cloths[member]).vertices.detach()
        assert float((batch.vertices[member].detach() - single).abs().max()) <= rounding
    batch.vertices[[0, 2, 3]].sum().backward()
    gradient = cloths[2].stretch.grad
    assert gradient is not None
    assert torch.isfinite(gradient).all()
    assert float(gradient.abs().max()) > 0


def test_all_members_diverged_is_no_crash():
    cloth = _cloths(1)[0]
    bad = Material(-cloth.stretch * 1e3, cloth.bending, cloth.density)
    batch = DrapeSimulator(MESH, DrapeSettings(steps=3)).drape_batch([bad, bad])
    assert all(failure is not None for failure in batch.failures)
    assert torch.isnan(batch.vertices).all()


def test_batches_need_cloths_of_one_kind():
    simulator = DrapeSimulator(MESH, DrapeSettings(steps=2))
    with pytest.raises(SimulationError, match="at least one cloth"):
        simulator.drape_batch([])
    with pytest.raises(SimulationError, match="all cloths of a batch have tables per element"):
        simulator.drape_batch([*_cloths(1), *_cloths(1, per_element=True)])
    with pytest.raises(SimulationError, match="initial must be finite with shape"):
        simulator.drape_batch(_cloths(2), initial=torch.zeros((3, MESH.vertices, 3), dtype=torch.float64))
    with pytest.raises(SimulationError, match="warm starts are for mode"):
        simulator.drape_batch(_cloths(1), warm=torch.zeros((1, MESH.vertices, 3), dtype=torch.float64))


@pytest.mark.unchecked_arrays
def test_shapes_for_all_cloths_are_asked_for_with_their_number():
    simulator, one = DrapeSimulator(MESH, DrapeSettings(steps=2)), torch.from_numpy(MESH.flat)
    for cloths in (1, 2):
        with pytest.raises(SimulationError, match=rf"with shape \({cloths}, 150, 3\), got shape \(150, 3\)"):
            simulator.drape_batch(_cloths(cloths), initial=one)
    with pytest.raises(SimulationError, match=r"with shape \(150, 3\), got shape \(1, 150, 3\)"):
        simulator.drape(_cloths(1)[0], initial=one[None])
    with pytest.raises(SimulationError, match=r"with shape \(150, 3\), got NaN or infinity"):
        simulator.drape(_cloths(1)[0], initial=one * torch.nan)


@pytest.mark.parametrize(
    ("mesh", "settings"),
    [(MESH, {"steps": 4}), (RINGS, {"steps": 4, "law": "plate"}), (MESH, {"steps": 15, "mode": "equilibrium"})],
    ids=["drop", "shell", "equilibrium"],
)
def test_a_loss_without_a_finite_derivative_spoils_the_gradient_of_its_own_cloth_alone(mesh, settings):
    simulator, cloths = DrapeSimulator(mesh, DrapeSettings(**settings)), _cloths(2, mesh, track=True)
    vertices = simulator.drape_batch(cloths).vertices
    (vertices[0].sum() + (vertices[1] - vertices[1].detach()).abs().sqrt().sum()).backward()
    alone = _cloths(1, mesh, track=True)[0]
    simulator.drape(alone).vertices.sum().backward()
    assert torch.isnan(cloths[1].bending.grad).all()
    expected = alone.bending.grad
    assert torch.allclose(cloths[0].bending.grad, expected, rtol=1e-9, atol=1e-12 * float(expected.abs().max()))


def _gradient(simulator: DrapeSimulator, again: bool = False) -> torch.Tensor:
    cloth = _cloths(1, track=True)[0]
    total = simulator.drape(cloth).vertices.sum()
    total.backward(retain_graph=again)
    if again:
        cloth.stretch.grad = None
        total.backward()
    assert cloth.stretch.grad is not None
    return cloth.stretch.grad


@pytest.mark.parametrize("limit", [0, 3])
def test_memory_limit_changes_no_gradient(limit):
    settings = DrapeSettings(steps=12)
    kept = DrapeSimulator(MESH, settings)
    size = drop(
        kept.system, _parameters(kept), kept.laid_down(), steps=1, step_seconds=0.05, keep_factors=True
    ).factors[0]
    assert size is not None
    limited = DrapeSimulator(MESH, settings, factor_memory=limit * size.nbytes)
    assert torch.equal(_gradient(kept), _gradient(limited))
    assert torch.equal(_gradient(kept), _gradient(kept, again=True))


def _parameters(simulator: DrapeSimulator) -> Parameters:
    cloth = _cloths(1)[0]
    arrays = (cloth.stretch[None], cloth.bending[None], cloth.vertex_mass(MESH), simulator.rest_angles())
    return Parameters(*(array.numpy() for array in arrays))


def test_factors_are_kept_within_the_limit():
    simulator = DrapeSimulator(MESH, DrapeSettings())
    arguments = (simulator.system, _parameters(simulator), simulator.laid_down())
    one = drop(*arguments, steps=1, step_seconds=0.05, keep_factors=True).factors[0]
    assert one is not None
    rollout = drop(*arguments, steps=6, step_seconds=0.05, keep_factors=True, factor_memory=int(2.5 * one.nbytes))
    assert [factor is not None for factor in rollout.factors] == [True, True, False, False, False, False]
    unrecorded = drop(*arguments, steps=6, step_seconds=0.05, record=False)
    assert np.array_equal(unrecorded.positions[-1], rollout.positions[-1])
    assert len(unrecorded.positions) == 1
    with pytest.raises(SimulationError, match="record=True"):
        drop_adjoint(*arguments[:2], unrecorded, np.ones_like(arguments[2]), step_seconds=0.05)


def test_rim_folds_counts_waves_of_the_rim():
    mesh = disc_mesh(600)
    angle, radius = np.arctan2(*mesh.material.T[::-1]), np.hypot(*mesh.material.T)
    for folds in (5, 9):
        wave = 1 - 0.08 * (radius / 0.15) ** 2 * (1 + np.cos(folds * angle))
        assert rim_folds(mesh, wave[:, None] * mesh.flat) == folds
    assert rim_folds(mesh, mesh.flat) == 0
    before, after = ((1 - 0.08 * (radius / 0.15) ** 2 * (1 + np.cos(n * angle)))[:, None] * mesh.flat for n in (7, 8))
    assert follow(mesh, before, after).changed
    assert not follow(mesh, before, before).changed
    assert follow(mesh, before, after).moved == pytest.approx(np.linalg.norm(after - before, axis=1).max())


def test_warm_start_that_snaps_to_other_folds_says_so():
    simulator = DrapeSimulator(disc_mesh(297), DrapeSettings(mode="equilibrium"))
    limp, near, stiff = (uniform_material(density=0.2, bending=b) for b in (4e-6, 4.02e-6, 4e-4))
    start = simulator.drape(limp)
    kept, lost = simulator.drape(near, warm=start), simulator.drape(stiff, warm=start)
    assert start.branch is None
    assert kept.branch is not None
    assert lost.branch is not None
    assert not kept.branch.changed
    assert lost.branch.changed
    assert lost.branch.folds_after < lost.branch.folds_before
