"""True laws of effects that are not on the package's list."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.constants import CLOTH_RADIUS, GRAVITY
from cusick_bench.withheld.world.laws.boundary import wavy
from cusick_bench.withheld.world.laws.imaging import barrel
from cusick_bench.withheld.world.scene import EffectParameters, Law, Scene, Vertices, unit_vector

_AIR = 0.5 * 1.2 * 1.2  # [kg/m3] half the air's density times a drag coefficient
_SEAM_WIDTH = 0.004  # [m]
_SEAM_STIFFENING = np.log(6.0)  # on bending stiffness; its thread doubles the mass
_CREASE = 0.005  # [m] half width of a pressed-in crease


def _draught(scene: Scene, value: EffectParameters) -> Scene:
    """Wind [m/s] from the side and a third of it from below, with gusts: pressure on what faces it."""
    gust = 1 + 0.1 * scene.random("capture", "gust").normal()
    wind = gust * value["speed"] * np.append(scene.direction(value["direction"]), 0.33)

    def push(normal: Float[ndarray, "points 3"]) -> Float[ndarray, "points"]:
        against = normal @ wind
        return _AIR * np.abs(against) * against

    return scene.with_added(pressures=push)


def _charge(scene: Scene, value: EffectParameters) -> Scene:
    """A charged cloth: every part is pushed away from the axis by a share of its weight that grows with radius."""

    def push(x: Vertices) -> Vertices:
        return value["share"] * GRAVITY / CLOTH_RADIUS * x * np.array([1.0, 1.0, 0.0])

    return scene.with_added(accelerations=push)


def _seam(scene: Scene, value: EffectParameters) -> Scene:
    """A line of stitches across the cloth, beside its centre."""

    def across(points: Float[ndarray, "points 2"]) -> Float[ndarray, "points"]:
        distance = points @ unit_vector(value["direction"] + 90) - value["offset"]
        return np.exp(-((distance / _SEAM_WIDTH) ** 2))

    return scene.with_added(
        log_bending=lambda points: value["size"] * _SEAM_STIFFENING * across(points),
        log_mass=lambda points: np.log1p(value["size"] * across(points)),
    )


def _crease_ring(scene: Scene, value: EffectParameters) -> Scene:
    """A circle pressed into the cloth, e.g. by a hoop: it wants to stay folded by an angle [deg]."""
    slope = np.tan(np.radians(value["angle"]) / 2)

    def ridge(points: Float[ndarray, "points 2"]) -> Float[ndarray, "points"]:
        return slope * np.maximum(0, 2 * _CREASE - np.abs(np.hypot(*points.T) - value["radius"]))

    return scene.with_added(rest=ridge)


def _elliptical_cut(scene: Scene, value: EffectParameters) -> Scene:
    """A cut that is longer in one direction of the cloth: radius R (1 + e cos 2 (phi - phi0))."""
    return scene.with_added(outlines=wavy(value["elongation"], 2, 2 * np.radians(value["direction"])))


def _lens(scene: Scene, value: EffectParameters) -> Scene:
    """Barrel distortion (strength in 1/m2); scaled such that the plate's edge is seen where it is."""
    bend, kept = barrel(value["strength"]), 1 / (1 - value["strength"] * scene.plate_radius**2)
    return scene.with_added(seen=lambda x: bend(x) * np.array([kept, kept, 1.0]))


def _smear(scene: Scene, value: EffectParameters) -> Scene:
    """The cloth moves while the picture is taken, by a length [px] in one direction."""
    return replace(scene, smear=(value["length"], value["direction"]))


def _frilled(scene: Scene, value: EffectParameters) -> Scene:
    """A rim stretched out of shape: rest lengths grow towards it."""

    def longer(points: Float[ndarray, "points 2"]) -> Float[ndarray, "points"]:
        return value["growth"] * (np.hypot(*points.T) / CLOTH_RADIUS) ** 6

    return scene.with_added(growth=longer)


LAWS: dict[str, Law] = {
    "draught": _draught,
    "charge": _charge,
    "seam": _seam,
    "crease-ring": _crease_ring,
    "elliptical-cut": _elliptical_cut,
    "lens": _lens,
    "smear": _smear,
    "frilled": _frilled,
}
"""True laws of the effects outside of the list."""
