"""A cloth that a drop's long steps blow up falls again in shorter ones: its drape, its gradient, and the other cloths.

The cloths are those of `cusick-bench robustness`: 16 is so limp that steps of 50 ms blow it up on either mesh, 4 and 6
do on the mesh of law `paper`.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from cusick_bench.benchmark.robustness import robustness, specimen
from cusick_bench.sim.cloth.material import Material, uniform_material
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.cloth.ring_mesh import ring_mesh
from cusick_bench.sim.drape import DrapeBatch, DrapeSimulator
from cusick_bench.sim.engine.dynamics import drop_batch
from cusick_bench.sim.engine.dynamics.drop import drop_adjoint
from cusick_bench.sim.engine.settings import MOST_HALVINGS, DrapeSettings
from cusick_bench.sim.errors import DrapeDiverged

STEPS = 15
WILD, CALM = 16, (3, 5)
SHELL = DrapeSimulator(ring_mesh(97), DrapeSettings(law="plate", steps=STEPS))
HINGES = DrapeSimulator(disc_mesh(150), DrapeSettings(law="paper", steps=STEPS))
LAWS = pytest.mark.parametrize("simulator", [SHELL, HINGES], ids=["plate", "paper"])


def _laid(simulator: DrapeSimulator, seed: int) -> torch.Tensor:
    return torch.from_numpy(simulator.laid_down(seed))


def _batch(simulator: DrapeSimulator, seeds: tuple[int, ...], materials: list[Material] | None = None) -> DrapeBatch:
    laid = torch.stack([_laid(simulator, seed) for seed in seeds])
    return simulator.drape_batch(materials or [specimen(seed).material for seed in seeds], initial=laid)


def _shorter(simulator: DrapeSimulator, halvings: int) -> DrapeSimulator:
    """The same fall in shorter steps from the beginning."""
    s = simulator.settings
    shorter = replace(s, steps=s.steps * 2**halvings, step_seconds=s.step_seconds / 2**halvings)
    return DrapeSimulator(simulator.mesh, shorter)


def _cloth(base: Material, shift: float, simulator: DrapeSimulator) -> tuple[Material, torch.Tensor]:
    """A cloth and its laying, changed a little along one direction in all that has gradients."""
    laid, material = _laid(simulator, WILD), base
    bump = torch.linspace(0.0, 1e-3, len(laid), dtype=torch.float64)[:, None] * torch.tensor([0.0, 0.0, 1.0])
    material = Material(material.stretch * (1 + shift), material.bending * (1 - shift), material.density * (1 + shift))
    return material, laid + shift * bump


@LAWS
def test_a_cloth_that_flies_apart_falls_in_shorter_steps_and_spoils_no_other(simulator: DrapeSimulator):
    batch = _batch(simulator, (CALM[0], WILD, CALM[1]))
    halvings = int(batch.halvings[1])
    assert batch.failures == [None] * 3
    assert batch.halvings.tolist() == [0, halvings, 0]
    assert 1 <= halvings <= MOST_HALVINGS
    assert batch.iterations.tolist() == [STEPS, STEPS * 2**halvings, STEPS]
    expected = _batch(_shorter(simulator, halvings), (WILD,))
    assert torch.equal(batch.vertices[1], expected.vertices[0])
    assert batch.residual[1] == expected.residual[0]
    assert batch.member(1).halvings == halvings
    calm = _batch(simulator, CALM)  # without the wild one
    assert torch.equal(batch.vertices[[0, 2]], calm.vertices)
    assert batch.residual[[0, 2]].tolist() == calm.residual.tolist()


@LAWS
def test_no_longer_step_would_have_done(simulator: DrapeSimulator):
    halvings = int(_batch(simulator, (WILD,)).halvings[0])
    longer = _batch(_shorter(simulator, halvings - 1), (WILD,))
    assert longer.halvings.tolist() == [1]


@LAWS
def test_gradient_of_a_cloth_whose_step_was_halved_equals_central_differences(simulator: DrapeSimulator):
    weight = torch.from_numpy(np.random.default_rng(1).normal(size=(simulator.mesh.vertices, 3)))
    base = specimen(WILD).material

    def value(shift: float) -> float:
        material, laid = _cloth(base, shift, simulator)
        drape = simulator.drape(material, initial=laid)
        assert drape.halvings > 0
        return float((weight * drape.vertices).sum())

    shift = torch.zeros((), dtype=torch.float64, requires_grad=True)
    material, laid = _cloth(base, shift, simulator)  # pyright: ignore[reportArgumentType]
    (weight * simulator.drape(material, initial=laid).vertices).sum().backward()
    assert shift.grad is not None
    h = 1e-7  # folds of a cloth that nearly flew apart turn within 1e-5
    slope = (8 * (value(h) - value(-h)) - value(2 * h) + value(-2 * h)) / (12 * h)
    assert float(shift.grad) == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize("memory", [2**30, 0], ids=["factors kept", "computed again"])
def test_gradients_of_a_batch_are_those_of_each_cloths_own_steps(memory: int):
    simulator = DrapeSimulator(HINGES.mesh, HINGES.settings, factor_memory=memory)
    seeds = (CALM[0], WILD, 4, CALM[1])

    def gradients(numbers: tuple[int, ...]) -> list[torch.Tensor]:
        materials = [specimen(number).material for number in numbers]
        tensors = [material.bending.clone().requires_grad_() for material in materials]
        cloths = [Material(m.stretch, b, m.density) for m, b in zip(materials, tensors, strict=True)]
        batch = _batch(simulator, numbers, cloths)
        grid = torch.linspace(-1.0, 1.0, batch.vertices[0].numel(), dtype=torch.float64).reshape(-1, 3)
        (grid * batch.vertices).sum().backward()
        return [tensor.grad for tensor in tensors if tensor.grad is not None]

    assert len(set(_batch(simulator, seeds).halvings.tolist())) == 3  # none, once and twice
    for together, seed in zip(gradients(seeds), seeds, strict=True):
        (alone,) = gradients((seed,))
        assert torch.allclose(together, alone, rtol=1e-9, atol=1e-12 * float(alone.abs().max()))


def test_the_way_back_leaves_out_drops_that_no_cloth_keeps(monkeypatch: pytest.MonkeyPatch):
    steps: list[float] = []

    def counted(*arguments: object, step_seconds: float, plain: Callable[..., object] = drop_adjoint) -> object:
        steps.append(step_seconds)
        return plain(*arguments, step_seconds=step_seconds)

    monkeypatch.setattr("cusick_bench.sim.engine.dynamics.drop_batch.drop_adjoint", counted)
    material = specimen(WILD).material
    tensor = material.bending.clone().requires_grad_()
    batch = _batch(HINGES, (WILD,), [Material(material.stretch, tensor, material.density)])
    batch.vertices.square().sum().backward()
    assert steps == [HINGES.settings.step_seconds / 2 ** int(batch.halvings[0])]
    assert tensor.grad is not None
    assert float(tensor.grad.abs().max()) > 0


@pytest.mark.slow
def test_the_torch_engine_halves_the_same_cloths():
    for simulator, seeds in product((SHELL, HINGES), [(CALM[0], WILD, CALM[1])]):
        compiled = _batch(simulator, seeds)
        other = DrapeSimulator(simulator.mesh, simulator.settings, device="cpu:torch")
        cloths = [specimen(seed).material for seed in seeds]
        density = cloths[1].density.clone().requires_grad_()
        cloths[1] = Material(cloths[1].stretch, cloths[1].bending, density)
        batch = _batch(other, seeds, cloths)
        assert batch.halvings.tolist() == compiled.halvings.tolist()
        assert batch.iterations.tolist() == compiled.iterations.tolist()
        assert batch.failures == [None] * 3
        assert float((batch.vertices.detach() - compiled.vertices).abs().max()) < 1e-7  # rounding, many times amplified
        batch.vertices[1].square().sum().backward()
        assert density.grad is not None
        assert torch.isfinite(density.grad)
        assert float(density.grad.abs()) > 0


def test_settings_of_the_published_program_do_not_halve():
    for settings in (DrapeSettings(law="published"), DrapeSettings(support="springs"), DrapeSettings(clamp="whole")):
        assert settings.halvings == 0
    whole = DrapeSimulator(HINGES.mesh, replace(HINGES.settings, clamp="whole", step_seconds=0.1))
    with pytest.raises(DrapeDiverged, match=r"the cloth flies apart.* use a shorter step than 0\.1 s"):
        whole.drape(specimen(WILD).material, initial=_laid(HINGES, WILD))


def test_a_cloth_that_no_step_saves_says_which_was_the_shortest():
    falls_freely = uniform_material(density=0.2, bending=1e-12, stretch=1e-9, shear=1e-9)
    simulator = DrapeSimulator(HINGES.mesh, replace(HINGES.settings, steps=20))
    batch = simulator.drape_batch([falls_freely, specimen(CALM[0]).material])
    assert batch.failures[1] is None
    assert "of 80: the cloth flies apart; use a shorter step than 0.0125 s" in str(batch.failures[0])
    assert torch.isnan(batch.vertices[0]).all()
    assert np.isnan(batch.residual[0])
    assert batch.iterations.tolist() == [0, 20]


@pytest.mark.parametrize("threads", [1, 2])
def test_how_far_a_cloth_may_fall_does_not_depend_on_where_others_are_laid(
    threads: int, monkeypatch: pytest.MonkeyPatch
):
    """As many cloths drop together as there are threads."""
    monkeypatch.setattr(drop_batch, "numba", SimpleNamespace(get_num_threads=lambda: threads))
    falls_freely = uniform_material(density=0.2, bending=1e-12, stretch=1e-9, shear=1e-9)  # 4.2 m in 18 steps
    simulator = DrapeSimulator(HINGES.mesh, replace(HINGES.settings, steps=18))
    laid = _laid(simulator, 0)
    aside = laid + torch.tensor([0.3, 0.0, 0.0], dtype=torch.float64)
    batch = simulator.drape_batch([falls_freely, specimen(CALM[0]).material], initial=torch.stack([laid, aside]))
    assert "the cloth flies apart" in str(batch.failures[0])
    assert batch.failures[1] is None


@pytest.mark.parametrize("device", ["cpu", "cpu:torch"])
def test_a_cloth_that_trembles_wildly_at_the_end_has_no_drape(device):
    wild = uniform_material(density=0.02, bending=1e-9, stretch=5000.0, shear=5.0)  # ends with 100 times its weight
    calm = uniform_material(density=0.2, bending=1e-5)
    density = wild.density.clone().requires_grad_()
    settings = DrapeSettings(clamp="whole", step_seconds=0.1, steps=30)
    simulator = DrapeSimulator(disc_mesh(120, seed=2), settings, device=device)
    batch = simulator.drape_batch([Material(wild.stretch, wild.bending, density), calm])
    assert str(batch.failures[0]).startswith("the cloth flies apart: net force")
    assert batch.failures[1] is None
    assert torch.isnan(batch.vertices[0]).all()
    assert torch.isfinite(batch.vertices[1]).all()
    assert np.isnan(batch.residual).tolist() == [True, False]
    assert batch.iterations.tolist() == [0, 30]
    batch.vertices[1].square().sum().backward()
    assert density.grad == 0


def test_a_cloth_lost_in_its_first_step_is_not_dropped_again():
    good = specimen(CALM[0]).material
    bad = Material(-1e3 * good.stretch, good.bending, good.density)
    for device in ("cpu", "cpu:torch"):
        batch = DrapeSimulator(HINGES.mesh, HINGES.settings, device=device).drape_batch([bad, good])
        failure = str(batch.failures[0])
        assert failure.startswith(f"step 1 of {STEPS}: ")
        assert "must be positive definite" in failure
        assert batch.halvings.tolist() == [0, 0]


def test_an_equilibrium_starts_as_laid_where_the_drop_blew_up():
    resting = DrapeSimulator(HINGES.mesh, replace(HINGES.settings, mode="equilibrium"))
    batch = _batch(resting, (WILD, CALM[0]))
    assert batch.converged.all()
    assert batch.halvings.tolist() == [0, 0]


def test_robustness_counts_what_flew_apart_and_what_was_halved():
    found = robustness(HINGES, 20)
    assert found["diverged"] == 0
    assert found["halved"] == sum(1 for seed in range(20) if _batch(HINGES, (seed,)).halvings[0])
    assert found["halved"] > 0
