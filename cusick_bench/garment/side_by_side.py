"""Skirts of several cloths side by side: at rest, at three moments of a motion, and the numbers below them."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from matplotlib.axes import Axes
from numpy import ndarray

from cusick_bench.garment.errors import GarmentError
from cusick_bench.garment.pictures import draw_skirt, reach
from cusick_bench.garment.wearing import Worn
from cusick_bench.report.figures.sheet import empty_sheet

MOMENTS = 3
_COLUMN, _ROW = 1.9, 1.5  # [inch] of a picture
_WORDS = 0.75  # [inch] of the lines below and above the first row
_EMPTY = 0.1  # share of a picture's height, above and below, that no skirt reaches


def compared(worn: Sequence[Worn]) -> list[dict[str, Any]]:
    """The numbers below the pictures, one row a cloth.

    Args:
        worn: Skirts of each cloth.

    Returns:
        For each its name, where its stiffness is from, and mean and standard deviation over draws of the number of
        folds, radius of the hem [m] and drape coefficient, with the root mean square of the vertices' standard
        deviation between draws [m].
    """
    rows: list[dict[str, Any]] = []
    for one in worn:
        spread = one.spread()
        row: dict[str, Any] = {
            "cloth": one.cloth.name,
            "stiffness_from": one.cloth.source,
            "draws": len(one.measures),
        }
        for name in ("folds", "hem_radius_m", "drape_coefficient"):
            row |= {name: spread["mean"][name], f"{name}_sd": spread["sd"][name]}
        rows.append(row | {"vertex_sd_m": spread["vertex_sd_rms_m"], "at_rest": bool(one.resting.all())})
    return rows


def save_side_by_side(worn: Sequence[Worn], path: Path, progress: Callable[[int], None] = lambda drawn: None) -> None:
    """Writes the picture: a column for each cloth, the skirt at rest above, in motion below.

    Args:
        worn: Skirts of each cloth; the first draw is shown.
        path: PNG file to write.
        progress: Told how many cloths are drawn.

    Raises:
        GarmentError: No cloths.
    """
    if not worn:
        raise GarmentError("there is no cloth to show; give a run with at least one fit of a simulated cloth")
    moving = all(len(one.times) for one in worn)
    rows = 1 + (MOMENTS if moving else 0)
    shown = [x for one in worn for x in (one.positions[:1], *([one.frames[:, 0]] if moving else []))]
    farthest = max(map(reach, shown))
    heights = {"height_ratios": [1.3, *[1.0] * (rows - 1)]}
    figure, axes = empty_sheet(_COLUMN * len(worn) + 0.3, _ROW * rows + _WORDS, rows, len(worn), gridspec_kw=heights)
    for column, (one, numbers) in enumerate(zip(worn, compared(worn), strict=True)):
        skirt, name, body = one.pattern, one.cloth.name, one.wearing.body
        _show(axes[0, column], draw_skirt(skirt, one.positions[0], name, body, farthest=farthest))
        axes[0, column].set_title(name, fontsize=9, parse_math=False)
        _words_below(axes[0, column], _described(numbers))
        for row, moment in enumerate(_moments(one) if moving else (), 1):
            pose = one.wearing.motion.pose(one.times[moment]) if one.wearing.motion else None
            picture = draw_skirt(skirt, one.frames[moment, 0], name, body, pose=pose, farthest=farthest)
            _show(axes[row, column], picture)
            _words_below(axes[row, column], f"{one.times[moment]:.2f} s")
        progress(column + 1)
    figure.savefig(path, facecolor="white")


def _moments(worn: Worn) -> list[int]:
    """Frames a quarter, a half and three quarters through the motion, the same moments for all cloths."""
    assert worn.wearing.motion is not None
    shares = np.arange(1, MOMENTS + 1) / (MOMENTS + 1)
    return [int(np.abs(worn.times - share * worn.wearing.motion.seconds).argmin()) for share in shares]


def mean_and_deviation(numbers: dict[str, Any], name: str, factor: float = 1, digits: int = 0) -> str:
    """A number of `compared` in words; a single draw has no standard deviation.

    Args:
        numbers: A row of `compared`.
        name: The number.
        factor: Factor to the unit that is shown.
        digits: Number of decimals.

    Returns:
        Such as "7.0 ± 1.4".
    """
    between = factor * numbers[f"{name}_sd"]
    deviation = f" ± {between:.{digits}f}" if np.isfinite(between) else ""
    return f"{factor * numbers[name]:.{digits}f}{deviation}"


def _described(numbers: dict[str, Any]) -> str:
    folds, hem = mean_and_deviation(numbers, "folds", 1, 1), mean_and_deviation(numbers, "hem_radius_m", 1e3)
    lines = [f"{folds} folds", f"hem {hem} mm"]
    between = 1e3 * numbers["vertex_sd_m"]
    return "\n".join(lines + ([f"draws differ by {between:.0f} mm"] if np.isfinite(between) else []))


def _words_below(axis: Axes, words: str) -> None:
    axis.text(0.5, -0.02, words, transform=axis.transAxes, ha="center", va="top", fontsize=7, color="0.3")


def _show(axis: Axes, picture: UInt8[ndarray, "height width 4"]) -> None:
    axis.imshow(_cropped(picture), interpolation="lanczos")


def _cropped(picture: UInt8[ndarray, "height width 4"]) -> UInt8[ndarray, "rows width 4"]:
    """Without most of the empty rows above and below, the same for all pictures of one size."""
    margin = int(_EMPTY * len(picture))
    return picture[margin : len(picture) - margin]
