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
    from cusick_bench.sim.engine.elements import Elements
    from cusick_bench.sim.engine.parameters import Parameters
    from cusick_bench.sim.engine.system import DrapeSystem
    from cusick_bench.sim.setup import Setup


YIELD_SHEAR = math.radians(0.2)
"""Change of shear angle [rad] over which the friction turns round: small against the 8 degrees of Kawabata's test."""

_SHEAR_COLUMN = 3  # of C: c33


@dataclass(frozen=True)
class FaceFriction(StateLaw):
    """Coulomb friction in the shear stress.

    Attributes:
        ratio: Friction stress per shear stiffness, HG / G [rad].
    """

    rank: ClassVar[Rank] = Rank.FRICTION
    ratio: float

    def start(self, system: DrapeSystem, parameters: Parameters) -> SlidFaces:
        """No face has slid yet."""
        return SlidFaces(self.ratio, np.zeros(len(system.elements.faces)))


@dataclass
class SlidFaces(State):
    """Where the friction elements of one cloth are free of stress.

    Attributes:
        ratio: As in `FaceFriction`.
        slid: Shear x_u . x_v of the faces.
    """

    ratio: float
    slid: Float[ndarray, " faces"]

    def advance(
        self, system: DrapeSystem, parameters: Parameters, x: Float[ndarray, "vertices 3"], share: float
    ) -> tuple[DrapeSystem, Parameters]:
        """Springs G and g_f in parallel as one: stiffness G + g_f, rest shear g_f slid / (G + g_f)."""
        uu, vv, uv = metric(system.elements, x)
        self.slid = np.clip(self.slid, uv - YIELD_SHEAR, uv + YIELD_SHEAR)
        more = self.ratio / YIELD_SHEAR  # g_f / G
        rest = more * self.slid / (1 + more)
        stretch = parameters.stretch.copy()
        stretch[..., _SHEAR_COLUMN] *= 1 + more
        elements = replace(system.elements, face_v=_sheared(system.elements, uu, vv, uv, uv - rest))
        return system.with_elements(elements), replace(parameters, stretch=stretch)


def metric(elements: Elements, x: Float[ndarray, "vertices 3"]) -> tuple[ndarray, ndarray, ndarray]:
    """x_u . x_u, x_v . x_v and x_u . x_v of every face.

    Args:
        elements: Element constants of the cloth.
        x: Positions [m].

    Returns:
        Three arrays (faces,), without unit.
    """
    corners = x[elements.faces]
    u = (elements.face_u[:, :, None] * corners).sum(1)
    v = (elements.face_v[:, :, None] * corners).sum(1)
    return (u * u).sum(1), (v * v).sum(1), (u * v).sum(1)


def _sheared(elements: Elements, uu: ndarray, vv: ndarray, uv: ndarray, wanted: ndarray) -> Float[ndarray, "faces 3"]:
    """s_v of a frame a x_u + b x_v in which the face, as it is now, has the wanted shear and its old stretches."""
    b = np.sqrt((uu * vv - wanted**2) / (uu * vv - uv**2))
    a = (wanted - b * uv) / uu
    return np.ascontiguousarray(a[:, None] * elements.face_u + b[:, None] * elements.face_v)


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
    signed = False

    def _apply(self, setup: Setup, value: Values) -> Setup:
        return setup.with_added(states=FaceFriction(math.radians(float(value["ratio"]))))
