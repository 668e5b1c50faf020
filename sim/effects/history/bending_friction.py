"""Yarns rub against each other as the cloth bends: part of the moment opposes the last movement.

Friction acts hinge by hinge. Rolled up to a curvature k in the direction phi, a lattice of equilateral triangles bends
its three families of hinges by k (1 + 2 cos 2 (phi - phi_i)) / 3. Their squares add up to k^2, so elasticity knows no
direction, but their magnitudes to between k and 5/3 k. The mean, k (1/3 + 2 sqrt(3) / pi) = 1.436 k, is divided out: a
cloth on a mesh without preferred directions has the friction couple that is asked for.
"""

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
    from cusick_bench.sim.engine.parameters import Parameters
    from cusick_bench.sim.engine.system import DrapeSystem
    from cusick_bench.sim.setup import Setup


YIELD_CURVATURE = 2.0
"""Change of curvature [1/m] over which the friction turns round: a tenth of a drape's, so that loops are nearly
parallelograms, and their corners are still smooth enough for long steps."""

HINGE_SHARE = 1 / (1 / 3 + 2 * math.sqrt(3) / math.pi)
"""Friction couple of a hinge over that of the cloth, see above."""


@dataclass(frozen=True)
class HingeFriction(StateLaw):
    """Coulomb friction in the moment.

    Attributes:
        ratio: Friction couple per bending stiffness, HB / B [1/m].
    """

    rank: ClassVar[Rank] = Rank.FRICTION
    ratio: float

    def start(self, system: DrapeSystem, parameters: Parameters) -> SlidHinges:
        """No hinge has slid yet: the friction springs are at ease in the elastic rest shape."""
        return SlidHinges(self.ratio, parameters.rest_angle)


@dataclass
class SlidHinges(State):
    """Where the friction elements of one cloth are free of stress.

    Attributes:
        ratio: As in `HingeFriction`.
        slid: Dihedral angles [rad].
    """

    ratio: float
    slid: Float[ndarray, " hinges"]

    def advance(
        self, system: DrapeSystem, parameters: Parameters, x: Float[ndarray, "vertices 3"], share: float
    ) -> tuple[DrapeSystem, Parameters]:
        """Springs B and k_f in parallel as one: stiffness B + k_f, rest angle (B rest + k_f slid) / (B + k_f)."""
        angle, reach = system.bent(x), YIELD_CURVATURE / system.elements.hinge_scale
        self.slid = np.clip(self.slid, angle - reach, angle + reach)
        more = HINGE_SHARE * self.ratio / YIELD_CURVATURE  # k_f / B
        rest = (parameters.rest_angle + more * self.slid) / (1 + more)
        # B at the elastic curvature, which is not the curvature from the joint rest angle
        stiffness = (1 + more) * system.secant_bending(angle, parameters)
        tables = np.broadcast_to(stiffness[:, None, None], (len(angle), 3, 5))
        return system, replace(parameters, bending=np.ascontiguousarray(tables), rest_angle=rest)


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
    signed = False

    def _apply(self, setup: Setup, value: Values) -> Setup:
        return setup.with_added(states=HingeFriction(float(value["ratio"])))
