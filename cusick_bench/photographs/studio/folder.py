"""Writes the photographs of a synthetic laboratory as a phone would, with the true outlines."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray
from PIL import Image

from cusick_bench.photographs.studio.lens import StudioCamera
from cusick_bench.photographs.studio.scene import Laboratory, Piece, bare_plate, make_drape
from cusick_bench.photographs.studio.shot import board_photograph, held_boards, photograph
from cusick_bench.photographs.studio.truth import apparent_radii
from cusick_bench.sim.constants import PLATE_RADIUS

HELD = 5  # pictures of the board held at angles
PLATE_SHOT = 90  # number of the bare plate's photograph
ANGLES = 720
TRUTH = "truth.json"
_FULL_FRAME = math.hypot(36, 24)  # [mm]
_FOCAL_TAG, _EXIF = 41989, 0x8769  # FocalLengthIn35mmFilm, and the directory that holds it


def focal_in_film(camera: StudioCamera) -> int:
    """Focal length as a phone writes it into a picture's header.

    Args:
        camera: The camera.

    Returns:
        Equivalent for 35 mm film, in whole millimetres.
    """
    return round(camera.focal * _FULL_FRAME / math.hypot(camera.width, camera.height))


def calibration_pictures(laboratory: Laboratory) -> dict[str, UInt8[ndarray, "height width 3"]]:
    """Pictures from which a laboratory is calibrated.

    Args:
        laboratory: The laboratory.

    Returns:
        Pictures by name.
    """
    pictures = {}
    if laboratory.calibration != "plate":
        pictures["board-plane"] = board_photograph(laboratory, 0)
    if laboratory.calibration == "boards":
        pictures |= {f"board-{number}": taken for number, taken in enumerate(held_boards(laboratory, HELD), 1)}
    if laboratory.has_plate_picture:
        pictures["plate"] = photograph(laboratory, bare_plate(laboratory, PLATE_RADIUS), PLATE_SHOT)
    return pictures


def true_radii(laboratory: Laboratory, piece: Piece) -> Float[ndarray, " angles"]:
    """True outline of a drape, seen from the plate's axis at the camera's height, x to the right of the picture.

    Args:
        laboratory: Where it lies.
        piece: The drape.

    Returns:
        Radii [m] at `ANGLES` angles, at the scale of the plate's plane.
    """
    camera = laboratory.camera
    middle, along_x, along_y = camera.project(np.array([[0, 0, 0], [1e-4, 0, 0], [0, 1e-4, 0]], float))
    right = np.linalg.solve(np.column_stack([along_x - middle, along_y - middle]), [1.0, 0.0])
    turn = math.atan2(right[1], right[0])
    angles = np.arange(ANGLES) * 2 * np.pi / ANGLES + turn
    return apparent_radii(piece.vertices, piece.faces, camera.eye[2], angles)


def write_photographs(
    laboratory: Laboratory, folder: Path, samples: int, done: Callable[[str], None] = lambda name: None
) -> None:
    """Writes a folder of photographs, ready to be prepared.

    Args:
        laboratory: The laboratory.
        folder: Where to.
        samples: Number of drapes.
        done: Called with the name of every picture.
    """
    folder.mkdir(parents=True, exist_ok=True)
    truth = {}
    for name, levels in calibration_pictures(laboratory).items():
        _write(folder / f"{name}.jpg", levels, laboratory)
        done(name)
    for sample in range(1, samples + 1):
        name = f"Fabric_1_Sample_{sample}_Capture_1"
        drape = make_drape(laboratory, sample)
        _write(folder / f"{name}.jpg", photograph(laboratory, drape, sample), laboratory)
        truth[name] = [round(float(radius), 6) for radius in true_radii(laboratory, drape)]
        done(name)
    camera = laboratory.camera
    document = {"camera_height_m": camera.eye[2], "eye_m": list(camera.eye), "k1": camera.distortion[0]}
    (folder / TRUTH).write_text(json.dumps(document | {"radii_m": truth}), encoding="utf-8")


def _write(path: Path, levels: ndarray, laboratory: Laboratory) -> None:
    header = Image.Exif()
    header.get_ifd(_EXIF)[_FOCAL_TAG] = focal_in_film(laboratory.camera)
    image = Image.fromarray(np.ascontiguousarray(levels[:, :, ::-1]))
    image.save(path, quality=laboratory.quality, subsampling=0, exif=header)
