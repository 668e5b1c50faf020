"""The outline moved along its normals to where colours change sharply, at the photograph's own resolution.

The polar grid is coarse across steep flanks of folds, and its wide edge filter may take a stripe or a dot near the rim
for the rim. Here the two sides of an edge are a millimetre wide, and the cheapest closed path of offsets is used.
"""

import cv2
import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.photographs.segmentation.colour import Neighbours, colour_features
from cusick_bench.photographs.segmentation.curve import Curve, normals, resampled, smoothed
from cusick_bench.photographs.segmentation.path import closed_path
from cusick_bench.photographs.segmentation.plane import PlanePicture

_ALONG = 1.25e-4  # [m] between places along a normal
_REACH = 3.5e-3  # [m] to either side in which the outline is looked for
_SIDE, _GAP = 1.0e-3, 2.5e-4  # [m] of either side of an edge that is looked at, and half of the blur between them
_FLOOR = 1.2  # variation of features that noise makes
_REGION, _EDGE = 1.0, 1.0  # weights of a millimetre of wrongly coloured places, and of an edge's strength
_STIFFNESS = 0.3
_BEFORE, _AFTER = 1.5e-3, 0.7e-3  # [m] standard deviations of the filters of the curve before and after


def snapped(
    picture: PlanePicture, known: Neighbours, curve: Curve
) -> tuple[Float[ndarray, "moved 2"], Float[ndarray, " measured"]]:
    """Moves a curve to the edges beside it.

    Args:
        picture: Evenly lit.
        known: Known places of cloth and ground.
        curve: Points in even distances, counter-clockwise [m].

    Returns:
        The moved curve [m]; and the strength of the edge at each point that was moved, in standard deviations.
    """
    start = resampled(smoothed(curve, _BEFORE))
    across = normals(start)
    margin = round((_SIDE + _GAP) / _ALONG)
    half = round(_REACH / _ALONG) + margin
    along = np.arange(-half, half + 1) * _ALONG
    light, _ = picture.light_at(start[:, None] + along[:, None] * across[:, None])
    features = colour_features(light)
    features = cv2.blur(np.pad(features, ((1, 1), (0, 0), (0, 0)), mode="wrap"), (1, 3))[1:-1]
    gain = np.cumsum(known.judged(features)[0], axis=1) * _ALONG * 1e3  # [mm] of places that are rightly inside
    strength = _strength(features)
    part = slice(margin, -margin)
    path = closed_path((-2 * _REGION * gain - _EDGE * strength)[:, part], _STIFFNESS) + margin
    moved = start + across * along[path][:, None]
    return resampled(smoothed(moved, _AFTER)), strength[np.arange(len(path)), path]


def _strength(features: Float[ndarray, "points along 3"]) -> Float[ndarray, "points along"]:
    """Difference of the means of two sides, in standard deviations, at most 6."""
    width = round(_SIDE / _ALONG) | 1
    move = width // 2 + round(_GAP / _ALONG)
    mean = cv2.blur(features, (width, 1))
    variance = np.clip(cv2.blur(features**2, (width, 1)) - mean**2, 0, None)
    inner, outer = np.roll(mean, move, axis=1), np.roll(mean, -move, axis=1)
    spread = np.roll(variance, move, axis=1) + np.roll(variance, -move, axis=1) + 2 * _FLOOR**2
    return np.minimum(np.sqrt(((inner - outer) ** 2 / spread).sum(axis=-1)), 6.0)
