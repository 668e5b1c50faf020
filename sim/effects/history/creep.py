"""Bending moments relax while the cloth hangs: a later picture shows it lower than the first."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.effects.base import Effect, Parameter, Values
from cusick_bench.sim.history import Rank, State, StateLaw

if TYPE_CHECKING:
    from cusick_bench.sim.engine.cloth_system import ClothSystem
    from cusick_bench.sim.engine.parameters import Parameters
    from cusick_bench.sim.setup import Setup


_REACHED, _RELAXED = 0.5, 0.75  # shares of a drop: when the elastic drape hangs, and when its moments have relaxed


@dataclass(frozen=True)
class Relaxation(StateLaw):
    """Moments that relax once, at the shape that the elastic cloth has reached.

    Attributes:
        loss: Share of the bending at that shape that becomes the rest, in [0, 1).
    """

    rank: ClassVar[Rank] = Rank.REST
    loss: float

    def start(self, system: ClothSystem, parameters: Parameters) -> Relaxing:
        """Nothing has relaxed yet."""
        return Relaxing(self.loss)


@dataclass
class Relaxing(State):
    """One cloth that relaxes.

    Attributes:
        loss: As in `Relaxation`.
        reached: Bending at which it relaxes, measured as `Parameters.rest_angle` is, once it is reached.
    """

    loss: float
    reached: Float[ndarray, " bendings"] | None = field(default=None)

    def advance(
        self, system: ClothSystem, parameters: Parameters, x: Float[ndarray, "vertices 3"], share: float
    ) -> tuple[ClothSystem, Parameters]:
        """Moves the rest shape towards that which the cloth had reached when relaxation began."""
        from cusick_bench.sim.engine.strains import strains

        if share < _REACHED:
            return system, parameters
        if self.reached is None:
            self.reached = strains(system).bending(x)
        gone = self.loss * min(1.0, (share - _REACHED) / (_RELAXED - _REACHED))
        rest = parameters.rest_angle + gone * (self.reached - parameters.rest_angle)
        return system, replace(parameters, rest_angle=np.ascontiguousarray(rest))


class Creep(Effect):
    """A drape that sinks from picture to picture."""

    name = "creep"
    kind = "history"
    summary = "bending moments relax between an earlier picture and this one"
    physics = (
        "In a later capture the rest angles (law `plate`: curvatures) have followed the shape reached before, "
        "rest = rest0 + loss (reached - rest0), and the cloth sinks to a new rest. The moment at the shape reached is "
        "that of the bending (1 - loss) (reached - rest0): (1 - loss) of the elastic one if B is the same at all "
        "curvatures."
    )
    reference = "Simo, Hughes. Computational inelasticity. Springer 1998, Chapter 10 (stress relaxation)."
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "loss", "1", 0.0, 0.9, 0.15,
            "assumed: drapes of one cloth in the public release (Fabric 1) lose 5 to 7 points of DC in five pictures",
            summary="share of the bending that has become the rest, and of the moment that is gone if B is constant",
        ),
    )  # fmt: skip

    def _apply(self, setup: Setup, value: Values) -> Setup:
        return setup.with_added(states=Relaxation(float(value["loss"]))) if setup.later else setup
