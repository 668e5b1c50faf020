"""Gradients of the whole pipeline, parameters -> drape -> silhouette -> MSE, against central differences.

The loss is smooth but for two things. max(G, 0) in the step's stiffness and the edges of pixels give it kinks, across
which a difference is off however right the gradient: a ladder of steps is tried, and the step with the smallest
estimated error is taken (the one whose two difference formulas, of order 2 and 4, agree best; the gradient has no say
in it). And a rest can lose its branch: then the drapes on both sides differ in their folds, and the row says so.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from cusick_bench.benchmark.workload import cloth
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.drape import Drape, DrapeSimulator
from cusick_bench.sim.engine.statics.branch import rim_folds
from cusick_bench.sim.render.camera import ParallelCamera
from cusick_bench.sim.render.silhouette import render

_LADDER = (1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6)  # of log parameters
NAMES = ("stretch", "bending", "density")


@dataclass(frozen=True)
class GradientError:
    """One directional derivative, both ways.

    Attributes:
        parameter: `stretch`, `bending` or `density`.
        per_element: Whether every element moves on its own (random), or all together.
        gradient: Directional derivative by the adjoint, per unit of log parameter.
        difference: The same by central differences.
        step: Their step.
        branch_changed: Whether the fold number differs among the drapes of the difference.
    """

    parameter: str
    per_element: bool
    gradient: float
    difference: float
    step: float
    branch_changed: bool

    @property
    def relative_error(self) -> float:
        """|gradient - difference| / |difference|."""
        return abs(self.gradient - self.difference) / max(abs(self.difference), 1e-300)


class GradientCheck:
    """Compares gradients and differences on one mesh, for a cloth whose every number differs.

    Args:
        simulator: Mesh, mode and settings.
        seed: Seed of cloth, target and directions.
    """

    def __init__(self, simulator: DrapeSimulator, seed: int = 0) -> None:
        self.simulator = simulator
        self.material = cloth(simulator.mesh, spread=0.1, seed=seed, track=True)
        self.generator = np.random.default_rng([seed, 1])
        self.target = render(
            simulator.drape(cloth(simulator.mesh, spread=0.1, seed=seed + 1)).vertices.detach(),
            simulator.mesh.faces, ParallelCamera(),
        )  # fmt: skip
        self.start = simulator.drape(self.material)
        self._loss(self.start).backward()

    def _loss(self, drape: Drape) -> Tensor:
        image = render(drape.vertices, self.simulator.mesh.faces, ParallelCamera())
        return (image - self.target).square().mean()

    def _moved(self, name: str, direction: Tensor, step: float) -> tuple[float, int]:
        """Loss and folds where the logarithm of one parameter has moved."""
        values = {other: getattr(self.material, other).detach() for other in NAMES}
        values[name] = values[name] * torch.exp(step * direction)
        warm = self.start if self.simulator.settings.mode == "equilibrium" else None
        drape = self.simulator.drape(Material(**values), warm=warm)
        return float(self._loss(drape)), rim_folds(self.simulator.mesh, drape.vertices.numpy())

    def error(self, name: str, *, per_element: bool) -> GradientError:
        """Compares one directional derivative.

        Args:
            name: `stretch`, `bending` or `density`.
            per_element: A random direction over all elements, instead of all together.

        Returns:
            The derivative's error at the best of several step lengths.
        """
        value = getattr(self.material, name)
        shape = value.shape if per_element else (1,) * value.ndim
        direction = torch.from_numpy(self.generator.normal(size=shape)).expand(value.shape)
        if not per_element:
            direction = torch.ones_like(direction)
        gradient = float((value.grad * value.detach() * direction).sum())
        best, folds = (np.inf, 0.0, 0.0), set()
        for step in _LADDER:
            (near0, a), (near1, b), (far0, c), (far1, d) = (
                self._moved(name, direction, n * step) for n in (-1, 1, -2, 2)
            )
            second, fourth = (near1 - near0) / (2 * step), (8 * (near1 - near0) - (far1 - far0)) / (12 * step)
            if abs(second - fourth) < best[0]:
                best, folds = (abs(second - fourth), fourth, step), {a, b, c, d}
        return GradientError(name, per_element, gradient, best[1], best[2], len(folds) > 1)

    def errors(self) -> list[GradientError]:
        """All parameters, homogeneous and per element."""
        return [self.error(name, per_element=own) for name in NAMES for own in (False, True)]
