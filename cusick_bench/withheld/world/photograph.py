"""How a true drape becomes a picture: placed under the camera, seen, blurred, cut, noisy, eight bits, compressed."""

import io

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray
from PIL import Image
from scipy.ndimage import gaussian_filter, shift
from scipy.special import ndtri

from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.datasets.files.silhouette import camera_of
from cusick_bench.sim.render.silhouette import render
from cusick_bench.withheld.world.fabric import Variability
from cusick_bench.withheld.world.scene import Scene, Vertices, unit_vector

LABORATORY = RELEASE
"""Nominal values of the laboratory that suites come from: set up as the public release's."""

_LEAST_SHARE = 1e-9  # least shade of a blurred edge, so that the distance to the edge stays finite
_SMEARED = 9  # exposures over the way of a moving cloth


def seen_from_above(x: Vertices, scene: Scene, variability: Variability) -> Vertices:
    """Places a simulated cloth under the camera.

    Args:
        x: Positions of the simulated cloth [m].
        scene: The circumstances of the picture.
        variability: How precisely a cloth is placed.

    Returns:
        Where its points seem to be in a parallel projection [m].
    """
    seen = x * np.array([scene.up, 1.0, 1.0])
    if scene.tilt[0]:
        east, north = unit_vector(scene.tilt[1])
        seen = leaned(seen, scene.tilt[0], scene.up * float(east), float(north))
    generator = scene.random("capture", "place under the camera")
    angle, place = generator.normal(0, variability.turn), generator.normal(0, variability.shift, 2)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    seen[:, :2] = seen[:, :2] @ turn.T + place
    for change in scene.seen:
        seen = change(seen)
    return seen


def leaned(x: Vertices, degrees: float, east: float, north: float) -> Vertices:
    """Turns points about a horizontal axis through the origin.

    Args:
        x: Positions [m].
        degrees: Angle of the turn [deg].
        east: East component of the unit vector towards which +z turns.
        north: Its north component.

    Returns:
        The turned positions [m].
    """
    along, z = x[:, :2] @ np.array([east, north]), x[:, 2]
    cosine, sine = unit_vector(degrees)
    moved = along * (cosine - 1) + z * sine
    return np.column_stack([x[:, 0] + moved * east, x[:, 1] + moved * north, z * cosine - along * sine])


def photograph(seen: Vertices, faces: ndarray, scene: Scene) -> UInt8[ndarray, "256 256"]:
    """Takes a picture from above.

    Args:
        seen: Where the cloth's points seem to be in a parallel projection [m].
        faces: Vertex indices, counter-clockwise seen from the camera.
        scene: Blur, cut, motion and noise of the picture.

    Returns:
        Grey levels, dark where the cloth is.
    """
    cover = render(torch.from_numpy(np.ascontiguousarray(seen)), faces, camera_of(LABORATORY)).numpy()
    cover = _smeared(cover, scene.smear)
    if scene.outwards is not None:
        cover = _cut(cover, scene.blur_of_cut, scene.outwards)
    shade = gaussian_filter(cover, scene.blur)
    noise = scene.random("capture", "noise").normal(0, scene.noise, shade.shape)
    return np.clip(np.round(255 * (1 - shade) + noise), 0, 255).astype(np.uint8)


def _smeared(cover: Float[ndarray, "256 256"], smear: tuple[float, float]) -> Float[ndarray, "256 256"]:
    length, direction = smear
    if length == 0:
        return cover
    east, north = unit_vector(direction)
    ways = np.linspace(-0.5, 0.5, _SMEARED) * length
    return np.mean([shift(cover, (-way * north, way * east), order=1) for way in ways], axis=0)


def _cut(cover: Float[ndarray, "256 256"], blur: float, outwards: float) -> Float[ndarray, "256 256"]:
    """A blurred picture, cut where a straight edge lies `outwards`; its edge is one pixel wide, as any cover's."""
    share = np.clip(gaussian_filter(cover, blur), _LEAST_SHARE, 1 - _LEAST_SHARE)
    return np.clip(0.5 + blur * ndtri(share) + outwards, 0, 1)


def jpeg(levels: UInt8[ndarray, "256 256"], quality: int) -> bytes:
    """Compresses a picture.

    Args:
        levels: Grey levels.
        quality: Quality of the file, 1 to 95.

    Returns:
        Content of a JPEG file.
    """
    packed = io.BytesIO()
    Image.fromarray(levels).save(packed, "JPEG", quality=quality)
    return packed.getvalue()


PIXEL = 1 / LABORATORY.px_per_m
"""Width of a pixel [m]."""
