"""Pictures of skirts: from the side in three dimensions, all the way round, and in motion.

The scene is that of a drape (`cusick_bench.report.drawing.drape_view`): a skirt is drawn scaled down to its size, with
the body instead of the pedestal. One that is wide for its length, or sways far, is scaled down further.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy import ndarray
from PIL import Image

from cusick_bench.garment.body import Body
from cusick_bench.garment.skirt import Skirt
from cusick_bench.report.drawing.drape_view import View, cloth_colour, render_drape

_DROP = 0.088  # [m] length of the skirt in the scene; the ground lies a little deeper
_GROUND = 0.095  # [m] below the waist in the scene
_WIDEST = 0.105  # [m] from the axis in the scene; what is farther away may lie outside of the picture
_THINNER = 0.93  # of the body's radius, or it would show through the cloth between its vertices
_SIDES = 72
SIDE = View(azimuth=-68.0, elevation=14.0, distance=0.80, width=320, height=256, fov=12.5, target=-0.051)


def reach(positions: Float[ndarray, "*skirts vertices 3"]) -> float:
    """How far the vertices of any of several skirts are from the axis.

    Args:
        positions: Positions of the vertices [m].

    Returns:
        The largest distance [m].
    """
    return float(np.hypot(positions[..., 0], positions[..., 1]).max())


def draw_skirt(
    skirt: Skirt,
    positions: Float[ndarray, "vertices 3"],
    name: str,
    body: Body | None = None,
    view: View = SIDE,
    pose: tuple[Float[ndarray, "3 3"], Float[ndarray, "3"]] | None = None,
    farthest: float | None = None,
) -> UInt8[ndarray, "height width 4"]:
    """Draws a skirt in three dimensions.

    Args:
        skirt: Its pattern.
        positions: Positions of its vertices [m].
        name: Name of the cloth; a colour in it is used.
        body: What it is worn on; without one only the waist's disc is drawn.
        view: Point of view.
        pose: Rotation and shift of the waist [m].
        farthest: `reach` of all skirts that are drawn to one scale [m]; by default of this one.

    Returns:
        The picture, with an opacity channel.
    """
    widest = max(reach(positions) if farthest is None else farthest, 0.0 if body is None else body.hip)
    scale = min(_DROP / skirt.size.length, _WIDEST / widest)
    rotation, shift = pose or (np.eye(3), np.zeros(3))
    points, faces = _stand(body, skirt.size.waist, _GROUND / scale)
    return render_drape(
        scale * positions, skirt.mesh.faces, cloth_colour(name), view, (scale * (points @ rotation.T + shift), faces)
    )


def _stand(
    body: Body | None, waist: float, ground: float
) -> tuple[Float[ndarray, "points 3"], Int[ndarray, "triangles 3"]]:
    """The body down to the ground, closed at the waist; without a body its waist only [m]."""
    heights = np.linspace(0, -ground if body is not None else -0.02 * ground, 24)
    radii = _THINNER * (body.radius(heights) if body is not None else np.full(len(heights), waist))
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    rings = [np.column_stack([r * np.cos(angle), r * np.sin(angle), np.full(_SIDES, z - 0.001)])
             for r, z in zip(radii, heights, strict=True)]  # fmt: skip
    points = np.concatenate([*rings, [[0.0, 0.0, -0.001]]])
    here, following = np.arange(_SIDES), (np.arange(_SIDES) + 1) % _SIDES
    top = np.column_stack([np.full(_SIDES, len(points) - 1), here, following])
    walls = [_SIDES * ring + wall for ring in range(len(heights) - 1) for wall in (
        np.column_stack([here, here + _SIDES, following]),
        np.column_stack([following, here + _SIDES, following + _SIDES]),
    )]  # fmt: skip
    return points, np.concatenate([top, *walls])


def turntable(
    skirt: Skirt, positions: Float[ndarray, "vertices 3"], name: str, body: Body | None, pictures: int
) -> list[UInt8[ndarray, "height width 4"]]:
    """Draws a skirt from all sides.

    Args:
        skirt: Its pattern.
        positions: Positions of its vertices [m].
        name: Name of the cloth; a colour in it is used.
        body: What it is worn on, or None.
        pictures: Number of pictures.

    Returns:
        The pictures.
    """
    azimuths = SIDE.azimuth + np.arange(pictures) * (360 / pictures)
    return [draw_skirt(skirt, positions, name, body, replace(SIDE, azimuth=float(angle))) for angle in azimuths]


def strip(pictures: Sequence[UInt8[ndarray, "height width 4"]], columns: int) -> UInt8[ndarray, "rows columns 4"]:
    """Puts pictures side by side, in rows.

    Args:
        pictures: Pictures of one size.
        columns: Number of pictures in a row.

    Returns:
        One picture.
    """
    blank = [np.zeros_like(pictures[0])] * (-len(pictures) % columns)
    filled = [*pictures, *blank]
    rows = [np.concatenate(filled[at : at + columns], axis=1) for at in range(0, len(filled), columns)]
    return np.concatenate(rows)


def save_gif(path: Path, pictures: Sequence[UInt8[ndarray, "height width 4"]], seconds: float) -> None:
    """Writes an endless animation, white behind.

    Args:
        path: File to write.
        pictures: Its frames.
        seconds: Time for which each frame is shown [s].
    """
    frames = []
    for picture in pictures:
        image = Image.fromarray(picture, "RGBA")
        frames.append(Image.alpha_composite(Image.new("RGBA", image.size, "white"), image).convert("RGB"))
    shades = [frame.quantize(128) for frame in frames]
    shades[0].save(path, save_all=True, append_images=shades[1:], duration=round(1000 * seconds), loop=0)
