"""The cloth bends more easily over one face than over the other.

Under laws `paper` and `published` it acts hinge by hinge. Where a sheet is rolled up along a direction of its mesh's
edges, the hinges along that direction bend backwards by a third of its curvature: there the sheet shows 7/9 of the
asymmetry, all of it where it is rolled up across edges, and 0.885 on the mean over all directions.

Under law `plate` it acts at the edge points, in proportion to (k1 + k2) / (|k1| + |k2|) with the principal curvatures
k1 and k2: in full wherever the sheet is bent to one side only, as on every cylinder, and not at all on a saddle bent
equally to both, where moments then pass continuously from one side to the other.
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


@dataclass(frozen=True)
class TwoSided(StateLaw, State):
    """Bending stiffness by the sign of curvature. It remembers nothing: moments stay continuous through zero.

    Attributes:
        convex: B's relative change where the simulated cloth is convex seen from above.
    """

    rank: ClassVar[Rank] = Rank.ELASTICITY
    convex: float

    def start(self, system: ClothSystem, parameters: Parameters) -> TwoSided:
        """The law itself: it has no memory."""
        return self

    def advance(
        self, system: ClothSystem, parameters: Parameters, x: Float[ndarray, "vertices 3"], share: float
    ) -> tuple[ClothSystem, Parameters]:
        """Scales the bending stiffness of every element by the side to which it is bent now."""
        from cusick_bench.sim.engine.strains import strains

        own = strains(system)
        factor = 1 + self.convex * own.convexity(own.bending(x) - parameters.rest_angle)
        return system, replace(parameters, bending=parameters.bending * factor[:, None, None])


class FaceAsymmetry(Effect):
    """Bending stiffness that differs between the faces, as of a twill, a pile or a coated cloth."""

    name = "face-asymmetry"
    kind = "material"
    face_odd = True
    summary = "the cloth is stiffer when bent over one face"
    physics = (
        "Bending stiffness B (1 + asymmetry) where the cloth is bent convex seen from its face, from its rest shape, "
        "and B (1 - asymmetry) where concave; the moment is continuous through zero."
    )
    reference = "Kawabata. The standardization and analysis of hand evaluation. 2nd ed., 1980 (bent to either face)."
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "asymmetry", "1", -0.9, 0.9, 0.2, "difference of B between faces about 20 %",
            summary="relative change of B, convex seen from the face",
        ),
    )  # fmt: skip

    def _apply(self, setup: Setup, value: Values) -> Setup:
        asymmetry = float(value["asymmetry"])
        return setup.with_added(states=TwoSided(asymmetry if setup.side == "up" else -asymmetry))
