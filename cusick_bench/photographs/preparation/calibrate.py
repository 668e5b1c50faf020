"""Calibration of the camera over the plate, from the pictures of board and plate that there are."""

import logging
from collections.abc import Sequence

import numpy as np

from cusick_bench.photographs.board import LEAST_DISC, MOST_DISC
from cusick_bench.photographs.calibration.boards import LEAST_PICTURES, find_board, view_from_boards
from cusick_bench.photographs.calibration.plate import centred_on_plate, view_from_plate
from cusick_bench.photographs.calibration.view import PlateView
from cusick_bench.photographs.errors import BadPhotograph
from cusick_bench.photographs.reading import Photograph

_log = logging.getLogger(__name__)

_OTHER_HEIGHT = 0.1  # relative difference of two heights from which one is wrong: three times what a header may be off

Named = tuple[str, Photograph]
"""A picture with its file's name."""


def calibrated(
    board_on_plate: Named | None,
    boards_held: Sequence[Named],
    plate: Named | None,
    plate_radius: float,
    *,
    height: float | None = None,
    printed: float = 1.0,
) -> PlateView:
    """Calibrates the camera.

    Args:
        board_on_plate: The board on the plate; without it the bare plate is the ruler.
        boards_held: The board at other angles.
        plate: The bare plate; beside a board it gives the axis.
        plate_radius: Radius of the plate [m].
        height: Measured height of the camera above the plate [m], None where it was not measured; not used where
            two and more of `boards_held` give it. A warning says so where another height follows from these, or from
            the focal length in the pictures' header.
        printed: Size of the board on paper over its nominal size.

    Returns:
        The view.

    Raises:
        BadPhotograph: No board or plate is seen, its middle lies outside the pictures, or they have different sizes
            or are turned otherwise.
    """
    pictures = [picture for picture in (board_on_plate, *boards_held, plate) if picture is not None]
    if not pictures:
        raise BadPhotograph(
            "neither board nor plate was photographed", remedy="see docs/drape-meter.md", kind="no-ruler"
        )
    for name, photograph in pictures:
        require_turn(photograph, pictures[0][1].turn, name)
        require_size(photograph, pictures[0][1].size, name)
    if board_on_plate is None:
        assert plate is not None
        view = view_from_plate(plate[1], plate[0], plate_radius, height=height)
        _compare_heights(view, height, plate[1].focal)
        return view
    name, photograph = board_on_plate
    by_boards = len(boards_held) + 1 >= LEAST_PICTURES
    if boards_held and not by_boards:
        _log.warning(
            "%s is not used: one picture of the board held at an angle does not tell the camera's height, %d do",
            boards_held[0][0], LEAST_PICTURES - 1,
        )  # fmt: skip
    view = view_from_boards(
        find_board(photograph, name, printed),
        [find_board(held, title, printed) for title, held in (boards_held if by_boards else ())],
        photograph.size,
        focal=photograph.focal,
        height=height,
    )
    _compare_heights(view, height, photograph.focal, by_boards=by_boards)
    if plate is not None:
        view = centred_on_plate(view, plate[1], plate[0], plate_radius)
    elif not LEAST_DISC <= 2 * plate_radius <= MOST_DISC:
        _log.warning(
            "%s: no disc of the board fits a plate of %g mm, so its middle is known only as well as you laid the board "
            "there; add plate.jpg, the bare plate, which gives the middle",
            name, 2e3 * plate_radius,
        )  # fmt: skip
    column, row = view.project(np.zeros((1, 3)))[0]
    if not (0 <= column < view.size[0] and 0 <= row < view.size[1]):
        raise BadPhotograph(
            f"the plate's middle lies outside the picture, at column {column:.0f}, row {row:.0f}",
            where=name,
            remedy="aim the camera at the plate, and take all pictures again",
            kind="no-plate",
        )
    return view


def _compare_heights(view: PlateView, told: float | None, focal: float | None, *, by_boards: bool = False) -> None:
    """Warns of a measured height that the pictures contradict, such as one above the table instead of the plate."""
    if told is None or (focal is None and not by_boards):
        return
    source = "pictures of the board held at angles" if by_boards else "focal length in the pictures' header"
    other = float(view.eye[2])
    if focal is not None and not by_boards:  # at a known scale the height is proportional to the focal length
        other *= focal / float(view.matrix[0, 0])
    if abs(other / told - 1) > _OTHER_HEIGHT:
        _log.warning(
            "the camera is %.2f m above the plate by the %s, but %.2f m by --camera-height; the %s is used; measure "
            "from the plate's top to the lens",
            other, source, told, "former" if by_boards else "latter",
        )  # fmt: skip


def require_turn(photograph: Photograph, turn: int, name: str) -> None:
    """Refuses a picture whose header turns it otherwise than those that the camera was calibrated from.

    A phone that looks straight down does not know how it is held, and may change its mind between two pictures.

    Args:
        photograph: The picture.
        turn: Orientation that it should have, as Exif has it.
        name: Its file, for the message.

    Raises:
        BadPhotograph: It has another one.
    """
    if photograph.turn != turn:
        raise BadPhotograph(
            f"has the orientation {photograph.turn} in its header, the calibration's pictures {turn}, so that it would "
            "be turned otherwise",
            where=name,
            remedy="take the orientation out of the headers of all pictures if the camera was not moved, else take all "
            "pictures again",
            kind="other-orientation",
        )


def require_size(photograph: Photograph, size: tuple[int, int], name: str) -> None:
    """Refuses a picture that another camera, or the camera held otherwise, has taken.

    Args:
        photograph: The picture.
        size: Width and height that it should have [px].
        name: Its file, for the message.

    Raises:
        BadPhotograph: It has another size.
    """
    if photograph.size != size:
        raise BadPhotograph(
            f"has {photograph.size[0]} x {photograph.size[1]} px, the calibration's pictures {size[0]} x {size[1]}",
            where=name,
            remedy="take all pictures with one camera in one place, at one zoom and orientation",
            kind="other-size",
        )
