"""Yarns rub against each other as the cloth shears: part of the shear stress opposes the last movement."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
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


YIELD_SHEAR = math.radians(0.2)
"""Change of shear angle over which the friction changes its sign [rad]: small against Kawabata's 8 degrees."""

_SHEAR_COLUMN = 3  # of C: c33


@dataclass(frozen=True)
class ShearStressFriction(StateLaw):
    """Coulomb friction in the shear stress.

    Attributes:
        ratio: Friction stress per shear stiffness, HG / G [rad].
    """

    rank: ClassVar[Rank] = Rank.FRICTION
    ratio: float

    def start(self, system: ClothSystem, parameters: Parameters) -> SlidShear:
        """Nothing has slid yet."""
        from cusick_bench.sim.engine.strains import strains

        return SlidShear(self.ratio, np.zeros_like(strains(system).shear(system.mesh.flat)))


@dataclass
class SlidShear(State):
    """State in which the friction elements of one cloth are free of stress.

    Attributes:
        ratio: As in `ShearStressFriction`.
        slid: Shear x_u . x_v of the faces, or of a shell's quadrature points.
    """

    ratio: float
    slid: Float[ndarray, " elements"]

    def advance(
        self, system: ClothSystem, parameters: Parameters, x: Float[ndarray, "vertices 3"], share: float
    ) -> tuple[ClothSystem, Parameters]:
        """Springs G and g_f in parallel as one: stiffness G + g_f, rest shear g_f slid / (G + g_f)."""
        from cusick_bench.sim.engine.strains import strains

        own = strains(system)
        shear = own.shear(x)
        self.slid = np.clip(self.slid, shear - YIELD_SHEAR, shear + YIELD_SHEAR)
        more = self.ratio / YIELD_SHEAR  # g_f / G
        stretch = parameters.stretch.copy()
        stretch[..., _SHEAR_COLUMN] *= 1 + more
        return own.with_rest_shear(x, more * self.slid / (1 + more)), replace(parameters, stretch=stretch)


class ShearFriction(Effect):
    """Shear hysteresis, as Kawabata's shear tester shows it."""

    name = "shear-friction"
    kind = "history"
    summary = "friction between yarns holds part of the shear stress"
    physics = (
        "Shear stress T = G g + g_f (g - g_slid), |g_f (g - g_slid)| <= HG = ratio G: g_slid follows once the "
        "friction stress HG is reached. g_f = HG / (0.2 degrees). A closed loop is 2 HG wide. Where C depends on "
        "strain, it is read at the strain from the joint rest of both springs."
    )
    reference = (
        "Grosberg, Park. The mechanical properties of woven fabrics, Part V: the initial modulus and the frictional "
        "restraint in shearing of plain weave fabrics. Textile Research Journal 36, 1966, 420-431."
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "ratio", "deg", 0.0, 10.0, 0.6, "HG / G about 0.6 degrees, Kawabata's mean of suitings",
            summary="friction stress per shear stiffness, HG / G",
        ),
    )  # fmt: skip
    repeatable = False  # friction stiffens what it finds, so a second one would multiply the first

    def _apply(self, setup: Setup, value: Values) -> Setup:
        return setup.with_added(states=ShearStressFriction(math.radians(float(value["ratio"]))))
