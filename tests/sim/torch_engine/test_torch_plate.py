"""Law `plate` on the torch engine: forces, adjoint and drops against the compiled shell."""

from functools import cache
from typing import Any

import numpy as np
import pytest
import torch
from plate_cloths import STATES, dense_matrix, plate_unknowns, random_cloths, random_state, taut_laid

from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.drape import DrapeBatch, DrapeSimulator
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.plate.unknowns import ShellUnknowns
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.torch_engine.drop import prepared
from cusick_bench.sim.torch_engine.forces import BatchParameters
from cusick_bench.sim.torch_engine.rollout import adjoint, plan_batch, rollout
from cusick_bench.sim.torch_engine.shell_forces import TorchShell
from cusick_bench.sim.torch_engine.shell_maps import ShellMaps

pytestmark = pytest.mark.usefixtures("one_torch_thread")

NAMES = ("stretch", "bending", "mass", "rest_angle", "poisson")
CUDA = pytest.mark.skipif(not torch.cuda.is_available(), reason="torch sees no CUDA device")
DEVICES = ["cpu", pytest.param("cuda", marks=CUDA)]
MESH = disc_mesh(97, seed=1)


@cache
def _unknowns() -> ShellUnknowns:
    return plate_unknowns()


def _batch(p: Parameters, device: str) -> BatchParameters:
    return BatchParameters(*(torch.from_numpy(getattr(p, name)).to(device) for name in NAMES))


def _relative(found: torch.Tensor, expected: np.ndarray) -> float:
    return float(np.abs(found.detach().cpu().numpy() - expected).max() / np.abs(expected).max())


@pytest.mark.parametrize("elementwise", [False, True], ids=["shared", "per element"])
@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("device", DEVICES)
def test_maps_forces_and_stiffness_equal_the_compiled_ones(device: str, state: str, elementwise: bool):
    unknowns = _unknowns()
    system = unknowns.system
    p, x = random_cloths(system, 2, elementwise=elementwise), random_state(system, state, 2)
    own, maps = unknowns.parameters(p), ShellMaps(unknowns, device)
    mapped = maps.parameters(_batch(p, device))
    for name in NAMES:
        assert _relative(getattr(mapped, name), getattr(own, name)) < 1e-13, name
    there = torch.from_numpy(x).to(device)
    assert _relative(maps.positions(there), unknowns.positions(x)) < 1e-14
    forces = TorchShell(system, device)
    force, blocks = forces.evaluate(there, there, mapped)
    expected = system.evaluate(x, x, own, exact=False)
    assert _relative(force, expected.force()) < 1e-11
    matrices = expected.matrix(diagonal=np.zeros((2, system.mesh.vertices)))
    for member in range(2):
        found = dense_matrix(system, blocks[member].cpu().numpy())
        assert _relative(torch.from_numpy(found), dense_matrix(system, matrices[member])) < 1e-11


@pytest.mark.parametrize("elementwise", [False, True], ids=["shared", "per element"])
@pytest.mark.parametrize("state", list(STATES)[1:])
@pytest.mark.parametrize("device", DEVICES)
def test_adjoint_products_equal_the_compiled_ones(device: str, state: str, elementwise: bool):
    unknowns = _unknowns()
    system, factors = unknowns.system, {"force_factor": 0.05, "stiffness_factor": 0.0025}
    own = unknowns.parameters(random_cloths(system, 2, elementwise=elementwise))
    x, generator = random_state(system, state, 2), np.random.default_rng(9)
    multiplier, velocity = np.zeros_like(x), np.zeros_like(x)
    for field in (multiplier, velocity):
        field[:, system.free] = generator.normal(size=(2, len(system.free), 3))
    gradient = system.zero_gradient(2)
    by_x, _ = system.adjoint(x, multiplier, velocity, own, gradient, **factors)
    there, along, across = (torch.from_numpy(field).to(device) for field in (x, multiplier, velocity))
    found_x, pull, found = TorchShell(system, device).adjoint(there, along, across, _batch(own, device), **factors)
    assert _relative(found_x, by_x) < 1e-9
    assert not pull.any()
    for name in NAMES:
        ours, expected = getattr(found, name), getattr(gradient, name)
        expected = expected.sum(1, keepdims=True) if ours.shape != expected.shape else expected
        assert _relative(ours, expected) < 1e-9, name


def _everything(device: str, *, elementwise: bool) -> tuple[DrapeBatch, dict[str, torch.Tensor]]:
    """A batch of three, and the gradients of a random function of its positions."""
    simulator = DrapeSimulator(MESH, DrapeSettings(law="plate", steps=12), device=device)
    system = _unknowns().system
    p = random_cloths(system, 3, elementwise=elementwise)
    generator = np.random.default_rng(2)
    density = generator.uniform(0.1, 0.3, (3, len(MESH.faces)) if elementwise else 3)
    leaves: dict[str, torch.Tensor] = {}
    for name, values in {"stretch": p.stretch, "bending": p.bending, "density": density, "poisson": p.poisson}.items():
        for member, value in enumerate(values):
            array = np.array(value) if elementwise or name in ("density", "poisson") else value[0]
            leaves[f"{name} {member}"] = torch.from_numpy(np.array(array)).requires_grad_()
    cloths = [
        Material(*(leaves[f"{name} {i}"] for name in ("stretch", "bending", "density", "poisson"))) for i in range(3)
    ]
    leaves["laid"] = torch.from_numpy(taut_laid(system, 3)).requires_grad_()
    leaves["angles"] = torch.from_numpy(p.rest_angle).requires_grad_()
    batch = simulator.drape_batch(cloths, initial=leaves["laid"], rest_angle=leaves["angles"])
    weight = torch.from_numpy(np.random.default_rng(3).normal(size=(3, MESH.vertices, 3)))
    (weight.to(batch.vertices.device) * batch.vertices).sum().backward()
    return batch, {name: leaf.grad for name, leaf in leaves.items() if leaf.grad is not None}


@pytest.mark.parametrize("elementwise", [False, True], ids=["shared", "per element"])
@pytest.mark.parametrize("device", ["cpu:torch", pytest.param("cuda", marks=CUDA)])
def test_drops_and_gradients_equal_the_compiled_ones(device: str, elementwise: bool):
    (ours, found), (compiled, expected) = (_everything(name, elementwise=elementwise) for name in (device, "cpu"))
    assert ours.vertices.device.type == device.split(":")[0]
    assert float((ours.vertices.detach().cpu() - compiled.vertices.detach()).abs().max()) < 1e-9
    assert float((ours.vertices[0] - ours.vertices[1]).detach().abs().max()) > 1e-3
    assert found.keys() == expected.keys()
    assert len(found) == 14
    for name, gradient in expected.items():
        assert _relative(found[name], gradient.numpy()) < 1e-6, name
    assert np.allclose(ours.residual, compiled.residual, rtol=1e-6)
    assert ours.failures == compiled.failures == [None] * 3


def test_drops_repeat_bit_by_bit_and_memory_limits_change_nothing_else():
    system = _unknowns().system
    laid = torch.from_numpy(taut_laid(system, 5))
    p = random_cloths(system, 5, elementwise=False)
    cloths = [
        Material(torch.from_numpy(p.stretch[i, 0]), torch.from_numpy(p.bending[i, 0]), torch.tensor(0.2))
        for i in range(5)
    ]
    settings = DrapeSettings(law="plate", steps=5)
    free = DrapeSimulator(MESH, settings, device="cpu:torch")
    limited = DrapeSimulator(MESH, settings, device="cpu:torch", device_memory=6 * 2**20)
    assert 1 <= limited.at_once() < 5 < free.at_once()
    once, again, in_groups = (s.drape_batch(cloths, initial=laid).vertices for s in (free, free, limited))
    assert torch.equal(once, again)
    assert float((once - laid).abs().max()) > 0
    assert float((once - in_groups).abs().max()) < 1e-12


def test_a_cloth_that_is_not_laid_flat_on_the_plate_is_named():
    simulator = DrapeSimulator(MESH, DrapeSettings(law="plate", steps=1), device="cpu:torch")
    laid = torch.from_numpy(taut_laid(_unknowns().system, 1))
    laid[0, int(np.flatnonzero(_unknowns().system.fixed)[0]), 2] += 1e-3
    cloth = Material(torch.full((6, 4), 100.0), torch.full((3, 5), 1e-5), torch.tensor(0.2))
    with pytest.raises(SimulationError, match="law 'plate' holds the cloth flat"):
        simulator.drape_batch([cloth], initial=laid)


def test_steps_never_wait_for_the_device():
    """Tensors without values: looking at one, or mixing devices, raises."""
    unknowns = _unknowns()
    system = unknowns.system
    forces, linear = prepared(system, "meta")
    plan = plan_batch(forces, linear, 2, steps=2, h=0.05, limit=2**28, differentiate=True)
    p = random_cloths(system, 2, elementwise=True)
    maps = ShellMaps(unknowns, "meta")
    mapped, anchor = maps.parameters(_batch(p, "meta")), torch.from_numpy(taut_laid(system, 2)).to("meta")
    x, record = rollout(plan, mapped, anchor, 2, keep=1)
    gradient, by_initial = adjoint(plan, mapped, anchor, record, torch.ones_like(x))
    assert maps.positions(x).shape == by_initial.shape == anchor.shape
    found: dict[str, Any] = {name: getattr(gradient, name).shape for name in NAMES}
    assert found == {name: getattr(mapped, name).shape for name in NAMES}
