"""Drops of a cloth whose law has internal variables: friction, creep, stiffness that depends on the sign of curvature.

Before every step of a drop a `StateLaw` reads the configuration of the cloth and sets its parameters for the step. The
forces of an elastic-plastic element, a spring of stiffness k whose rest state follows the motion beyond a threshold,
are exact in this way. Laws use bending and shear from `engine.strains`, which has the same interface for hinges and
faces and for shells; configurations and parameters are those of the system (with law `plate` control points, and tables
and rest curvatures of quadrature points). There are no gradients; derivatives by such effects are computed by
differences with common random numbers.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from enum import IntEnum
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.errors import DrapeDiverged, SimulationError

if TYPE_CHECKING:
    from torch import Tensor

    from cusick_bench.sim.cloth.material import Material
    from cusick_bench.sim.drape import DrapeSimulator
    from cusick_bench.sim.engine.cloth_system import ClothSystem
    from cusick_bench.sim.engine.parameters import Parameters


class Rank(IntEnum):
    """Kind of change that a law makes. Laws of one drop act in this order, in whatever order they are given."""

    REST = 0
    ELASTICITY = 1
    FRICTION = 2


class StateLaw(ABC):
    """Internal variables of a cloth.

    Attributes:
        rank: What it changes: where the cloth is free of stress, how stiff it is, or what it adds beside elasticity.
    """

    rank: ClassVar[Rank]

    @abstractmethod
    def start(self, system: ClothSystem, parameters: Parameters) -> State:
        """The state of a cloth that lies flat, unloaded.

        Args:
            system: Cloth and support.
            parameters: One cloth, not a batch, as it is without this law.

        Returns:
            The state, to be advanced through one drop.
        """


class State(ABC):
    """Internal variables of one cloth during one drop; changes as the cloth moves."""

    @abstractmethod
    def advance(
        self, system: ClothSystem, parameters: Parameters, x: Float[ndarray, "vertices 3"], share: float
    ) -> tuple[ClothSystem, Parameters]:
        """System and parameters for the next step.

        Args:
            system: System as the laws before this one left it.
            parameters: Parameters as the laws before this one left them.
            x: Where the cloth is: the system's configuration [m].
            share: How much of the drop is over, in [0, 1).

        Returns:
            System and parameters with this law.
        """


def drop_with_history(
    simulator: DrapeSimulator,
    material: Material,
    initial: Float[Tensor, "vertices 3"],
    rest_angle: Float[Tensor, " hinges"],
    laws: Sequence[StateLaw],
) -> Float[Tensor, "vertices 3"]:
    """Drops one cloth whose laws have internal variables.

    Args:
        simulator: Mesh and settings.
        material: The cloth without these laws.
        initial: Shape in which it is laid down [m].
        rest_angle: Stress-free dihedral angles of whole hinges [rad].
        laws: Internal variables.

    Returns:
        Positions [m], without gradients.

    Raises:
        SimulationError: The settings ask for an equilibrium, or for self-contact, which has no drop with history.
        DrapeDiverged: The cloth flies apart.
    """
    import torch

    from cusick_bench.sim.engine.dynamics.drop import Stepper, too_far
    from cusick_bench.sim.engine.dynamics.drop_batch import flown_apart
    from cusick_bench.sim.engine.parameters import Parameters
    from cusick_bench.sim.threads import alone

    settings, base, unknowns = simulator.settings, simulator.system, simulator.unknowns
    if settings.mode != "drop":
        asked = "self-contact" if settings.self_contact > 0 else f"mode {settings.mode!r}"
        raise SimulationError(
            f"friction, creep and face asymmetry are simulated in mode 'drop' without self-contact, got {asked}; "
            "leave one of them out"
        )
    material.check_fits(simulator.mesh)
    material = simulator.as_draped(material)
    asked = Parameters(
        _array(material.stretch.reshape(-1, 6, 4)), _array(material.bending.reshape(-1, 3, 5)),
        _array(material.vertex_mass(simulator.mesh)), _array(rest_angle) * simulator.hinge_share,
        np.array(float(material.poisson)),
    )  # fmt: skip
    elastic = unknowns.parameters(asked.batch()).member(0)
    states = [law.start(base, elastic) for law in sorted(laws, key=lambda law: law.rank)]
    x = unknowns.configuration(_array(initial)[None]).copy()
    laid, far = x.copy(), too_far(x)
    v, v_new, x_new = np.zeros_like(x), np.zeros_like(x), np.empty_like(x)
    stepper, factor = Stepper(base, elastic.mass[None], settings.step_seconds, batch=False), None
    system, p = base, elastic
    with alone():
        for step in range(settings.steps):
            system, p = base, elastic
            for state in states:
                system, p = state.advance(system, p, x[0], step / settings.steps)
            found = system.evaluate(x, laid, p.batch(), exact=False)
            number = step, settings.steps
            factor = stepper.step(number, iter([(slice(None), found)]), (x, v), (x_new, v_new), far, factor)
            x, x_new, v, v_new = x_new, x, v_new, v
        left = system.evaluate(x, laid, p.batch(), exact=False).force()[0, system.free]
    failure = flown_apart(settings, float(np.linalg.norm(left) / (settings.gravity * elastic.mass.sum())))
    if failure is not None:
        raise DrapeDiverged(failure)
    return torch.from_numpy(unknowns.positions(x)[0])


def _array(tensor: Tensor) -> ndarray:
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), dtype=np.float64)
