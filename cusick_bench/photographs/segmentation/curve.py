"""Closed curves around the plate's axis as equidistant points, and their normals."""

import cv2
import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.photographs.segmentation.polar import ANGLES

_SPACING = 5e-4  # [m] between points

Curve = Float[ndarray, "points 2"]


def curve_of(radii: Float[ndarray, " angles"]) -> Curve:
    """Turns radii into a curve.

    Args:
        radii: Radii at equidistant angles [m].

    Returns:
        Points in even distances [m], counter-clockwise.
    """
    turn = np.arange(len(radii)) * 2 * np.pi / len(radii)
    return resampled(radii[:, None] * np.column_stack([np.cos(turn), np.sin(turn)]))


def resampled(curve: Curve) -> Float[ndarray, "even 2"]:
    """Spreads a curve's points evenly.

    Args:
        curve: Points of the outline in order [m].

    Returns:
        Points of the same closed curve, half a millimetre apart [m].
    """
    closed = np.concatenate([curve, curve[:1]])
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    places = np.arange(round(length[-1] / _SPACING)) * length[-1] / round(length[-1] / _SPACING)
    return np.column_stack([np.interp(places, length, closed[:, axis]) for axis in (0, 1)])


def smoothed(values: Float[ndarray, "points channels"], length: float) -> Float[ndarray, "points channels"]:
    """Smooths values of a closed curve's points.

    Args:
        values: Values at points in even distances.
        length: Standard deviation of the filter along the curve [m].

    Returns:
        Smoothed values.
    """
    pad = round(4 * length / _SPACING)
    padded = np.pad(values, ((pad, pad), (0, 0)), mode="wrap")
    return np.column_stack(
        [cv2.GaussianBlur(column.reshape(1, -1), (0, 0), length / _SPACING).ravel() for column in padded.T]
    )[pad : len(padded) - pad]


def normals(curve: Curve) -> Curve:
    """Directions across a curve.

    Args:
        curve: Points in even distances, counter-clockwise [m].

    Returns:
        Unit vectors that point outwards.
    """
    ahead = np.roll(curve, -2, axis=0) - np.roll(curve, 2, axis=0)
    return np.column_stack([ahead[:, 1], -ahead[:, 0]]) / np.linalg.norm(ahead, axis=1, keepdims=True)


def outermost(curve: Curve) -> Float[ndarray, " angles"]:
    """Outermost radius of a closed curve at equidistant angles.

    Args:
        curve: Points of the outline in order [m].

    Returns:
        Radii [m].
    """
    turn = np.unwrap(np.arctan2(curve[:, 1], curve[:, 0])) * ANGLES / (2 * np.pi)
    radius = np.hypot(curve[:, 0], curve[:, 1])
    radii = np.zeros(ANGLES)
    following, other = np.roll(turn, -1), np.roll(radius, -1)
    following[-1] += ANGLES * np.sign(turn[-1] - turn[0])
    for start, end, first, last in zip(turn, following, radius, other, strict=True):
        low, high = min(start, end), max(start, end)
        for angle in range(int(np.ceil(low)), int(np.floor(high)) + 1):
            share = (angle - start) / (end - start) if end != start else 0.0
            radii[angle % ANGLES] = max(radii[angle % ANGLES], first + share * (last - first))
    return np.where(radii > 0, radii, np.median(radius))
