"""Strength of an edge: difference between the means of its two sides, over the variation within them.

A soft shadow, and a pattern that continues on both sides, also vary within the sides, and have a low strength.
"""

import cv2
import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.photographs.segmentation.colour import colour_features
from cusick_bench.photographs.segmentation.polar import STEP, PolarPicture

SIDE = 2e-3  # [m] width of either side
_GAP = 2.5e-4  # [m] gap between them, for the blur of the edge
_FLOOR = 1.2  # variation of features due to noise


def edge_strength(picture: PolarPicture) -> Float[ndarray, "angles radii"]:
    """Strength of an edge across the radius at every place, in standard deviations, at most 6.

    Args:
        picture: Evenly lit.

    Returns:
        Strengths.
    """
    features = colour_features(picture.light).astype(np.float32)
    padded = np.pad(features, ((4, 4), (0, 0), (0, 0)), mode="wrap")
    width, gap = round(SIDE / STEP), round(_GAP / STEP)
    mean = cv2.blur(padded, (width, 3), borderType=cv2.BORDER_REPLICATE)
    square = cv2.blur(padded**2, (width, 3), borderType=cv2.BORDER_REPLICATE)
    variance = np.clip(square - mean**2, 0, None)
    move = width // 2 + gap
    inner, outer = np.roll(mean, move, axis=1), np.roll(mean, -move, axis=1)
    spread = np.roll(variance, move, axis=1) + np.roll(variance, -move, axis=1) + 2 * _FLOOR**2
    score = ((inner - outer) ** 2 / spread).sum(axis=-1)[4:-4]
    score[:, :move], score[:, -move:] = 0, 0
    return np.minimum(np.sqrt(score), 6.0)
