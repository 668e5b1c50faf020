"""Yarns rub against each other as the cloth bends: part of the moment opposes the last movement.

With laws `paper` and `published` friction acts hinge by hinge. Each hinge gets a share of the couple (`HINGE_SHARE`)
such that a cloth on a mesh without preferred directions has the given couple. With law `plate` friction acts at the
edge points on the curvature tensor: the moment is k_f (kappa - kappa_slid), with k_f in proportion to the plate's own
stiffness, and kappa_slid follows (radial return) where |kappa - kappa_slid|, the norm of the tensor, exceeds the yield
curvature. The couple of a cylinder is then HB in every direction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.effects.base import Effect, Parameter, Values
from cusick_bench.sim.history import Rank, State, StateLaw

if TYPE_CHECKING:
    from cusick_bench.sim.engine.cloth_system import ClothSystem
    from cusick_bench.sim.engine.parameters import Parameters
    from cusick_bench.sim.setup import Setup


YIELD_CURVATURE = 2.0
"""Change of curvature over which the friction changes its sign [1/m]: a tenth of that of a drape, so that hysteresis
loops are nearly parallelograms, and their corners are still smooth enough for long time steps."""


@dataclass(frozen=True)
class MomentFriction(StateLaw):
    """Coulomb friction in the moment.

    Attributes:
        ratio: Friction couple per bending stiffness, HB / B [1/m].
    """

    rank: ClassVar[Rank] = Rank.FRICTION
    ratio: float

    def start(self, system: ClothSystem, parameters: Parameters) -> SlidBending:
        """Nothing has slid yet: the friction springs are at ease in the elastic rest shape."""
        return SlidBending(self.ratio, parameters.rest_angle)


@dataclass
class SlidBending(State):
    """State in which the friction elements of one cloth are free of stress.

    Attributes:
        ratio: As in `MomentFriction`.
        slid: Bending, measured as `Parameters.rest_angle` is.
    """

    ratio: float
    slid: Float[ndarray, " bendings"]

    def advance(
        self, system: ClothSystem, parameters: Parameters, x: Float[ndarray, "vertices 3"], share: float
    ) -> tuple[ClothSystem, Parameters]:
        """Springs B and k_f in parallel as one: stiffness B + k_f, at rest in (B rest + k_f slid) / (B + k_f)."""
        from cusick_bench.sim.engine.strains import strains

        own = strains(system)
        bending = own.bending(x)
        self.slid = own.drawn_along(self.slid, bending, YIELD_CURVATURE)
        more = own.bending_share * self.ratio / YIELD_CURVATURE  # k_f / B
        # B at the elastic curvature, which is not the curvature from the joint rest
        elastic = own.at_secant(bending, parameters)
        rest = (elastic.rest_angle + more * self.slid) / (1 + more)
        return system, replace(elastic, bending=(1 + more) * elastic.bending, rest_angle=rest)


class BendingFriction(Effect):
    """Bending hysteresis, as Kawabata's bending tester shows it."""

    name = "bending-friction"
    kind = "history"
    summary = "friction between yarns holds part of the bending moment"
    physics = (
        "Moment M = B (k - k_rest) + k_f (k - k_slid), |k_f (k - k_slid)| <= HB = ratio B: the point k_slid follows "
        "once the friction couple HB is reached. k_f = HB / (2 per metre), stiff against B where friction matters. A "
        "closed loop is 2 HB wide."
    )
    reference = (
        "Grosberg. The mechanical properties of woven fabrics, Part II: the bending of woven fabrics. Textile Research "
        "Journal 36, 1966, 205-211."
    )
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "ratio", "1/m", 0.0, 200.0, 20.0, "HB / B about 0.2 per cm, Kawabata's mean of suitings",
            summary="friction couple per bending stiffness, HB / B",
        ),
    )  # fmt: skip
    repeatable = False  # friction stiffens what it finds, so a second one would multiply the first

    def _apply(self, setup: Setup, value: Values) -> Setup:
        return setup.with_added(states=MomentFriction(float(value["ratio"])))
