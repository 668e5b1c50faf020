"""True laws with internal variables, on the hinges and faces of a triangle mesh."""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.withheld.world.scene import EffectParameters, Law, Scene, Vertices
from cusick_bench.withheld.world.triangles.internal_variables import InternalVariables

_RETARDATION = 20.0  # [s] in which a cloth under the camera creeps
_RECOVERY = 0.1  # of the creep is lost when a cloth is laid again with the same face up,
_TURNED = 0.65  # and when it is turned over
_SIGN_CURVATURE = 5.0  # [1/m] over which face and back pass into each other
_FRICTION_CURVATURE = 2.0  # [1/m] at which bending friction is 76 % of its limit
_HINGE_SHARE = 0.5**0.5
"""Friction couple of a hinge over that of the cloth. Hinges whose edges run in all directions see a curvature as
c cos^2; elastic energies add up where c^2 mean(cos^4) = 1/3, c^2 = 8/9, and couples of constant size then to
(4/3) / c times each."""

_FRICTION_STRAIN = 0.25  # of the limit's shear angle, likewise for shear friction
_SLIDES = 2.5  # multiple of these beyond which the friction's own state follows


@dataclass(eq=False)
class Creep(InternalVariables):
    """A standard linear solid: q follows the angle within `_RETARDATION`, moment B (angle - rest - loss q)."""

    loss: float
    crept: Float[ndarray, "hinges"]

    def advance(
        self, x: Vertices, angle: Float[ndarray, "hinges"], p: Parameters, h: float
    ) -> tuple[Parameters, Vertices | None]:
        """Rest angles that follow the cloth; see `InternalVariables.advance`."""
        self.crept = self.crept + (angle - p.rest_angle - self.crept) * (1 - np.exp(-h / _RETARDATION))
        return replace(p, rest_angle=p.rest_angle + self.loss * self.crept), None

    def carried_over(self, angle: Float[ndarray, "hinges"]) -> Float[ndarray, "hinges"] | None:
        """After the picture the cloth stays as it is until it has crept fully."""
        return angle


def _creep(scene: Scene, value: EffectParameters) -> Scene:
    """Creep begins under the first picture, and a part of it outlasts the turning over."""

    def start(system: DrapeSystem, p: Parameters, scene: Scene) -> InternalVariables:
        before = scene.carried_over.get(Creep.__name__)
        if before is None:
            return Creep(value["loss"], np.zeros_like(p.rest_angle))
        kept = 1 - _RECOVERY if scene.later else -(1 - _TURNED)
        rest = p.rest_angle if scene.later else -p.rest_angle
        return Creep(value["loss"], kept * (before - rest))

    return scene.with_added(internal_variables=start)


@dataclass(eq=False)
class _BendingFriction(InternalVariables):
    """Moment HB tanh((k - k_p) / k0), with k_p drawn along beyond `_SLIDES` k0."""

    system: DrapeSystem
    ratio: float
    slid: Float[ndarray, "hinges"]

    def advance(
        self, x: Vertices, angle: Float[ndarray, "hinges"], p: Parameters, h: float
    ) -> tuple[Parameters, Vertices | None]:
        scale = self.system.elements.hinge_scale
        limit = _SLIDES * _FRICTION_CURVATURE
        curvature = angle * scale
        self.slid = np.clip(self.slid, curvature - limit, curvature + limit)
        more = _HINGE_SHARE * self.ratio * _secant((curvature - self.slid) / _FRICTION_CURVATURE) / _FRICTION_CURVATURE
        rest = (p.rest_angle + more * self.slid / scale) / (1 + more)
        return replace(p, bending=p.bending * (1 + more)[:, None, None], rest_angle=rest), None


def _bending_friction(scene: Scene, value: EffectParameters) -> Scene:
    """Friction that sets in gradually; each laying begins without it."""

    def start(system: DrapeSystem, p: Parameters, scene: Scene) -> InternalVariables:
        return _BendingFriction(system, value["ratio"], np.zeros_like(p.rest_angle))

    return scene.with_added(internal_variables=start)


@dataclass(eq=False)
class _ShearFriction(InternalVariables):
    """Shear stress HG tanh((g - g_p) / g0), g the shear angle, as a secant stiffness and the stress it has too much."""

    system: DrapeSystem
    limit: float  # HG / G [rad]
    slid: Float[ndarray, "faces"] = field(init=False)

    def __post_init__(self) -> None:
        self.slid = np.zeros(len(self.system.elements.faces))

    def advance(
        self, x: Vertices, angle: Float[ndarray, "hinges"], p: Parameters, h: float
    ) -> tuple[Parameters, Vertices | None]:
        el = self.system.elements
        corner = x[el.faces]
        along, across = (np.einsum("fa,fax->fx", weight, corner) for weight in (el.face_u, el.face_v))
        shear = (along * across).sum(1)  # 2 G01
        scale = _FRICTION_STRAIN * self.limit
        self.slid = np.clip(self.slid, shear - _SLIDES * scale, shear + _SLIDES * scale)
        more = _secant((shear - self.slid) / scale) * self.limit / scale  # over G
        stretch = p.stretch.copy()
        stretch[:, :, 3] *= (1 + more)[:, None]
        # the raised table pulls towards no shear; this takes it back to the slid state
        stress = el.face_area * p.stretch[:, 0, 3] * more * self.slid
        force = stress[:, None, None] * (el.face_u[..., None] * across[:, None] + el.face_v[..., None] * along[:, None])
        return replace(p, stretch=stretch), _gathered(el.faces, force, len(x))


def _shear_friction(scene: Scene, value: EffectParameters) -> Scene:
    """Friction that sets in gradually; each laying begins without it."""
    if value["ratio"] == 0:
        return scene

    def start(system: DrapeSystem, p: Parameters, scene: Scene) -> InternalVariables:
        return _ShearFriction(system, float(np.radians(value["ratio"])))

    return scene.with_added(internal_variables=start)


def _secant(s: ndarray) -> ndarray:
    """tanh(s) / s."""
    small = np.abs(s) < 1e-6
    return np.where(small, 1.0, np.tanh(s) / np.where(small, 1.0, s))


def _gathered(faces: ndarray, force: Float[ndarray, "faces 3 3"], vertices: int) -> Vertices:
    """Forces on corners, summed up at the vertices."""
    corner = faces.ravel()
    return np.column_stack([np.bincount(corner, force[..., k].ravel(), vertices) for k in range(3)])


@dataclass(eq=False)
class _FaceAndBack(InternalVariables):
    """Bending stiffness B (1 + a tanh(k / k0)), k the curvature seen from the face."""

    system: DrapeSystem
    asymmetry: float
    up: float

    def advance(
        self, x: Vertices, angle: Float[ndarray, "hinges"], p: Parameters, h: float
    ) -> tuple[Parameters, Vertices | None]:
        curvature = self.up * (angle - p.rest_angle) * self.system.elements.hinge_scale
        factor = 1 + self.asymmetry * np.tanh(curvature / _SIGN_CURVATURE)
        return replace(p, bending=p.bending * factor[:, None, None]), None


def _face_asymmetry(scene: Scene, value: EffectParameters) -> Scene:
    """Face and back stiffen gradually, not at once, where the curvature changes its sign."""
    asymmetry = value["asymmetry"]
    return scene.with_added(internal_variables=lambda system, p, scene: _FaceAndBack(system, asymmetry, scene.up))


LAWS: dict[str, Law] = {
    "face-asymmetry": _face_asymmetry,
    "creep": _creep,
    "bending-friction": _bending_friction,
    "shear-friction": _shear_friction,
}
"""True laws with internal variables."""
