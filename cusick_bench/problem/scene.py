"""Simulation of a specimen with effects in a fit: the specimen is put into a `Setup`, which the causes change.

The mesh and settings that the causes need are fixed once, before the parameter space is defined on that mesh. All else
is applied at every evaluation, since causes may depend on the cloth. Drapes are returned in the laboratory's frame, as
the camera sees them; a cloth that lies face down is simulated as its mirror image, x -> -x.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.problem.errors import ProblemError
from cusick_bench.sim.cloth.material import Material, uniform_material
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.drape import DrapeBatch, DrapeSimulator
from cusick_bench.sim.effects import Cause, apply_all, parse, require_repeatable
from cusick_bench.sim.effects.registry import applied_in_turn
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.sim.history import drop_with_history
from cusick_bench.sim.setup import Setup, Side

_ANY_CLOTH = uniform_material(density=0.2, bending=1e-5)  # which mesh a cause asks for does not depend on it
_MIRROR = torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)


def parse_causes(texts: Sequence[str]) -> tuple[Cause, ...]:
    """Reads causes from texts such as `plate-tilt:angle=2,direction=90`.

    Args:
        texts: Effects with their parameters.

    Returns:
        The effects and the values of their parameters.

    Raises:
        SimulationError: An unknown effect or parameter, a value that is no number or out of bounds, or an effect that
            cannot act twice is given twice.
    """
    causes = tuple(parse(text) for text in texts)
    require_repeatable(causes)
    return causes


def canonical(text: str) -> str:
    """Spells out a cause with all its parameters, the same however it was written; raises as `parse_causes`.

    Args:
        text: A cause.

    Returns:
        Its one spelling.
    """
    cause = parse(text)
    full = cause.effect.complete(cause.value)
    return f"{cause.effect.name}:{','.join(f'{name}={float(value):.15g}' for name, value in full.items())}"


@dataclass(frozen=True, eq=False)
class Scene:
    """How specimens are draped and seen.

    Attributes:
        causes: What the base model leaves out, in the order in which it acts.
        mesh: The cloth without them.
        settings: Settings of the simulator without the causes.
        side: Face that lies up.
        capture: Number of the picture, from 1.
        later: Whether an earlier picture of the same face lies before it.
        seed: Whatever is random in the causes follows from it.

    Raises:
        SimulationError: A cause that cannot act on this mesh.
        ProblemError: A cause that acts in the course of a drop, but the mode is not `drop`.
    """

    causes: tuple[Cause, ...]
    mesh: Mesh
    settings: DrapeSettings
    side: Side = "up"
    capture: int = 1
    later: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        stateful, mode = self.stateful, self.simulated.mode
        if stateful and mode != "drop":
            raise ProblemError(
                f"effect {stateful} acts in the course of a drop, got mode {mode!r}"
                + (" (which self-contact asks for)" if self._applied.self_contact > 0 else "")
                + "; use mode 'drop', or leave the effect out"
            )

    @property
    def warped(self) -> Mesh:
        """The mesh that the causes ask for."""
        return self._applied.mesh

    @property
    def simulated(self) -> DrapeSettings:
        """The settings that they ask for."""
        return self._applied.simulated_settings

    @cached_property
    def stateful(self) -> str:
        """Name of the first effect with internal variables, which has no gradients; "" where there is none."""
        steps = applied_in_turn(self.causes, self._plain(_ANY_CLOTH))
        return next((cause.effect.name for cause, setup in steps if setup.states), "")

    def to_cloth(self, vertices: Float[Tensor, "*batch vertices 3"]) -> Float[Tensor, "*batch vertices 3"]:
        """Turns points from the laboratory's frame to that of the simulated cloth, or back.

        Args:
            vertices: Positions [m].

        Returns:
            Turned positions [m].
        """
        return vertices if self.side == "up" else vertices * _MIRROR.to(vertices)

    def seen(self, vertices: Float[Tensor, "vertices 3"]) -> Float[Tensor, "vertices 3"]:
        """Apparent positions of points of the laboratory, for the nominal camera.

        Args:
            vertices: Positions in the laboratory [m].

        Returns:
            Apparent positions [m].
        """
        return self._applied.to_camera(self.to_cloth(vertices))

    def drape(
        self,
        simulator: DrapeSimulator,
        materials: Sequence[Material],
        initial: Float[Tensor, "members vertices 3"],
        rest_angle: Float[Tensor, "members hinges"],
        warm: Float[Tensor, "members vertices 3"] | None = None,
    ) -> DrapeBatch:
        """Drapes cloths under the causes.

        Args:
            simulator: Simulator of the warped mesh with the simulated settings.
            materials: The cloths without the causes.
            initial: How they are laid down, in the frame of the simulated cloth [m].
            rest_angle: Stress-free dihedral angles, positive where convex seen from the face [rad].
            warm: Positions from which equilibria are sought, in the laboratory's frame [m].

        Returns:
            The drapes, in the laboratory's frame, with gradients where no effect has internal variables.
        """
        setups = [self._setup(*one) for one in zip(materials, initial, rest_angle, strict=True)]
        if any(setup.states for setup in setups):
            batch = _dropped(simulator, setups)
        else:
            batch = simulator.drape_batch(
                [setup.cloth() for setup in setups],
                initial=torch.stack([setup.initial() for setup in setups]),
                rest_angle=torch.stack([setup.rest_angle() for setup in setups]),
                warm=None if warm is None else self.to_cloth(warm),
            )
        return batch if self.side == "up" else replace(batch, vertices=self.to_cloth(batch.vertices))

    @cached_property
    def _applied(self) -> Setup:
        return apply_all(self.causes, self._plain(_ANY_CLOTH))

    def _plain(self, material: Material) -> Setup:
        return Setup(
            self.mesh, self.settings, material, self.side, self.capture, self.later,
            specimen_seed=(self.seed,), laying_seed=(self.seed,),
        )  # fmt: skip

    def _setup(self, material: Material, initial: Tensor, rest_angle: Tensor) -> Setup:
        """One specimen under the causes; its shape comes first, so that they act on it."""
        shaped = self._plain(material).with_added(laid=lambda _: initial, rest_angles=lambda _: rest_angle)
        return apply_all(self.causes, shaped)


def profile_in_cloth_frame(radii: Float[np.ndarray, " angles"], scene: Scene | None) -> Float[np.ndarray, " angles"]:
    """Turns a radius profile from the laboratory's frame to that of the simulated cloth.

    Args:
        radii: A silhouette's radii at an even number of equidistant angles from +x [m].
        scene: How the cloth is draped and seen; None where it lies face up without causes.

    Returns:
        The same radii in the order of the cloth's frame [m].
    """
    half, every = len(radii) // 2, np.arange(len(radii))
    return radii if scene is None or scene.side == "up" else radii[(half - every) % len(radii)]


def _dropped(simulator: DrapeSimulator, setups: Sequence[Setup]) -> DrapeBatch:
    """Drops with internal variables, one by one; nobody knows their residual."""
    clock, shapes, failures = time.perf_counter(), [], []
    for setup in setups:
        try:
            shapes.append(
                drop_with_history(simulator, setup.cloth(), setup.initial(), setup.rest_angle(), setup.states)
            )
            failures.append(None)
        except DrapeDiverged as error:
            shapes.append(torch.full((simulator.mesh.vertices, 3), torch.nan, dtype=torch.float64))
            failures.append(str(error))
    members = len(setups)
    return DrapeBatch(
        torch.stack(shapes), failures, np.zeros(members, bool), np.full(members, np.nan),
        np.full(members, simulator.settings.steps), np.zeros(members, np.int64), time.perf_counter() - clock,
    )  # fmt: skip
