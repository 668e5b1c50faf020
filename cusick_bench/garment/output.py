"""The files of a fitting: meshes, silhouettes, pictures, frames of the motion.

DIR/draw_0000.obj                   skirt at rest [m]
DIR/draw_0000_{above,front}.png     its silhouettes
DIR/draw_0000.png                   from the side, of the first 12 draws
DIR/turntable.gif, turntable.png    the first draw all the way round
DIR/spread.png                      the first 12 draws, from the side
DIR/motion.npz                      times [s] and positions [m] of the frames, all draws
DIR/motion.gif, motion.png          the first draw in motion
DIR/summary.json                    the numbers
"""

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from PIL import Image

from cusick_bench.garment.body import Body
from cusick_bench.garment.measurement import seen_from_above, seen_from_front
from cusick_bench.garment.motion import WaistMotion
from cusick_bench.garment.pictures import draw_skirt, reach, save_gif, strip, turntable
from cusick_bench.garment.skirt import Skirt
from cusick_bench.sim.cloth.obj import write_obj

_IN_ROW = 6
_MOST_SHOWN = 12  # draws in one picture
_COMPARISON = ("garments.json", "side_by_side.png", "garments.html")
_WRITTEN = re.compile(
    r"draw_\d{4,}(_above|_front)?\.(obj|png)|spread\.png|(turntable|motion)\.(gif|png)|motion\.npz|summary\.json"
)


def _save(path: Path, picture: ndarray) -> None:
    Image.fromarray(picture, "RGBA").save(path, "PNG", optimize=True)


def _save_silhouette(path: Path, image: Float[ndarray, "size size"]) -> None:
    """Dark cloth on white, as the release has it."""
    Image.fromarray(np.round(255 * (1 - image)).astype(np.uint8)).save(path)


def forget_skirts(folder: Path) -> None:
    """Removes the files of an earlier fitting, which may have had more draws or a motion.

    Args:
        folder: Where it was written; other files in it stay.
    """
    for path in folder.iterdir():
        if _WRITTEN.fullmatch(path.name):
            path.unlink()


def forget_comparison(folder: Path) -> None:
    """Removes the files of an earlier comparison of cloths, so that none stays beside those of a new one.

    Args:
        folder: Where it was written; other files in it stay.
    """
    for name in _COMPARISON:
        (folder / name).unlink(missing_ok=True)


def write_rest(
    folder: Path, skirt: Skirt, positions: Float[ndarray, "draws vertices 3"], name: str, body: Body | None, *,
    pictures: int = 18,
) -> None:  # fmt: skip
    """Writes meshes, silhouettes and pictures of skirts at rest.

    Args:
        folder: Where to write.
        skirt: The pattern.
        positions: Positions of the vertices in each draw [m].
        name: Name of the cloth; a colour in it is used.
        body: What the skirts are worn on, or None.
        pictures: Number of pictures all the way round, at least 1.
    """
    shown, farthest = [], reach(positions[:_MOST_SHOWN])
    for number, x in enumerate(positions):
        stem = f"draw_{number:04d}"
        write_obj(folder / f"{stem}.obj", x, skirt.mesh.faces)
        _save_silhouette(folder / f"{stem}_above.png", seen_from_above(skirt, x))
        _save_silhouette(folder / f"{stem}_front.png", seen_from_front(skirt, x))
        if number < _MOST_SHOWN:
            shown.append(draw_skirt(skirt, x, name, body, farthest=farthest))
            _save(folder / f"{stem}.png", shown[-1])
    _save(folder / "spread.png", strip(shown, min(len(shown), _IN_ROW)))
    round_about = turntable(skirt, positions[0], name, body, pictures)
    save_gif(folder / "turntable.gif", round_about, 0.1)
    in_row = min(pictures, _IN_ROW)
    _save(folder / "turntable.png", strip(round_about[:: pictures // in_row], in_row))


def write_motion(
    folder: Path, skirt: Skirt, times: Float[ndarray, "frames"], frames: Float[ndarray, "frames draws vertices 3"],
    motion: WaistMotion, name: str, body: Body | None, *, most_pictures: int = 36,
) -> None:  # fmt: skip
    """Writes the frames of all draws, and pictures of the first in motion.

    Args:
        folder: Where to write.
        skirt: The pattern.
        times: Times of the frames [s].
        frames: Positions of the vertices in each frame and draw [m].
        motion: Motion of the waist.
        name: Name of the cloth; a colour in it is used.
        body: What the skirts are worn on, or None.
        most_pictures: Most pictures of the animation; of more frames some are left out.
    """
    np.savez_compressed(folder / "motion.npz", times=times, positions=frames.astype(np.float32), faces=skirt.mesh.faces)
    every = max(1, -(-len(times) // most_pictures))
    farthest = reach(frames[:, 0])
    pictures = [
        draw_skirt(skirt, x[0], name, body, pose=motion.pose(time), farthest=farthest)
        for time, x in zip(times[::every], frames[::every], strict=True)
    ]
    save_gif(folder / "motion.gif", pictures, float(times[every] - times[0]))
    shown = np.linspace(0, len(pictures) - 1, 2 * _IN_ROW).round().astype(int)
    _save(folder / "motion.png", strip([pictures[i] for i in shown], _IN_ROW))
