"""Shadows on the ground: how much of the lamp and of the surroundings each place sees."""

import cv2
import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.photographs.studio.pattern import GROUND_SIDE, Surface
from cusick_bench.photographs.studio.raster import rasterise
from cusick_bench.photographs.studio.scene import Light, Piece

_CELLS = 400  # of the shadow's map along each side
_RAYS = 16  # places of the lamp
_HIDDEN = 0.45  # share of the surroundings that a thing right above hides


def _projected(piece: Piece, source: ndarray, depth: float) -> Float[ndarray, "vertices 2"]:
    """Places of the vertices' shadows, in pixels of the map."""
    way = piece.vertices - source
    reach = (-depth - source[2]) / way[:, 2:]
    places = source[:2] + reach * way[:, :2]
    return (places / GROUND_SIDE + 0.5) * _CELLS - 0.5


def _drawn(piece: Piece, places: ndarray) -> Float[ndarray, "cells cells"]:
    return (rasterise(places, np.zeros(len(places)), piece.faces, (_CELLS, _CELLS))[0] >= 0).astype(np.float32)


def light_on_ground(piece: Piece, light: Light, depth: float) -> Surface:
    """Light that reaches the ground below a piece, 1 where nothing is in the way.

    Args:
        piece: What throws the shadow.
        light: The light.
        depth: Depth of the ground below the plate [m].

    Returns:
        Light on a map of the ground.
    """
    turns = np.arange(_RAYS) * np.pi * (3 - np.sqrt(5))  # a sunflower's: even over the lamp's disc
    distances = light.lamp_radius * np.sqrt((np.arange(_RAYS) + 0.5) / _RAYS)
    seen = np.zeros((_CELLS, _CELLS), np.float32)
    for turn, distance in zip(turns, distances, strict=True):
        source = light.lamp + distance * np.array([np.cos(turn), np.sin(turn), 0.0])
        seen += 1 - _drawn(piece, _projected(piece, source, depth))
    above = _drawn(piece, _projected(piece, np.array([0.0, 0.0, 50.0]), depth))
    hidden = cv2.GaussianBlur(above, (0, 0), 0.6 * depth / GROUND_SIDE * _CELLS)
    shade = light.ambient * (1 - _HIDDEN * hidden) + (1 - light.ambient) * cv2.GaussianBlur(seen / _RAYS, (0, 0), 1.5)
    return Surface(GROUND_SIDE, shade.astype(np.float32))
