"""Calibration from the bare plate, a circle of known radius: its scale, or only its axis where a board is there."""

import logging
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.optimize import least_squares

from cusick_bench.photographs.calibration.view import HEADER_FOCAL, MEASURED_HEIGHT, PlateView, Uncertainty
from cusick_bench.photographs.errors import BadPhotograph
from cusick_bench.photographs.reading import Photograph, linear_light

_log = logging.getLogger(__name__)

_ANGLES = 360
_TILT = np.radians(2.0)  # prior standard deviation of the tilt of a camera that was mounted level
_LEAST_TILT = np.radians(0.3)  # least uncertainty of the tilt
_LEAST_EDGE = 0.6  # least share of the circle that is visible
_SECOND = (0.015, 0.1)  # distances from the plate's circle, over its radius, between which a second one is searched
_HALO = 4.0  # [px] width of the circle's blur and of the halo that sharpening draws along it
_FAINT = 0.12  # least strength of a second circle over that of the first
_ALIKE, _TAIL = 0.005, 0.003  # radii within which it lies everywhere, and from where the search begins
_MOST_OFF = 0.01
"""Largest relative difference between the plate's radius by the board and as it is told. In studio laboratories 3000 to
3077 it is .0003 at most (50 calibrations); a ruler of 150 mm that is read to half a millimetre adds .0033, a plate of
180 mm that is told to a millimetre .0028. A sheet that was printed "fit to page" is off by .03 and more."""
_RIM_FOUND = 1e-4  # [m] least uncertainty of the plate's middle
_TELLING = 3.0  # standard deviations of the scale from which a smaller difference is told


def _edge_along(levels: ndarray, starts: ndarray, ends: ndarray, steps: int = 160) -> tuple[ndarray, ndarray]:
    """Strongest change of colour along each line from start to end: place and strength."""
    share = np.linspace(0, 1, steps)
    lines = starts[:, None] + share[:, None] * (ends - starts)[:, None]
    smooth = cv2.GaussianBlur(linear_light(levels), (0, 0), 1.0)
    colour = cv2.remap(
        smooth, lines[..., 0].astype(np.float32), lines[..., 1].astype(np.float32), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    ).astype(np.float64)  # fmt: skip
    change = np.linalg.norm(np.diff(cv2.blur(colour, (3, 1)), axis=1), axis=-1)
    best = np.clip(change.argmax(axis=1), 1, steps - 3)
    row = np.arange(len(best))
    before, at, after = change[row, best - 1], change[row, best], change[row, best + 1]
    bend = before - 2 * at + after
    fine = best + np.where(np.abs(bend) > 1e-9, 0.5 * (before - after) / np.where(bend == 0, 1, bend), 0)
    position = (np.clip(fine, 0, steps - 2) + 0.5) / (steps - 1)
    return starts + position[:, None] * (ends - starts), at


def _blob(photograph: Photograph, name: str) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Ellipse around what has the colour of the picture's middle."""
    width, height = photograph.size
    lab = cv2.cvtColor(cv2.GaussianBlur(photograph.levels, (0, 0), 2), cv2.COLOR_BGR2Lab).astype(np.float32)
    part = min(width, height) // 30
    middle = np.median(
        lab[height // 2 - part : height // 2 + part, width // 2 - part : width // 2 + part].reshape(-1, 3), axis=0
    )
    distance = np.clip(np.linalg.norm(lab - middle, axis=-1), 0, 255).astype(np.uint8)
    _, mask = cv2.threshold(distance, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)
    _, labels = cv2.connectedComponents(mask)
    near = labels[height // 2 - part : height // 2 + part, width // 2 - part : width // 2 + part]
    shares = np.bincount(near[near > 0], minlength=2)  # a pin in the middle of the plate has another colour
    inside = labels == shares.argmax()
    contours, _ = cv2.findContours(inside.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = max(contours, key=cv2.contourArea) if contours else np.zeros((0, 1, 2), np.int32)
    hull = cv2.convexHull(outline) if len(outline) >= 50 else outline
    if not shares.any() or len(hull) < 12:
        raise _no_plate(name, "no disc stands out in the middle")
    ellipse = cv2.fitEllipse(hull)
    ratio = min(ellipse[1]) / max(ellipse[1])
    if ratio < 0.85 or max(ellipse[1]) > 0.98 * min(width, height):
        raise _no_plate(name, "what stands out in the middle is no disc within the picture")
    (column, row), (first, second), turn = ellipse
    return (column, row), (first, second), turn


def _no_plate(name: str, what: str) -> BadPhotograph:
    return BadPhotograph(
        f"{what}: the bare plate is not found",
        where=name,
        remedy="photograph the plate without cloth, near the middle, in a colour unlike the ground's, or use the board",
        kind="no-plate",
    )


def _require_one_circle(levels: ndarray, view: PlateView, radius: float, strength: float, name: str) -> None:
    """Refuses a plate whose rim has another colour: it is unknown which of its two circles has the stated radius."""
    angles = np.arange(_ANGLES) * 2 * np.pi / _ANGLES
    way = radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(_ANGLES)])
    near = max(_SECOND[0], _HALO / (view.scale * radius))
    for side in (-1, 1):
        start, end = 1 + side * near, 1 + side * _SECOND[1]
        pixels, strengths = _edge_along(levels, view.project(start * way), view.project(end * way), steps=80)
        reach = np.hypot(*view.on_plane(pixels).T) / radius
        strong = strengths > _FAINT * strength
        if strong.mean() < _LEAST_EDGE:
            continue
        second = float(np.median(reach[strong]))
        if (strong & (np.abs(reach - second) < _ALIKE)).mean() >= _LEAST_EDGE and abs(second - start) > _TAIL:
            raise BadPhotograph(
                f"the bare plate has two edges, whose radii differ by {abs(second - 1):.1%}: which of them "
                "--plate-diameter means is not seen, and the scale would be off by as much",
                where=name,
                remedy="give plate and rim one colour (tape or paint), or use the board, see docs/drape-meter.md",
                kind="no-plate",
            )


def view_from_plate(
    photograph: Photograph, name: str, radius: float, *, focal: float | None = None, height: float | None = None
) -> PlateView:
    """Calibrates a camera, put up level, from the bare plate alone.

    A circle looks the same from two opposite tilts, so that none is corrected; the uncertainty of the tilt is the tilt
    that the circle's flattening allows.

    Args:
        photograph: Picture of the bare plate.
        name: Its file, for messages.
        radius: Radius of the plate [m].
        focal: Focal length [px]; the picture's header's by default.
        height: Measured height of the camera above the plate [m], preferred to the focal length.

    Returns:
        The view.

    Raises:
        BadPhotograph: No plate is found, or one with two edges.
    """
    middle, axes, turn = _blob(photograph, name)
    angles = np.arange(_ANGLES) * 2 * np.pi / _ANGLES
    lean = np.radians(turn)
    rim = np.column_stack([axes[0] / 2 * np.cos(angles), axes[1] / 2 * np.sin(angles)])
    rim = rim @ np.array([[np.cos(lean), np.sin(lean)], [-np.sin(lean), np.cos(lean)]])
    pixels, strength = _edge_along(photograph.levels, np.array(middle) + 0.9 * rim, np.array(middle) + 1.1 * rim)
    size = photograph.size
    focal_known = focal or photograph.focal
    across = float(np.mean(axes)) / 2
    length = across * height / radius if height is not None else (focal_known or 1.2 * max(size))
    matrix = np.array([[length, 0, (size[0] - 1) / 2], [0, length, (size[1] - 1) / 2], [0, 0, 1]])
    good = strength > 0.3 * np.median(strength)
    start = _level_pose(np.array(middle), across, matrix, radius)
    level = tilted = spread = None
    for _ in range(3):
        tilted = least_squares(_misfit, start, args=(pixels[good], matrix, size, radius))
        level = least_squares(_misfit_level, start[2:], args=(pixels[good], matrix, size, radius))
        start, miss = tilted.x, _misfit(tilted.x, pixels, matrix, size, radius)[:-2] * radius / 1e3
        spread = float(1.4826 * np.median(np.abs(miss[good])))
        good = np.abs(miss) < max(3 * spread, 2e-4)
    assert level is not None and tilted is not None and spread is not None  # noqa: PT018
    if good.mean() < _LEAST_EDGE:
        raise _no_plate(name, f"only {good.mean():.0%} of a circle is seen")
    view = _view_of(np.concatenate([[0.0, 0.0], level.x]), matrix, size)
    _require_one_circle(photograph.levels, view, radius, float(np.median(strength[good])), name)
    known = height is not None or focal_known is not None
    relative = MEASURED_HEIGHT if height is not None else HEADER_FOCAL
    along = radius / across  # [m/px] in the plane
    uncertainty = Uncertainty(
        scale=float(np.hypot(1e-3, spread / radius / np.sqrt(good.sum()))),
        centre_m=float(np.hypot(along * 0.3, spread / np.sqrt(good.sum()))),
        tilt_rad=float(np.hypot(_LEAST_TILT, np.hypot(*tilted.x[:2]))),
        height_m=float(view.eye[2] * relative) if known else np.inf,
    )
    return replace(view, uncertainty=uncertainty).centred(np.zeros(2))


def _level_pose(middle: ndarray, across: float, matrix: ndarray, radius: float) -> Float[ndarray, " 5"]:
    """Tilts, and place of the plate in the camera's axes, of a level camera."""
    distance = matrix[0, 0] * radius / across
    return np.array([0.0, 0.0, *(distance * (middle - matrix[:2, 2]) / matrix[0, 0]), distance])


def _view_of(pose: ndarray, matrix: ndarray, size: tuple[int, int]) -> PlateView:
    tilt, _ = cv2.Rodrigues(np.array([pose[0], pose[1], 0.0]))
    rotation = tilt @ np.diag([1.0, -1.0, -1.0])
    nothing = Uncertainty(0, 0, 0, 0)
    return PlateView(size, matrix, np.zeros(5), rotation, pose[2:], nothing, "the bare plate")


def _misfit(pose: ndarray, pixels: ndarray, matrix: ndarray, size: tuple[int, int], radius: float) -> ndarray:
    """Thousandths of the radius by which edge points miss the circle, and tilts in units of their prior."""
    places = _view_of(pose, matrix, size).on_plane(pixels)
    miss = 1e3 * (np.hypot(places[:, 0], places[:, 1]) / radius - 1)
    return np.append(miss, pose[:2] / _TILT)


def _misfit_level(place: ndarray, pixels: ndarray, matrix: ndarray, size: tuple[int, int], radius: float) -> ndarray:
    return _misfit(np.concatenate([[0.0, 0.0], place]), pixels, matrix, size, radius)[:-2]


def _off_circle(circle: ndarray, places: ndarray) -> ndarray:
    return np.hypot(*(places - circle[:2]).T) - circle[2]


def _circle_by_board(
    view: PlateView, photograph: Photograph, name: str, radius: float
) -> tuple[Float[ndarray, " 3"], float]:
    """Middle and radius of the plate in a known plane, and the standard deviation of the middle [m]."""
    angles = np.arange(_ANGLES) * 2 * np.pi / _ANGLES
    way = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(_ANGLES)])
    pixels, strength = _edge_along(
        photograph.levels, view.project(0.8 * radius * way), view.project(1.2 * radius * way)
    )
    places = view.on_plane(pixels)
    good = strength > 0.3 * np.median(strength)
    circle = np.array([0.0, 0.0, radius])
    miss = np.zeros(_ANGLES)
    for _ in range(4):
        circle = least_squares(_off_circle, circle, args=(places[good],), loss="soft_l1", f_scale=3e-4).x
        miss = np.abs(np.hypot(*(places - circle[:2]).T) - circle[2])
        good = miss < max(3 * 1.4826 * np.median(miss[good]), 2e-4)
    if good.mean() < _LEAST_EDGE:
        raise _no_plate(name, f"only {good.mean():.0%} of a circle is seen near the board's middle")
    return circle, float(miss[good].std()) / np.sqrt(good.sum())


def _size_error(measured: float, told: float, scale_sd: float, name: str) -> float:
    """Relative difference of the plate's radius by the board from the told one.

    More than `_TELLING` standard deviations of the scale give a warning, more than `_MOST_OFF` is refused.
    """
    off = measured / told - 1
    what = f"the plate's radius is {1e3 * measured:.1f} mm by the board, but {1e3 * told:.1f} mm are told"
    if abs(off) > _MOST_OFF:
        raise BadPhotograph(
            f"{what}; they may differ by {_MOST_OFF:.0%}",
            where=name,
            remedy="correct --plate-diameter, or look at the check ruler of the printed board (--printed-ruler)",
            kind="plate-size",
        )
    if abs(off) > _TELLING * scale_sd:
        _log.warning(
            "%s: %s, so the scale is taken to be uncertain by %.1f %%; correct --plate-diameter, or measure the check "
            "ruler of the printed board (--printed-ruler)",
            name, what, 100 * abs(off),
        )  # fmt: skip
    return off


def centred_on_plate(view: PlateView, photograph: Photograph, name: str, radius: float) -> PlateView:
    """Moves the origin of a known plane to the middle of the bare plate, and checks the scale by the plate's size.

    Args:
        view: From the board.
        photograph: Picture of the bare plate.
        name: Its file, for messages.
        radius: Radius of the plate [m].

    Returns:
        The view; its scale is as uncertain as the two radii differ, and more where the board alone leaves more open.

    Raises:
        BadPhotograph: No plate is found, or one of another size.
    """
    circle, spread = _circle_by_board(view, photograph, name, radius)
    stated = view.uncertainty
    off = _size_error(float(circle[2]), radius, stated.scale, name)
    uncertainty = replace(
        stated, scale=float(np.hypot(stated.scale, off)), centre_m=float(np.hypot(_RIM_FOUND, spread))
    )
    moved = replace(view, uncertainty=uncertainty).centred(circle[:2])
    return replace(moved, source=f"{view.source}, middle from the bare plate")
