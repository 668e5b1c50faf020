"""The outline as an eye on the plate's axis would see it.

A real camera looks a little from the side, so that whatever hangs below the plate appears shifted. The depth of the
outline is not visible. For most of the outline it is the depth of the rim of a cloth that hangs nearly straight from
the plate's edge, as in `datasets/files/silhouette.py`. But in the valleys of limp cloth the rim is hidden behind the
cloth's shoulder, where it bends down over the plate's edge, and the outline is that shoulder, not far below the plate.
A part of the outline counts as a shoulder where it comes close to the plate's edge; so do the flanks on both sides, up
to where the rim comes into sight and the outline turns outwards. Widths and depths are those of the synthetic set's
drapes.
"""

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.ndimage import gaussian_filter1d, label

from cusick_bench.photographs.calibration.view import PlateView
from cusick_bench.photographs.segmentation.curve import outermost

_ROUNDS = 20
_VALLEY, _FLANK = 0.04, 0.11
"""Shares of the overhang that a valley's outline lies at most outside the plate's edge if it is a shoulder, and up to
which the shoulder's flanks climb."""
_OUTWARDS = 0.7  # slope of an outline at which the rim comes forth
_SHOULDER, _FALL, _FROM = 0.07, 1.8, 0.03
"""Depth of a shoulder in overhangs, which grows by `_FALL` for every overhang that it lies further out than `_FROM`."""
_BULGE = 0.03  # by which a rim hangs less deep than the chord, in overhangs, where it hangs deepest
_NEAR, _BLUR = np.radians(0.75), np.radians(1.5)  # standard deviations of the filters of outline and shoulders
_UNSURE, _SURE = ((0.1, 0.22), (0.2, 0.10), (0.3, 0.05)), 0.02
"""Standard deviation of the depth of a rim, in overhangs, where the outline lies less than so many overhangs outside
the plate, and elsewhere."""
_UNSURE_SHOULDER, _UNSURE_CHANGE = 0.18, 0.30  # the same of a shoulder, and of where it goes over to the rim


def seen_on_axis(radii: Float[ndarray, " angles"], view: PlateView, plate: float, cloth: float) -> ndarray:
    """Takes the camera's offset from the axis out of an outline; its height stays.

    Args:
        radii: Radii in the plate's plane as the camera sees them, at equidistant angles [m].
        view: The calibrated camera; left as it is where the height is not known.
        plate: Radius of the plate [m].
        cloth: Radius of the flat cloth [m].

    Returns:
        Radii as an eye of that height on the axis sees them [m].
    """
    if not view.knows_height:
        return radii
    turn = np.arange(len(radii)) * 2 * np.pi / len(radii)
    seen = radii[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    foot, height = view.eye[:2], view.eye[2]
    shoulder = _shoulder(radii, plate, cloth)
    depth = np.zeros(len(radii))
    place = seen
    for _ in range(_ROUNDS):
        place = foot + (seen - foot) * ((height + depth) / height)[:, None]
        depth = 0.5 * depth + 0.5 * _depth(np.hypot(place[:, 0], place[:, 1]), shoulder, plate, cloth)
    return outermost(place * (height / (height + depth))[:, None])


def left_off_axis(radii: Float[ndarray, " angles"], view: PlateView, plate: float, cloth: float) -> float:
    """Error that the camera's offset is expected to leave, since the outline's depth is only supposed.

    Args:
        radii: Radii in the plate's plane as the camera sees them [m].
        view: The calibrated camera.
        plate: Radius of the plate [m].
        cloth: Radius of the flat cloth [m].

    Returns:
        Root-mean-square error of the radii [m]; 0 where the camera's height is not known, and nothing is corrected.
    """
    if not view.knows_height:
        return 0.0
    reach, shoulder = (radii - plate) / (cloth - plate), _shoulder(radii, plate, cloth)
    rim = np.select([reach < limit for limit, _ in _UNSURE], [share for _, share in _UNSURE], _SURE)
    changes = 4 * shoulder * (1 - shoulder)  # 1 halfway from shoulder to rim
    unsure = np.maximum(np.where(shoulder > 0.5, _UNSURE_SHOULDER, rim), changes * _UNSURE_CHANGE)
    slant = float(np.hypot(*view.eye[:2]) / view.eye[2])
    return slant * (cloth - plate) * float(np.sqrt(np.mean(unsure**2)))


def left_by_calibration(radii: Float[ndarray, " angles"], view: PlateView, plate: float, cloth: float) -> float:
    """Error of an outline that the calibration's stated uncertainty makes one expect.

    A tilt that is not known shifts what hangs below the plate against the plate, by its depth times the tilt.

    Args:
        radii: Radii in the plate's plane as the camera sees them [m].
        view: The calibrated camera, with its uncertainty.
        plate: Radius of the plate [m].
        cloth: Radius of the flat cloth [m].

    Returns:
        Root-mean-square error of the radii by scale, centre and tilt [m].
    """
    spread = view.uncertainty
    depth = _depth(radii, _shoulder(radii, plate, cloth), plate, cloth)
    by_scale = spread.scale * radii
    aside = np.hypot(spread.centre_m, spread.tilt_rad * depth)  # along x and along y; half of the square is radial
    return float(np.sqrt(np.mean(by_scale**2 + aside**2)))


def _shoulder(radii: Float[ndarray, " angles"], plate: float, cloth: float) -> Float[ndarray, " angles"]:
    """1 where the outline is the cloth's shoulder, 0 where it is its rim, and between them going over."""
    count = len(radii)
    step = 2 * np.pi / count
    smooth = gaussian_filter1d(radii, _NEAR / step, mode="wrap")
    slope = np.abs(np.roll(smooth, -1) - np.roll(smooth, 1)) / (2 * step * smooth)
    reach = (radii - plate) / (cloth - plate)
    valley = reach < _VALLEY
    parts = np.zeros(3 * count, int)
    label(np.tile(valley | ((reach < _FLANK) & (slope < _OUTWARDS)), 3), output=parts)
    held = np.isin(parts, parts[np.tile(valley, 3)])[count : 2 * count]
    return gaussian_filter1d(held.astype(float), _BLUR / step, mode="wrap")


def _depth(
    radii: Float[ndarray, " angles"], shoulder: Float[ndarray, " angles"], plate: float, cloth: float
) -> Float[ndarray, " angles"]:
    """Depth of the outline by its true radii [m]."""
    reach = np.clip((radii - plate) / (cloth - plate), 0, 1)
    chord = np.sqrt(1 - reach**2)
    rim = (1 - _BULGE) * chord
    low = np.minimum(_SHOULDER + _FALL * np.maximum(reach - _FROM, 0), rim)
    return (cloth - plate) * (shoulder * low + (1 - shoulder) * rim)
