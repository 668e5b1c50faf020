"""True laws of the effects of class material that are fields over the cloth."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.constants import CLOTH_RADIUS
from cusick_bench.withheld.world.fields import Field, matern_field
from cusick_bench.withheld.world.scene import (
    EffectParameters,
    Law,
    Scene,
    Surface,
    unit_vector,
)

_EDGE = 0.002  # [m] over which a patch or a hem ends


def _rest_curvature(scene: Scene, value: EffectParameters) -> Scene:
    """A cloth that wants to roll up about an axis in its plane, more so towards its edges."""
    return scene.with_added(surfaces=rolled(value["curvature"], unit_vector(value["direction"])))


def rolled(curvature: float, along: Float[ndarray, "2"]) -> Surface:
    """A roll with curvature k (0.9 + 0.4 (s/R)^2) over the distance s from its middle: on a disc, k in the mean.

    Args:
        curvature: Mean curvature k [1/m].
        along: Unit vector of the direction in which the cloth is rolled up.

    Returns:
        The shape without stress.
    """
    s = np.linspace(-1.2 * CLOTH_RADIUS, 1.2 * CLOTH_RADIUS, 1201)
    slope = curvature * (0.9 * s + 0.4 / 3 * s**3 / CLOTH_RADIUS**2)
    step = s[1] - s[0]
    x, z = (np.append(0, np.cumsum(0.5 * step * (f[1:] + f[:-1]))) for f in (np.cos(slope), np.sin(slope)))
    middle = len(s) // 2

    def surface(points: Float[ndarray, "points 2"]) -> Float[ndarray, "points 3"]:
        at, across = points @ along, points @ np.array([-along[1], along[0]])
        flat = np.interp(at, s, x - x[middle])[:, None] * along + across[:, None] * np.array([-along[1], along[0]])
        return np.column_stack([flat, np.interp(at, s, z - z[middle])])

    return surface


def _grain_skew(scene: Scene, value: EffectParameters) -> Scene:
    """Weft runs farther askew than warp: by 1.3 and 0.7 of the angle."""
    angle = value["angle"]
    return replace(scene, skew=(scene.skew[0] + 0.7 * angle, scene.skew[1] + 1.3 * angle))


def _density_bias(scene: Scene, value: EffectParameters) -> Scene:
    """The cloth is heavier than the case's table says, by a little more in some samples than in others."""
    bias = value["bias"] * (1 + 0.1 * scene.random("specimen", "density").normal())
    return scene.with_added(log_mass=lambda points: np.full(len(points), np.log1p(bias)))


def _stiffness_field(scene: Scene, value: EffectParameters) -> Scene:
    """A rough field of stiffness, half of it common to stretch and bending, half of it to one."""
    generator = scene.random("specimen", "stiffness field")
    spread, length = value["spread"] / np.sqrt(2), value["length"]
    common, bending, stretch = (matern_field(spread, length, 1.5, generator) for _ in range(3))
    return scene.with_added(log_bending=_sum(common, bending), log_stretch=_sum(common, stretch))


def _sum(first: Field, second: Field) -> Field:
    return lambda points: first(points) + second(points)


def _local_stiff_patch(scene: Scene, value: EffectParameters) -> Scene:
    """A patch of even stiffness: a disc, or a piece of a ring."""
    inside = _patch(scene, value)
    return scene.with_added(log_bending=lambda points: value["stiffening"] * inside(points))


def _local_mass_patch(scene: Scene, value: EffectParameters) -> Scene:
    """An even spot of added mass: a disc, or a piece of a ring."""
    inside = _patch(scene, value)
    return scene.with_added(log_mass=lambda points: np.log1p(value["mass"] * inside(points)))


def _patch(scene: Scene, value: EffectParameters) -> Field:
    """1 inside, 0 outside, over as much cloth as a Gaussian of the given size weighs: area 2 pi size^2."""
    size, radius, direction = value["size"], value["radius"], value["direction"]
    round_one = bool(scene.random("case", "shape of the patch").integers(2))

    def inside(points: Float[ndarray, "points 2"]) -> Float[ndarray, "points"]:
        if round_one:
            return _within(np.hypot(*(points - radius * unit_vector(direction)).T), np.sqrt(2) * size)
        r, turn = np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0]) - np.radians(direction)
        half = 0.5 * np.sqrt(2 * np.pi) * size
        return _within(np.abs(r - radius), half) * _within(radius * np.abs((turn + np.pi) % (2 * np.pi) - np.pi), half)

    return inside


def _within(distance: Float[ndarray, "points"], limit: float) -> Float[ndarray, "points"]:
    return 0.5 * (1 + np.tanh((limit - distance) / _EDGE))


def _rim_stiffening(scene: Scene, value: EffectParameters) -> Scene:
    """A hem: an even band of the given width along the rim."""

    def hem(points: Float[ndarray, "points 2"]) -> Float[ndarray, "points"]:
        return value["stiffening"] * _within(scene.radius - np.hypot(*points.T), value["width"])

    return scene.with_added(log_bending=hem)


LAWS: dict[str, Law] = {
    "rest-curvature": _rest_curvature,
    "grain-skew": _grain_skew,
    "density-bias": _density_bias,
    "stiffness-field": _stiffness_field,
    "local-stiff-patch": _local_stiff_patch,
    "local-mass-patch": _local_mass_patch,
    "rim-stiffening": _rim_stiffening,
}
"""True laws of the effects of class material."""
