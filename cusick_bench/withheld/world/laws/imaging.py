"""True laws of the effects of class imaging."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cusick_bench.sim.constants import CLOTH_RADIUS
from cusick_bench.withheld.world.photograph import PIXEL, leaned
from cusick_bench.withheld.world.scene import PositionMap, Scene, Vertices, unit

Values = Mapping[str, float]

_KEYSTONE = 0.015  # [1/m] of inverse height for each degree that a camera leans
_BARREL = 0.15  # [1/m2] of lens distortion for each [1/m] of a near camera's inverse height


def camera_scale(scene: Scene, value: Values) -> Scene:
    """Pixels that are not quite square: the error is 10 % larger along x than along y."""
    factor = 1 + value["error"] * np.array([1.05, 0.95, 0.0])
    return scene.with_added(seen=lambda x: x * factor)


def camera_offset(scene: Scene, value: Values) -> Scene:
    """A shift that wanders a little while the samples are taken."""
    wander = 0.15 * scene.random("specimen", "offset").normal(0, 1, 2)
    shift = value["shift"] * np.append(unit(value["direction"]) + wander, 0.0)
    return scene.with_added(seen=lambda x: x + shift)


def camera_tilt(scene: Scene, value: Values) -> Scene:
    """A leaning camera that is the nearer the more it leans, with keystone distortion."""

    def tilt(x: Vertices) -> Vertices:
        turned = leaned(x, value["angle"], *unit(value["direction"]))
        return _near(_KEYSTONE * value["angle"])(turned)

    return scene.with_added(seen=tilt)


def perspective(scene: Scene, value: Values) -> Scene:
    """A near camera whose lens bends straight lines a little."""
    inverse = value["inverse_height"]
    return scene.with_added(seen=lambda x: barrel(_BARREL * inverse)(_near(inverse)(x)))


def _near(inverse: float) -> PositionMap:
    def project(x: Vertices) -> Vertices:
        return np.column_stack([x[:, :2] / (1 - inverse * x[:, 2:]), x[:, 2]])

    return project


def barrel(strength: float) -> PositionMap:
    """A lens that draws in what lies far from the middle: r (1 - strength r^2), strength in 1/m2."""

    def bend(x: Vertices) -> Vertices:
        distance = np.minimum((x[:, :2] ** 2).sum(1), (1.5 * CLOTH_RADIUS) ** 2)
        return np.column_stack([x[:, :2] * (1 - strength * distance)[:, None], x[:, 2]])

    return bend


def threshold(scene: Scene, value: Values) -> Scene:
    """A blurred picture that is cut at another grey level; on a straight edge the outline moves by the shift."""
    outwards = value["shift"] / PIXEL
    return replace(scene, outwards=outwards, blur=max(scene.blur, 0.8 * abs(outwards)))
