"""A problem whose drapes lie on another device: losses are taken there, and what is kept comes back to the host."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from toy_problem import toy_problem

from cusick_bench.problem import DrapeProblem, Scene, parse_causes
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.effects import registered
from cusick_bench.sim.engine.settings import DrapeSettings

pytestmark = pytest.mark.usefixtures("one_thread")


class Elsewhere(torch.Tensor):
    """A tensor that behaves as on another device: no numpy, no arithmetic with tensors of the host."""

    @classmethod
    def __torch_function__(cls, func, types, args=(), kwargs=None):
        if func is torch.Tensor.cpu:
            return args[0].as_subclass(torch.Tensor)
        if func is torch.Tensor.numpy:
            raise TypeError("can't convert a tensor of another device to numpy; use Tensor.cpu() first")
        with torch._C.DisableTorchFunctionSubclass():
            given = [one for one in args if isinstance(one, torch.Tensor) and one.ndim]
        crosses = func in (torch.Tensor.to, torch.autograd.grad)  # as copies and gradients do
        if not crosses and any(not isinstance(one, Elsewhere) for one in given):
            raise RuntimeError("expected all tensors to be on the same device")
        return super().__torch_function__(func, types, args, kwargs or {})


@pytest.fixture
def elsewhere(monkeypatch):
    """Moves drapes and their silhouettes to another device."""
    drape_batch, render = DrapeSimulator.drape_batch, DrapeProblem.render

    def dropped(self, materials, **settings):
        batch = drape_batch(self, materials, **settings)
        return replace(batch, vertices=batch.vertices.as_subclass(Elsewhere))

    def seen(self, vertices):
        image = render(self, vertices.as_subclass(torch.Tensor))
        return image.as_subclass(Elsewhere) if isinstance(vertices, Elsewhere) else image

    monkeypatch.setattr(DrapeSimulator, "drape_batch", dropped)
    monkeypatch.setattr(DrapeProblem, "render", seen)


def _answers():
    problem = toy_problem()
    tau = np.full(problem.dimension, 0.1)
    loss, gradient = problem.evaluate_and_gradient(tau)
    return loss, gradient, problem.evaluate_batch(np.stack([tau, -tau])), problem.drape(tau), problem.image(tau)


def test_drapes_elsewhere_give_the_same_answers_on_the_host(request):
    expected = _answers()
    request.getfixturevalue("elsewhere")
    for ours, theirs in zip(_answers(), expected, strict=True):
        assert isinstance(ours, float | np.ndarray)
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("side", ["up", "down"])
@pytest.mark.parametrize("cause", [name for name, effect in registered().items() if effect.kind == "imaging"])
def test_drapes_elsewhere_are_seen_there_under_effects(cause, side):
    mesh = disc_mesh(100)
    scene = Scene(parse_causes([cause]), mesh, DrapeSettings(), side=side)
    drape = torch.from_numpy(mesh.flat) - torch.tensor([0.0, 0.0, 0.05])
    expected, found = (scene.seen(scene.to_cloth(one)) for one in (drape, drape.as_subclass(Elsewhere)))
    assert isinstance(found, Elsewhere)
    assert torch.equal(found.cpu(), expected)


def test_the_stand_in_refuses_what_a_device_refuses():
    there, here = torch.ones(2).as_subclass(Elsewhere), torch.ones(2)
    with pytest.raises(TypeError, match=r"use Tensor\.cpu"):
        there.numpy()
    with pytest.raises(RuntimeError, match="same device"):
        _ = there - here
    assert (there - here.to(there)).cpu().numpy().tolist() == [0, 0]
