"""The printed board: a ChArUco chessboard of known size, whose middle belongs on the plate's axis.

One board fits A4 and Letter. It is as wide as the standard's plate, so that a disc cut along the printed circle lies on
the plate edge to edge.
"""

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

COLUMNS, ROWS = 9, 11  # squares
SQUARE = 0.020  # [m]
MARKER = 0.015  # [m]
WIDTH, HEIGHT = COLUMNS * SQUARE, ROWS * SQUARE  # [m]
LEAST_DISC = 0.1  # [m] least diameter of a disc cut out of it whose corners (12) are enough for a calibration
MOST_DISC = 0.2  # [m] largest diameter that fits the sheets of paper
_DICTIONARY = cv2.aruco.DICT_4X4_50


def charuco_board(printed: float = 1.0) -> cv2.aruco.CharucoBoard:
    """The board as OpenCV knows it; lengths in metres.

    Args:
        printed: Size on paper over the nominal size, from the check ruler.

    Returns:
        The board.
    """
    dictionary = cv2.aruco.getPredefinedDictionary(_DICTIONARY)
    return cv2.aruco.CharucoBoard((COLUMNS, ROWS), SQUARE * printed, MARKER * printed, dictionary)


def board_cells(per_square: int = 24) -> UInt8[ndarray, "height width"]:
    """The board as an image without margin, dark 0 and light 255.

    Args:
        per_square: Pixels of a square; multiples of 8 draw every cell of a marker (6 of them on 3/4 of a square)
            exactly.

    Returns:
        Image, first row at the far edge.
    """
    return charuco_board().generateImage((COLUMNS * per_square, ROWS * per_square), None, 0, 1)


def in_plate_axes(corners: Float[ndarray, "corners 3"], printed: float = 1.0) -> Float[ndarray, "corners 3"]:
    """Places of chessboard corners about the board's middle, x right and y up as one reads the sheet.

    Args:
        corners: Places by OpenCV's board, whose origin is the upper left corner and whose y points down the sheet [m].
        printed: Size on paper over the nominal size.

    Returns:
        Places [m], z = 0.
    """
    x = corners[:, 0] - 0.5 * WIDTH * printed
    y = 0.5 * HEIGHT * printed - corners[:, 1]
    return np.column_stack([x, y, np.zeros(len(corners))])
