"""Adjoints are first derivatives: a derivative of them is right or refused, never one that lacks a part."""

import numpy as np
import pytest
import torch

from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.reference.drop import drop_reference
from cusick_bench.sim.reference.laws import TorchParameters
from cusick_bench.sim.render.camera import ParallelCamera
from cusick_bench.sim.render.silhouette import render

FACES = np.array([[0, 1, 2], [0, 2, 3]])
REFUSED = "first derivatives only"
VERTICES = 60


def square() -> torch.Tensor:
    corners = [[-0.01, -0.012, 0.0], [0.013, -0.01, 0.0], [0.011, 0.014, 0.0], [-0.012, 0.011, 0.0]]
    return torch.tensor(corners, dtype=torch.float64, requires_grad=True)


def drape_height(simulator: DrapeSimulator, softness: torch.Tensor, power: int) -> torch.Tensor:
    """A function of the logarithm of the stiffness; of power 1, the gradient that comes back is a constant."""
    base = uniform_material(density=0.2, bending=2e-5)
    material = type(base)(base.stretch, base.bending * softness.exp(), base.density)
    return (simulator.drape(material).vertices[:, 2] ** power).sum()


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize(
    ("law", "mode", "device"),
    [
        ("plate", "drop", "cpu"), ("paper", "drop", "cpu"), ("paper", "equilibrium", "cpu"),
        ("plate", "drop", "cpu:torch"), ("paper", "drop", "cpu:torch"),
    ],
)  # fmt: skip
def test_a_second_derivative_of_a_drape_is_refused_and_the_first_is_as_without(law, mode, device, power):
    settings = DrapeSettings(law=law, mode=mode, steps=4)
    simulator = DrapeSimulator(cloth_mesh(law, VERTICES), settings, device=device)
    softness = torch.zeros((), dtype=torch.float64, requires_grad=True)
    (plain,) = torch.autograd.grad(drape_height(simulator, softness, power), softness)
    (first,) = torch.autograd.grad(drape_height(simulator, softness, power), softness, create_graph=True)
    assert torch.equal(first, plain)
    with pytest.raises(SimulationError, match=REFUSED):
        torch.autograd.grad(first, softness)


@pytest.mark.parametrize("law", ["plate", "paper"])
@pytest.mark.parametrize("device", ["cpu", "cpu:torch"])
def test_a_second_derivative_to_the_laid_down_shape_is_refused(law, device):
    simulator = DrapeSimulator(cloth_mesh(law, VERTICES), DrapeSettings(law=law, steps=3), device=device)
    material = uniform_material(density=0.2, bending=2e-5)
    laid = torch.from_numpy(simulator.laid_down()).requires_grad_()
    (first,) = torch.autograd.grad(
        simulator.drape(material, initial=laid).vertices.square().sum(), laid, create_graph=True
    )
    with pytest.raises(SimulationError, match=REFUSED):
        torch.autograd.grad(first.square().sum(), laid)


@pytest.mark.parametrize("power", [1, 2])
def test_a_second_derivative_of_pixel_coverage_is_refused(power):
    vertices = square()
    image = render(vertices.square() * vertices.sign(), FACES, ParallelCamera(400.0, (7.5, 7.5)), size=16)
    (first,) = torch.autograd.grad((image**power).sum(), vertices, create_graph=True)
    assert first.abs().max() > 0
    with pytest.raises(SimulationError, match=REFUSED):
        torch.autograd.grad(first.square().sum(), vertices)


def test_a_second_derivative_of_the_reference_drop_is_refused():
    simulator = DrapeSimulator(cloth_mesh("paper", VERTICES), DrapeSettings(law="paper", steps=2))
    material = uniform_material(density=0.2, bending=2e-5)
    mass = material.vertex_mass(simulator.mesh).requires_grad_()
    stretch = material.stretch.expand(len(simulator.mesh.faces), 6, 4)
    bending = material.bending.expand(len(simulator.mesh.hinges), 3, 5)
    p = TorchParameters(stretch, bending, mass, simulator.rest_angles())
    dropped = drop_reference(
        simulator.hinge_system, p, torch.from_numpy(simulator.laid_down()), steps=2, step_seconds=0.05
    )
    (first,) = torch.autograd.grad(dropped[:, 2].sum(), mass, create_graph=True)
    with pytest.raises(SimulationError, match=REFUSED):
        torch.autograd.grad(first.sum(), mass)


def test_second_derivatives_of_the_soft_mask_are_right():
    camera, weights = ParallelCamera(400.0, (7.5, 7.5)), torch.linspace(0.5, 2, 256, dtype=torch.float64)

    def value(vertices: torch.Tensor) -> torch.Tensor:
        image = render(vertices, FACES, camera, method="soft", size=16)
        return (image.reshape(-1) * weights).sum()

    upstream = torch.ones((), dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradgradcheck(value, square(), upstream, eps=1e-8, atol=1e-2, rtol=1e-4)
