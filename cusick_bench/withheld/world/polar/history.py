"""True laws with internal variables, at the points of integration of a polar plate; others than those of triangles."""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.withheld.world.polar.material import PlateMaterial
from cusick_bench.withheld.world.scene import EffectParameters, Law, Scene

Strains = Float[ndarray, "intervals points 3"]

_RETARDATIONS = (3.0, 40.0)  # [s] of the two halves of creep
_RECOVERY = 0.05  # of the creep is lost when a cloth is laid again with the same face up,
_TURNED = 0.7  # and when it is turned over
_YIELD_CURVATURE = 1.5  # [1/m] at which bending friction slides
_YIELD_SHARE = 0.2  # of the limit's shear angle at which shear friction slides
_SIGN_CURVATURE = 6.0  # [1/m] over which face and back pass into each other


class PointVariables:
    """Internal variables of one plate during one drop."""

    def advance(self, strain: Strains, curvature: Strains, material: PlateMaterial, h: float) -> PlateMaterial:
        """Advances the internal variables by one step.

        Args:
            strain: E.
            curvature: k [1/m].
            material: The material as the laws before this one left it.
            h: Step [s].

        Returns:
            The material for the next step.
        """
        raise NotImplementedError

    def carried_over(self, curvature: Strains) -> Strains | None:
        """State that is carried over from this drop to the sample's next picture.

        Args:
            curvature: k at the end of the drop [1/m].

        Returns:
            A value for each point, or None where the cloth forgets everything.
        """
        return None


@dataclass(eq=False)
class Creep(PointVariables):
    """Two retarded halves q_i that follow the curvature; moment D (k - k0 - loss (q_1 + q_2) / 2)."""

    loss: float
    crept: Float[ndarray, "2 intervals points 3"]

    def advance(self, strain: Strains, curvature: Strains, material: PlateMaterial, h: float) -> PlateMaterial:
        """Rest curvatures that follow the cloth; see `PointVariables.advance`."""
        way = curvature - material.rest_curvature - self.crept
        self.crept = self.crept + way * (1 - np.exp(-h / np.array(_RETARDATIONS)))[:, None, None, None]
        return replace(material, rest_curvature=material.rest_curvature + self.loss * self.crept.mean(0))

    def carried_over(self, curvature: Strains) -> Strains | None:
        """After the picture the cloth stays as it is until it has crept fully."""
        return curvature


def _creep(scene: Scene, value: EffectParameters) -> Scene:
    """Creep begins under the first picture, and a part of it outlasts the turning over."""

    def start(material: PlateMaterial, scene: Scene) -> PointVariables:
        before, rest = scene.carried_over.get(Creep.__name__), material.rest_curvature
        if before is None:
            return Creep(value["loss"], np.zeros((2, *rest.shape)))
        crept = (1 - _RECOVERY) * (before - rest) if scene.later else -(1 - _TURNED) * (before + rest)
        return Creep(value["loss"], np.stack([crept, crept]))

    return scene.with_added(internal_variables=start)


@dataclass(eq=False)
class _BendingFriction(PointVariables):
    """Moment (HB / B) D q / k_y, q the curvature from where it last slid; it slides where |q| would exceed k_y."""

    ratio: float
    slid: Strains

    def advance(self, strain: Strains, curvature: Strains, material: PlateMaterial, h: float) -> PlateMaterial:
        elastic = curvature - self.slid
        size = np.sqrt(elastic[..., 0] ** 2 + elastic[..., 1] ** 2 + 0.5 * elastic[..., 2] ** 2)
        within = np.minimum(1, _YIELD_CURVATURE / np.maximum(size, _YIELD_CURVATURE))
        self.slid = curvature - elastic * within[..., None]
        more = self.ratio / _YIELD_CURVATURE
        rest = (material.rest_curvature + more * self.slid) / (1 + more)
        return replace(material, bending=material.bending * (1 + more), rest_curvature=rest)


def _bending_friction(scene: Scene, value: EffectParameters) -> Scene:
    """Friction that slides at once beyond its limit; each laying begins without it."""
    return scene.with_added(
        internal_variables=lambda material, scene: _BendingFriction(
            value["ratio"], np.zeros_like(material.rest_curvature)
        )
    )


@dataclass(eq=False)
class _ShearFriction(PointVariables):
    """Shear stress C33 (HG / G) q / g_y, q the shear angle from where it last slid."""

    limit: float  # HG / G [rad]
    slid: Float[ndarray, "intervals points"] = field(init=False)

    def __post_init__(self) -> None:
        self.slid = np.zeros(())

    def advance(self, strain: Strains, curvature: Strains, material: PlateMaterial, h: float) -> PlateMaterial:
        start = _YIELD_SHARE * self.limit
        self.slid = np.clip(self.slid, strain[..., 2] - start, strain[..., 2] + start)
        table, stretch = _full(material.stretch), material.stretch.copy()
        more = stretch[..., 5] * self.limit / start
        stretch[..., 5] += more
        stress = np.einsum("epij,epj->epi", table, material.rest_strain)
        stress[..., 2] += more * self.slid
        rest = np.linalg.solve(_full(stretch), stress[..., None])[..., 0]
        return replace(material, stretch=stretch, rest_strain=rest)


def _full(table: Float[ndarray, "intervals points 6"]) -> Float[ndarray, "intervals points 3 3"]:
    return table[..., np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])]


def _shear_friction(scene: Scene, value: EffectParameters) -> Scene:
    """Friction that slides at once beyond its limit; each laying begins without it."""
    if value["ratio"] == 0:
        return scene
    limit = float(np.radians(value["ratio"]))
    return scene.with_added(internal_variables=lambda material, scene: _ShearFriction(limit))


@dataclass(eq=False)
class _FaceAndBack(PointVariables):
    """Bending stiffness D (1 + a c / sqrt(c^2 + c0^2)), c the sum of curvatures, convex ones seen from the face."""

    asymmetry: float
    up: float

    def advance(self, strain: Strains, curvature: Strains, material: PlateMaterial, h: float) -> PlateMaterial:
        bent = curvature - material.rest_curvature
        convex = -self.up * (bent[..., 0] + bent[..., 1])
        factor = 1 + self.asymmetry * convex / np.hypot(convex, _SIGN_CURVATURE)
        return replace(material, bending=material.bending * factor[..., None])


def _face_asymmetry(scene: Scene, value: EffectParameters) -> Scene:
    """Face and back stiffen by the sign of the mean curvature."""
    asymmetry = value["asymmetry"]
    return scene.with_added(internal_variables=lambda material, scene: _FaceAndBack(asymmetry, scene.up))


LAWS: dict[str, Law] = {
    "face-asymmetry": _face_asymmetry,
    "creep": _creep,
    "bending-friction": _bending_friction,
    "shear-friction": _shear_friction,
}
"""True laws with internal variables."""
