"""The engine against plain torch autograd: time, memory and gradient of the same drop."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from cusick_bench.benchmark.memory import peak_of
from cusick_bench.benchmark.timing import Timing, paired_ratio, time_in_turn
from cusick_bench.benchmark.workload import cloth
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.reference.drop import drop_reference
from cusick_bench.sim.reference.laws import TorchParameters


@dataclass(frozen=True, eq=False)
class Comparison:
    """The same drop, with gradients to every number of every element, on both paths.

    Attributes:
        vertices: Mesh size.
        steps: Steps of the drop; both paths take as many.
    """

    vertices: int
    steps: int

    def simulator(self) -> DrapeSimulator:
        """Mesh and settings of the drop."""
        return DrapeSimulator(disc_mesh(self.vertices), DrapeSettings(steps=self.steps))

    def engine(self, simulator: DrapeSimulator) -> Material:
        """Ours: forward and adjoint; the cloth carries the gradient.

        Args:
            simulator: Mesh and settings of the drop.

        Returns:
            The cloth; its tensors carry the gradient.
        """
        material = cloth(simulator.mesh, spread=0.1, track=True)
        simulator.drape(material).vertices.square().sum().backward()
        return material

    def autograd(self, simulator: DrapeSimulator) -> Material:
        """Plain torch: forward and autograd.

        Args:
            simulator: Mesh and settings of the drop.

        Returns:
            The cloth; its tensors carry the gradient.
        """
        material = cloth(simulator.mesh, spread=0.1, track=True)
        parameters = TorchParameters(
            material.stretch, material.bending, material.vertex_mass(simulator.mesh), simulator.rest_angles()
        )
        laid = torch.from_numpy(simulator.laid_down())
        settings = simulator.settings
        system, h = simulator.hinge_system, settings.step_seconds
        last = drop_reference(system, parameters, laid, steps=self.steps, step_seconds=h)
        last.square().sum().backward()
        return material

    def difference(self) -> float:
        """Largest relative difference of the two gradients, over C, B and density."""
        simulator = self.simulator()
        ours, plain = self.engine(simulator), self.autograd(simulator)
        found = []
        for name in ("stretch", "bending", "density"):
            first, second = getattr(ours, name).grad, getattr(plain, name).grad
            found.append(float((first - second).abs().max() / second.abs().max()))
        return max(found)

    def times(self, rounds: int) -> tuple[Timing, Timing]:
        """Wall times of the engine and of plain autograd, taken in turn.

        Args:
            rounds: Number of repetitions.

        Returns:
            Times of the engine, and of plain autograd.
        """
        simulator = self.simulator()
        cases = {"engine": lambda: self.engine(simulator), "autograd": lambda: self.autograd(simulator)}
        taken = time_in_turn(cases, rounds)
        return taken["engine"], taken["autograd"]

    def measure(self, rounds: int) -> dict[str, object]:
        """Everything compared, for the record.

        Args:
            rounds: Number of repetitions.

        Returns:
            Times, ratios and differences by name.
        """
        engine, autograd = self.times(rounds)
        memory = {path: peak_of(_ready, path, self.vertices, self.steps) for path in ("engine", "autograd")}
        return {
            "vertices": self.vertices,
            "steps": self.steps,
            "engine": engine.summary(),
            "autograd": autograd.summary(),
            "times_faster": paired_ratio(autograd, engine),
            "memory_bytes": memory,
            "times_leaner": float(np.divide(memory["autograd"], memory["engine"])),
            "gradient_difference": self.difference(),
        }


def _ready(path: str, vertices: int, steps: int) -> Callable[[], object]:
    """One path, its code loaded and its mesh made."""
    getattr(Comparison(vertices, 1), path)(Comparison(vertices, 1).simulator())
    comparison = Comparison(vertices, steps)
    simulator = comparison.simulator()
    return lambda: getattr(comparison, path)(simulator)
