"""Calibration from pictures of the printed board, by Zhang's method as OpenCV has it.

One picture shows the board on the plate and gives the plane. Two and more of the board held at other angles give the
lens and, with it, the camera's height.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.photographs.board import charuco_board, in_plate_axes
from cusick_bench.photographs.calibration.view import HEADER_FOCAL, MEASURED_HEIGHT, PlateView, Uncertainty
from cusick_bench.photographs.errors import BadPhotograph
from cusick_bench.photographs.reading import Photograph

_LEAST_CORNERS = 12
LEAST_PICTURES = 3
"""Least number of pictures for lens and height: one on the plate, two held at angles."""
_LEAST_LEAN = np.radians(6.0)  # least angle of a board, below which focal length and height cannot be separated
_WORST_FIT = 2.0  # [px] largest error of corners, per 1000 px of width
_RULER = 5e-4  # relative uncertainty of the printed size after a check with the printed ruler
_AXIS_OFF = 0.003
"""Error of the tilt by a picture of one board, times focal length over the picture's longer side. The optical axis is
taken to be in the picture's middle; in six published calibrations of phones and a reflex camera it is off by some .004
of the longer side, along either, of which .9 (level camera) to .6 (tilted by 4 degrees) is taken for a tilt."""
_PLACED = 3e-4  # [m] uncertainty of the position of a board that is cut along its circle


@dataclass(frozen=True, eq=False)
class SeenBoard:
    """The board's corners in a picture.

    Attributes:
        places: Places of the corners on the board, about its middle, z = 0 [m].
        pixels: Places of the corners in the picture [px].
    """

    places: Float[ndarray, "corners 3"]
    pixels: Float[ndarray, "corners 2"]


def find_board(photograph: Photograph, name: str, printed: float = 1.0) -> SeenBoard:
    """Finds the board in a picture.

    Args:
        photograph: The picture.
        name: Its file, for the message.
        printed: Size on paper over the nominal size.

    Returns:
        Corners of the board that are seen.

    Raises:
        BadPhotograph: Fewer than 12 corners are seen.
    """
    board = charuco_board(printed)
    grey = cv2.cvtColor(photograph.levels, cv2.COLOR_BGR2GRAY)
    found, numbers, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
    seen = 0 if numbers is None else len(numbers)
    if seen < _LEAST_CORNERS:
        raise BadPhotograph(
            f"shows {seen} corners of the board, at least {_LEAST_CORNERS} are needed",
            where=name,
            remedy="print it with `cusick-bench data board`, take the picture closer, sharper and without glare",
            kind="no-board",
        )
    places = in_plate_axes(np.asarray(board.getChessboardCorners())[np.asarray(numbers, int).ravel()], printed)
    return SeenBoard(places, found.reshape(-1, 2))


def view_from_boards(
    plane: SeenBoard,
    held: Sequence[SeenBoard],
    size: tuple[int, int],
    *,
    focal: float | None = None,
    height: float | None = None,
) -> PlateView:
    """Calibrates the camera.

    Args:
        plane: The board on the plate.
        held: The board at other angles.
        size: Width and height of the pictures [px].
        focal: Focal length from the pictures' header [px], used where `held` has fewer than two.
        height: Measured height of the camera above the plate [m], used then and preferred to `focal`.

    Returns:
        The view, its origin in the middle of the board.

    Raises:
        BadPhotograph: The corners do not fit any camera, or no board in `held` is at an angle to the plate.
    """
    whole = len(held) + 1 >= LEAST_PICTURES
    boards = [plane, *held] if whole else [plane]
    guess = focal or 1.2 * max(size)
    if not whole and height is not None:
        guess *= height / _fitted(boards, size, guess, whole).height
    camera = _fitted(boards, size, guess, whole)
    if camera.error > _WORST_FIT * size[0] / 1000:
        raise BadPhotograph(
            f"corners of the board lie {camera.error:.1f} px off where any camera would see them",
            where="board pictures",
            remedy="lay the board flat, keep the camera's zoom and focus, remove blurred pictures",
            kind="no-board",
        )
    if whole and camera.lean < _LEAST_LEAN:
        raise BadPhotograph(
            f"the board is held at {np.degrees(camera.lean):.1f} degrees to the plate at most, from which the camera's "
            f"height cannot be told; at least {np.degrees(_LEAST_LEAN):.0f} are needed",
            where="board pictures",
            remedy="hold it at 15 to 40 degrees, or remove board-1, board-2, ... and give --camera-height",
            kind="no-board",
        )
    known = whole or focal is not None or height is not None
    relative = camera.focal_spread if whole else (MEASURED_HEIGHT if height is not None else HEADER_FOCAL)
    in_plane = camera.error / np.sqrt(len(plane.places)) * camera.height / camera.matrix[0, 0]
    reach = float(np.hypot(*plane.places[:, :2].std(axis=0)))
    by_axis = 0.0 if whole else _AXIS_OFF * max(size) / camera.matrix[0, 0]
    uncertainty = Uncertainty(
        scale=float(np.hypot(_RULER, in_plane / reach)),
        centre_m=float(np.hypot(_PLACED, in_plane)),
        tilt_rad=float(np.hypot(in_plane / reach * camera.height / reach, by_axis)),
        height_m=float(camera.height * relative) if known else np.inf,
    )
    words = f"{len(boards)} pictures of the board" if whole else "one picture of the board"
    view = PlateView(size, camera.matrix, camera.distortion, camera.rotation, camera.translation, uncertainty, words)
    return view.centred(np.zeros(2))


@dataclass(frozen=True, eq=False)
class _FittedCamera:
    """A camera that fits what is seen of the boards; the first of them lies on the plate.

    Attributes:
        error: Root-mean-square distance of the corners from where the camera would see them [px].
        matrix, distortion, rotation, translation: As in `PlateView`.
        focal_spread: Standard deviation of the focal length over itself.
        lean: Largest angle between the first board and another one [rad]; 0 without others.
    """

    error: float
    matrix: Float[ndarray, "3 3"]
    distortion: Float[ndarray, " 5"]
    rotation: Float[ndarray, "3 3"]
    translation: Float[ndarray, " 3"]
    focal_spread: float
    lean: float

    @property
    def height(self) -> float:
        """Height of the pupil above the first board [m]."""
        return float((-self.rotation.T @ self.translation)[2])


def _fitted(boards: Sequence[SeenBoard], size: tuple[int, int], guess: float, whole: bool) -> _FittedCamera:
    """Fits a camera, from a guess of its focal length [px]; its lens too, where `whole`.

    Raises:
        BadPhotograph: OpenCV finds no camera.
    """
    matrix = np.array([[guess, 0, (size[0] - 1) / 2], [0, guess, (size[1] - 1) / 2], [0, 0, 1]])
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_ZERO_TANGENT_DIST
    flags |= cv2.CALIB_FIX_K3
    if not whole:  # one level picture tells neither focal length nor axis
        flags |= cv2.CALIB_FIX_FOCAL_LENGTH | cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_K2
    places = [board.places.astype(np.float32) for board in boards]
    pixels = [board.pixels.astype(np.float32).reshape(-1, 1, 2) for board in boards]
    try:
        error, matrix, distortion, turns, shifts, deviations, _, _ = cv2.calibrateCameraExtended(
            places, pixels, size, matrix, np.zeros(5), flags=flags
        )
    except cv2.error as fault:
        what = f"{len(boards)} pictures" if len(boards) > 1 else "one picture"
        raise BadPhotograph(
            f"no camera can be calibrated from the corners of the board in {what}",
            where="board pictures",
            remedy="take them again: sharp, most of the board in each, and board-1, board-2, ... held at other angles",
            kind="no-board",
        ) from fault
    rotation, *others = (cv2.Rodrigues(turn)[0] for turn in turns)
    focal_spread = float(deviations.ravel()[:2].max() / matrix[0, 0])
    leans = [np.arccos(np.clip(rotation[:, 2] @ other[:, 2], -1, 1)) for other in others]
    return _FittedCamera(
        float(error), matrix, distortion.ravel()[:5], rotation, shifts[0].ravel(), focal_spread,
        float(max(leans, default=0.0)),
    )  # fmt: skip
