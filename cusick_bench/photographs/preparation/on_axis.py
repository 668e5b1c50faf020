"""The outline as an eye on the plate's axis would see it.

A real camera looks a little from the side, and sees what hangs below the plate shifted. How deep the rim hangs is not
seen: it is taken as that of straight generators from the plate's edge, as in `datasets/files/silhouette.py`. Of the
synthetic set's drapes that holds within 2 mm, but not in valleys that reach the plate's edge, which is at no depth.
"""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.photographs.calibration.view import PlateView
from cusick_bench.photographs.segmentation.refine import outermost

_ROUNDS = 20
_EDGE = (0.03, 0.06)  # shares of the overhang between which the outline goes over from the plate's edge to the rim
_DEPTH = 0.9  # of the overhang: depth of a valley's rim
_UNSURE, _SURE = ((0.1, 0.42), (0.2, 0.09)), 0.04
"""Standard deviation of the depth, in overhangs, where the outline lies less than so many overhangs outside the plate,
and elsewhere: of the synthetic set's drapes."""


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
    depth = np.zeros(len(radii))
    place = seen
    for _ in range(_ROUNDS):
        place = foot + (seen - foot) * ((height + depth) / height)[:, None]
        reach = np.clip(np.hypot(place[:, 0], place[:, 1]) - plate, 0, cloth - plate)
        hangs = np.clip((reach / (cloth - plate) - _EDGE[0]) / (_EDGE[1] - _EDGE[0]), 0, 1)
        depth = 0.5 * depth + 0.5 * hangs * np.sqrt((cloth - plate) ** 2 - reach**2)
    return outermost(place * (height / (height + depth))[:, None])


def left_off_axis(radii: Float[ndarray, " angles"], view: PlateView, plate: float, cloth: float) -> float:
    """Error that the camera's offset is expected to leave, since the rim's depth is only supposed.

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
    reach = (radii * (1 + _DEPTH * (cloth - plate) / view.eye[2]) - plate) / (cloth - plate)
    unsure = np.select([reach < limit for limit, _ in _UNSURE], [share for _, share in _UNSURE], _SURE)
    slant = float(np.hypot(*view.eye[:2]) / view.eye[2])
    return slant * (cloth - plate) * float(np.sqrt(np.mean(unsure**2)))
