"""How a true drape becomes a picture: placed under the camera, seen, blurred, cut, noisy, eight bits, compressed."""

import io

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray
from PIL import Image
from scipy.ndimage import gaussian_filter, shift
from scipy.special import ndtr

from cusick_bench.sim.constants import PIXELS_PER_METRE
from cusick_bench.sim.render.camera import ParallelCamera
from cusick_bench.sim.render.silhouette import render
from cusick_bench.withheld.world.fabric import Variability
from cusick_bench.withheld.world.scene import Scene, Vertices, unit

_RAMP = 0.8  # of the shades between the cut's level and the nearer of white and black that it spreads over the scale
_NOISE = 1.2  # standard deviation of grey levels, of 255
_QUALITY = 93  # of the JPEG file
_SMEARED = 9  # exposures over the way of a moving cloth


def seen_from_above(x: Vertices, scene: Scene, variability: Variability) -> Vertices:
    """From the simulated cloth to where its points seem to be, for a parallel projection [m]."""
    seen = x * np.array([scene.up, 1.0, 1.0])
    if scene.tilt[0]:
        east, north = unit(scene.tilt[1])
        seen = leaned(seen, scene.tilt[0], scene.up * float(east), float(north))
    generator = scene.random("capture", "place under the camera")
    angle, place = generator.normal(0, variability.turn), generator.normal(0, variability.shift, 2)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    seen[:, :2] = seen[:, :2] @ turn.T + place
    for change in scene.seen:
        seen = change(seen)
    return seen


def leaned(x: Vertices, degrees: float, east: float, north: float) -> Vertices:
    """Points turned about the horizontal axis through the origin that takes +z towards (east, north)."""
    along, z = x[:, :2] @ np.array([east, north]), x[:, 2]
    cosine, sine = unit(degrees)
    moved = along * (cosine - 1) + z * sine
    return np.column_stack([x[:, 0] + moved * east, x[:, 1] + moved * north, z * cosine - along * sine])


def photograph(seen: Vertices, faces: ndarray, scene: Scene) -> UInt8[ndarray, "256 256"]:
    """Grey levels, dark where the cloth is."""
    cover = render(torch.from_numpy(np.ascontiguousarray(seen)), faces, ParallelCamera()).numpy()
    shade = gaussian_filter(_smeared(cover, scene.smear), scene.blur)
    if scene.outwards is not None:
        level = ndtr(-scene.outwards / scene.blur)
        shade = np.clip((shade - level) / (_RAMP * min(level, 1 - level)) + 0.5, 0, 1)
    noise = scene.random("capture", "noise").normal(0, _NOISE, shade.shape)
    return np.clip(np.round(255 * (1 - shade) + noise), 0, 255).astype(np.uint8)


def _smeared(cover: Float[ndarray, "256 256"], smear: tuple[float, float]) -> Float[ndarray, "256 256"]:
    length, direction = smear
    if length == 0:
        return cover
    east, north = unit(direction)
    ways = np.linspace(-0.5, 0.5, _SMEARED) * length
    return np.mean([shift(cover, (-way * north, way * east), order=1) for way in ways], axis=0)


def jpeg(levels: UInt8[ndarray, "256 256"]) -> bytes:
    """The picture as a file."""
    packed = io.BytesIO()
    Image.fromarray(levels).save(packed, "JPEG", quality=_QUALITY)
    return packed.getvalue()


PIXEL = 1 / PIXELS_PER_METRE
"""[m]."""
