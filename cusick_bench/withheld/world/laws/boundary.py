"""True laws of the effects of class boundary."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.constants import CLOTH_RADIUS
from cusick_bench.withheld.world.fields import Outline
from cusick_bench.withheld.world.scene import EffectParameters, Law, Scene, unit_vector


def _off_centre(scene: Scene, value: EffectParameters) -> Scene:
    """A cloth beside the axis, by a little more or less each time."""
    size = value["shift"] * (1 + 0.1 * scene.random("face", "centre").normal())
    return _moved(scene, size * unit_vector(value["direction"]))


def _plate_tilt(scene: Scene, value: EffectParameters) -> Scene:
    """Gravity is askew in the plate's frame."""
    east, north = scene.direction(value["direction"])
    return replace(scene, tilt=(value["angle"], float(np.degrees(np.arctan2(north, east)))))


def _plate_radius(scene: Scene, value: EffectParameters) -> Scene:
    """Another plate, of the true radius from the start."""
    return replace(scene, plate_radius=scene.plate_radius + value["error"])


def _plate_slip(scene: Scene, value: EffectParameters) -> Scene:
    """A slide of random size: most of it when a face is laid down, some of it before each picture."""
    laying, again = (scene.random(level, "slip") for level in ("face", "capture"))
    laid = laying.normal(1, 0.3) * unit_vector(laying.uniform(0, 360))
    return _moved(scene, value["slide"] * (laid + again.normal(0, 0.15, 2)))


def _cut_size(scene: Scene, value: EffectParameters) -> Scene:
    """A cut that is larger, and not quite round."""
    error, phase = value["error"], scene.random("specimen", "cut").uniform(0, 2 * np.pi)
    scene = replace(scene, radius=CLOTH_RADIUS + error)
    return scene.with_added(outlines=wavy(0.15 * error / scene.radius, 3, phase))


def wavy(amplitude: float, order: int, phase: float) -> Outline:
    """A cut whose radius varies around the cloth: 1 + a cos(n phi - phi0) times the nominal one.

    Args:
        amplitude: Amplitude a.
        order: Number n of waves.
        phase: Phase phi0 [rad].

    Returns:
        The outline.
    """

    def outline(direction: Float[ndarray, "points"]) -> Float[ndarray, "points"]:
        return 1 + amplitude * np.cos(order * direction - phase)

    return outline


def _moved(scene: Scene, lab: Float[ndarray, "2"]) -> Scene:
    """The cloth's centre moved by a vector of the laboratory."""
    return replace(scene, centre=(scene.centre[0] + scene.up * float(lab[0]), scene.centre[1] + float(lab[1])))


LAWS: dict[str, Law] = {
    "off-centre": _off_centre,
    "plate-tilt": _plate_tilt,
    "plate-radius": _plate_radius,
    "plate-slip": _plate_slip,
    "cut-size": _cut_size,
}
"""True laws of the effects of class boundary."""
