"""True laws of the effects of class imaging."""

from dataclasses import replace

import numpy as np

from cusick_bench.sim.constants import CLOTH_RADIUS
from cusick_bench.withheld.world.photograph import PIXEL, leaned
from cusick_bench.withheld.world.scene import EffectParameters, Law, PositionMap, Scene, Vertices, unit_vector

_KEYSTONE = 0.015  # [1/m] of inverse height for each degree that a camera leans
_BARREL = 0.15  # [1/m2] of lens distortion for each [1/m] of a near camera's inverse height


def _camera_scale(scene: Scene, value: EffectParameters) -> Scene:
    """Pixels that are not quite square: the error is 10 % larger along x than along y."""
    factor = 1 + value["error"] * np.array([1.05, 0.95, 0.0])
    return scene.with_added(seen=lambda x: x * factor)


def _camera_offset(scene: Scene, value: EffectParameters) -> Scene:
    """A shift that wanders a little while the samples are taken."""
    wander = 0.15 * scene.random("specimen", "offset").normal(0, 1, 2)
    shift = value["shift"] * np.append(unit_vector(value["direction"]) + wander, 0.0)
    return scene.with_added(seen=lambda x: x + shift)


def _camera_tilt(scene: Scene, value: EffectParameters) -> Scene:
    """A leaning camera that is the nearer the more it leans, with keystone distortion."""

    def tilt(x: Vertices) -> Vertices:
        turned = leaned(x, value["angle"], *unit_vector(value["direction"]))
        return _near(_KEYSTONE * value["angle"])(turned)

    return scene.with_added(seen=tilt)


def _perspective(scene: Scene, value: EffectParameters) -> Scene:
    """A near camera whose lens bends straight lines a little."""
    inverse = value["inverse_height"]
    return scene.with_added(seen=lambda x: barrel(_BARREL * inverse)(_near(inverse)(x)))


def _near(inverse: float) -> PositionMap:
    def project(x: Vertices) -> Vertices:
        return np.column_stack([x[:, :2] / (1 - inverse * x[:, 2:]), x[:, 2]])

    return project


def barrel(strength: float) -> PositionMap:
    """Barrel distortion: a point at the distance r from the middle seems to be at r (1 - s r^2).

    Args:
        strength: Strength s [1/m2].

    Returns:
        The map from positions to where they seem to be.
    """

    def bend(x: Vertices) -> Vertices:
        distance = np.minimum((x[:, :2] ** 2).sum(1), (1.5 * CLOTH_RADIUS) ** 2)
        return np.column_stack([x[:, :2] * (1 - strength * distance)[:, None], x[:, 2]])

    return bend


def _threshold(scene: Scene, value: EffectParameters) -> Scene:
    """A blurred picture that is cut at another grey level; on a straight edge the outline moves by the shift."""
    outwards = value["shift"] / PIXEL
    return replace(scene, outwards=outwards, blur_of_cut=max(scene.blur, 0.8 * abs(outwards)))


LAWS: dict[str, Law] = {
    "camera-scale": _camera_scale,
    "camera-offset": _camera_offset,
    "camera-tilt": _camera_tilt,
    "perspective": _perspective,
    "threshold": _threshold,
}
"""True laws of the effects of class imaging."""
