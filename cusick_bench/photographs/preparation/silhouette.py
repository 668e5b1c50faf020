"""Draws an outline as a silhouette image, and over its photograph as a picture for a check by eye."""

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.photographs.calibration.view import PlateView
from cusick_bench.photographs.reading import Photograph

_FINE = 8  # oversampling along each side of a pixel
_SHIFT = 4  # fractional bits of OpenCV's coordinates
_WIDEST = 1600  # [px] of a picture to check
_GOOD, _DOUBTFUL, _PLATE = (60, 255, 60), (60, 60, 255), (255, 220, 0)  # blue, green, red


def silhouette(radii: Float[ndarray, " angles"], protocol: Protocol) -> UInt8[ndarray, "size size"]:
    """Draws a silhouette: cloth dark on white, y up.

    Args:
        radii: Radii at equidistant angles, counter-clockwise from the right [m].
        protocol: Gives size, scale and centre.

    Returns:
        Grey levels.
    """
    turn = np.arange(len(radii)) * 2 * np.pi / len(radii)
    column = protocol.centre_px[0] + protocol.px_per_m * radii * np.cos(turn)
    row = protocol.centre_px[1] - protocol.px_per_m * radii * np.sin(turn)
    fine = (np.stack([column, row], axis=-1) + 0.5) * _FINE - 0.5
    size = protocol.image_size_px
    drawn = np.full((size * _FINE, size * _FINE), 255, np.uint8)
    cv2.fillPoly(drawn, [np.round(fine * 2**_SHIFT).astype(np.int32)], 0, shift=_SHIFT)
    return cv2.resize(drawn, (size, size), interpolation=cv2.INTER_AREA)


def overlay(
    photograph: Photograph, view: PlateView, radii: Float[ndarray, " angles"], plate: float, text: str, good: bool
) -> UInt8[ndarray, "height width 3"]:
    """Draws an outline and the plate over a photograph.

    Args:
        photograph: The picture.
        view: The calibrated camera.
        radii: Outline as the camera sees it [m].
        plate: Radius of the plate [m].
        text: What to write above.
        good: Whether the outline is accepted: green, else red.

    Returns:
        Levels, blue first.
    """
    width, height = photograph.size
    factor = min(1.0, _WIDEST / max(width, height))
    drawn = cv2.resize(photograph.levels, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    turn = np.arange(len(radii)) * 2 * np.pi / len(radii)
    colour = _GOOD if good else _DOUBTFUL
    for reach, ink in ((radii, colour), (np.full(len(radii), plate), _PLATE)):
        places = np.column_stack([reach * np.cos(turn), reach * np.sin(turn), np.zeros(len(turn))])
        pixels = (view.project(places) + 0.5) * factor - 0.5
        line = np.round(np.clip(pixels, -1e5, 1e5) * 2**_SHIFT).astype(np.int32)
        cv2.polylines(drawn, [line], True, ink, 1, cv2.LINE_AA, _SHIFT)
    cv2.rectangle(drawn, (0, 0), (drawn.shape[1], 34), (0, 0, 0), -1)
    cv2.putText(drawn, text, (8, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 1, cv2.LINE_AA)
    return drawn
