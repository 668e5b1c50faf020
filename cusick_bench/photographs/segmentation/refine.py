"""The outline between pixels: along its normals, where linear light is halfway from the cloth's to the ground's."""

import cv2
import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.photographs.segmentation.polar import ANGLES, STEP, PolarPicture

_SPACING = 5e-4  # [m] between points of the outline
_ALONG = 1e-4  # [m] between places along a normal
_WINDOW = 1.8e-3  # [m] to either side in which the crossing is looked for
_NEAR, _FAR = 0.5e-3, 1.8e-3  # [m] between which a side's light is taken
_NOISE = 4e-3  # linear light
_SMOOTH = 1.0e-3  # [m] along the outline: standard deviation of the filter that turns a path into a curve
_SMOOTH_OFFSET = 0.7e-3  # [m] the same, of the crossings
_NEIGHBOURS = 2  # points to either side whose median decides what is out of line
_OUTLIER = 0.5e-3  # [m] off that median
_ROUNDS = 2

Curve = Float[ndarray, "points 2"]


def refined(picture: PolarPicture, path: Int[ndarray, " angles"]) -> tuple[Float[ndarray, " angles"], float, float]:
    """Moves a path to where the light is halfway between its sides.

    Args:
        picture: Evenly lit.
        path: Column at each angle.

    Returns:
        Radii [m]; the share of the outline at which no crossing was found; and the width of the edge [m].
    """
    curve = _smoothed(_resampled(_points(picture.radii[path])), _SMOOTH)
    missing, width = 1.0, 0.0
    for _ in range(_ROUNDS):
        curve = _resampled(curve)
        ahead = np.roll(curve, -2, axis=0) - np.roll(curve, 2, axis=0)
        normal = np.column_stack([ahead[:, 1], -ahead[:, 0]]) / np.linalg.norm(ahead, axis=1, keepdims=True)
        offset, found, width = _crossings(picture, curve, normal)
        around = np.median([np.roll(offset, step) for step in range(-_NEIGHBOURS, _NEIGHBOURS + 1)], axis=0)
        good = found & (np.abs(offset - around) < _OUTLIER)
        missing = float(1 - good.mean())
        offset = np.where(good, offset, around)
        curve = curve + normal * _smoothed(offset[:, None], _SMOOTH_OFFSET)
    return outermost(curve), missing, width


def _points(radii: ndarray) -> Curve:
    turn = np.arange(len(radii)) * 2 * np.pi / len(radii)
    return radii[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])


def _resampled(curve: Curve) -> Curve:
    """The closed curve with points in even distances, counter-clockwise."""
    closed = np.concatenate([curve, curve[:1]])
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    places = np.arange(round(length[-1] / _SPACING)) * length[-1] / round(length[-1] / _SPACING)
    return np.column_stack([np.interp(places, length, closed[:, axis]) for axis in (0, 1)])


def _smoothed(values: Float[ndarray, "points channels"], length: float) -> Float[ndarray, "points channels"]:
    pad = round(4 * length / _SPACING)
    padded = np.pad(values, ((pad, pad), (0, 0)), mode="wrap")
    return np.column_stack(
        [cv2.GaussianBlur(column.reshape(1, -1), (0, 0), length / _SPACING).ravel() for column in padded.T]
    )[pad : len(padded) - pad]


def _light_at(picture: PolarPicture, places: Float[ndarray, "points along 2"]) -> Float[ndarray, "points along 3"]:
    radius = np.hypot(places[..., 0], places[..., 1])
    turn = np.mod(np.arctan2(places[..., 1], places[..., 0]), 2 * np.pi) * ANGLES / (2 * np.pi)
    padded = np.concatenate([picture.light, picture.light[:1]])
    column = ((radius - picture.radii[0]) / STEP).astype(np.float32)
    light = cv2.remap(padded, column, turn.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return light.astype(np.float64)


def _crossings(picture: PolarPicture, curve: Curve, normal: Curve) -> tuple[ndarray, ndarray, float]:
    """Distance along each normal to the nearest crossing, whether there is one, and the width of the edge [m]."""
    along = np.arange(-_FAR, _FAR + _ALONG / 2, _ALONG)
    light = _light_at(picture, curve[:, None] + along[:, None] * normal[:, None])
    light = cv2.blur(np.pad(light, ((1, 1), (0, 0), (0, 0)), mode="wrap"), (1, 3))[1:-1]
    inner, outer = light[:, along < -_NEAR], light[:, along > _NEAR]
    change = inner.mean(axis=1) - outer.mean(axis=1)
    weights = change / (inner.var(axis=1) + outer.var(axis=1) + _NOISE**2)
    part = np.abs(along) <= _WINDOW
    line = ((light[:, part] - outer.mean(axis=1)[:, None]) * weights[:, None]).sum(axis=-1)
    line = line / np.maximum((change * weights).sum(axis=-1), 1e-12)[:, None] - 0.5
    falls = (line[:, :-1] >= 0) & (line[:, 1:] < 0)
    places = along[part][:-1] + _ALONG * line[:, :-1] / np.maximum(line[:, :-1] - line[:, 1:], 1e-12)
    distance = np.where(falls, np.abs(places), np.inf)
    best = distance.argmin(axis=1)
    found = falls.any(axis=1)
    steepest = -np.diff(cv2.blur(line, (5, 1)), axis=1).min(axis=1) / _ALONG
    width = float(np.median(1 / np.maximum(steepest, 10.0)))
    return np.where(found, places[np.arange(len(places)), best], 0.0), found, width


def outermost(curve: Curve) -> Float[ndarray, " angles"]:
    """Outermost radius of a closed curve at equidistant angles.

    Args:
        curve: Points in order [m].

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
