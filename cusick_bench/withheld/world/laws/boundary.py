"""True laws of the effects of class boundary."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.constants import CLOTH_RADIUS
from cusick_bench.withheld.world.placed_disc import Outline
from cusick_bench.withheld.world.scene import Scene, unit

Values = Mapping[str, float]


def off_centre(scene: Scene, value: Values) -> Scene:
    """A cloth beside the axis, by a little more or less each time."""
    size = value["shift"] * (1 + 0.1 * scene.random("face", "centre").normal())
    return _moved(scene, size * unit(value["direction"]))


def plate_tilt(scene: Scene, value: Values) -> Scene:
    """Gravity is askew in the plate's frame."""
    east, north = scene.direction(value["direction"])
    return replace(scene, tilt=(value["angle"], float(np.degrees(np.arctan2(north, east)))))


def plate_radius(scene: Scene, value: Values) -> Scene:
    """Another plate, of the true radius from the start."""
    return replace(scene, plate_radius=scene.plate_radius + value["error"])


def plate_slip(scene: Scene, value: Values) -> Scene:
    """A slide of random size: most of it when a face is laid down, some of it before each picture."""
    laying, again = (scene.random(level, "slip") for level in ("face", "capture"))
    laid = laying.normal(1, 0.3) * unit(laying.uniform(0, 360))
    return _moved(scene, value["slide"] * (laid + again.normal(0, 0.15, 2)))


def cut_size(scene: Scene, value: Values) -> Scene:
    """A cut that is larger, and not quite round."""
    error, phase = value["error"], scene.random("specimen", "cut").uniform(0, 2 * np.pi)
    scene = replace(scene, radius=CLOTH_RADIUS + error)
    return scene.with_added(outlines=wavy(0.15 * error / scene.radius, 3, phase))


def wavy(amplitude: float, order: int, phase: float) -> Outline:
    """A cut whose radius varies around the cloth."""

    def outline(direction: Float[ndarray, "points"]) -> Float[ndarray, "points"]:
        return 1 + amplitude * np.cos(order * direction - phase)

    return outline


def _moved(scene: Scene, lab: Float[ndarray, "2"]) -> Scene:
    """The cloth's centre moved by a vector of the laboratory."""
    return replace(scene, centre=(scene.centre[0] + scene.up * float(lab[0]), scene.centre[1] + float(lab[1])))
