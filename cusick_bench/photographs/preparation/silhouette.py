"""Draws an outline as a silhouette image, and over its photograph as a picture for a check by eye."""

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray

from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.files.silhouette import camera_of
from cusick_bench.photographs.calibration.view import PlateView
from cusick_bench.photographs.reading import Photograph
from cusick_bench.sim.render.silhouette import render

_SHIFT = 4  # fractional bits of OpenCV's coordinates
_WIDEST = 1600  # [px] of a picture to check
_GOOD, _DOUBTFUL, _PLATE = (60, 255, 60), (60, 60, 255), (255, 220, 0)  # blue, green, red


def silhouette(radii: Float[ndarray, " angles"], protocol: Protocol) -> UInt8[ndarray, "size size"]:
    """Draws a silhouette: cloth dark on white, y up, every pixel by the area of it that the cloth covers.

    Args:
        radii: Radii at equidistant angles, counter-clockwise from the right [m].
        protocol: Gives size, scale and centre.

    Returns:
        Grey levels.
    """
    number = np.arange(len(radii))
    turn = number * 2 * np.pi / len(radii)
    rim = np.column_stack([radii * np.cos(turn), radii * np.sin(turn), np.zeros(len(radii))])
    faces = np.column_stack([np.full(len(radii), len(radii)), number, (number + 1) % len(radii)])  # around the axis
    points = torch.from_numpy(np.vstack([rim, np.zeros(3)]))
    covered = render(points, faces, camera_of(protocol), size=protocol.image_size_px)
    return np.round(255 * (1 - covered.numpy())).astype(np.uint8)


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
