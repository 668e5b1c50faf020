"""A folder of photographs becomes a data set: silhouettes, protocol.json, fabrics.csv, and pictures to check."""

import csv
import io
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from pydantic import ValidationError

from cusick_bench.datasets.files.fabrics import FILE as FABRICS
from cusick_bench.datasets.files.protocol import FILE as PROTOCOL
from cusick_bench.datasets.files.protocol import Protocol, first_fault
from cusick_bench.photographs.calibration.view import PlateView
from cusick_bench.photographs.errors import BadPhotograph
from cusick_bench.photographs.preparation.calibrate import Named, calibrated, require_size, require_turn
from cusick_bench.photographs.preparation.pictures import DrapePicture, Pictures, find_pictures
from cusick_bench.photographs.preparation.reading_on_axis import outline_on_axis
from cusick_bench.photographs.preparation.silhouette import overlay, silhouette
from cusick_bench.photographs.preparation.weights import TABLE
from cusick_bench.photographs.preparation.whole_folder import free, whole_folder
from cusick_bench.photographs.reading import read_photograph
from cusick_bench.photographs.segmentation.confidence import ACCEPTED, doubts

CHECKS = "check"  # folder of the pictures to look at
_DATA = "data"  # folder of the silhouettes
_WRITTEN = (CHECKS, _DATA, FABRICS, PROTOCOL)
_VIEW = 2.36  # width of an image over the flat radius, as in the public release
_QUALITY = 88  # of JPEG files


@dataclass(frozen=True)
class Setting:
    """Description of the experiment by its user.

    Attributes:
        cloth_radius: Radius of the flat cloth [m].
        plate_radius: Radius of the plate [m].
        weights: Areal density by fabric [kg/m2]; what is not here stays empty.
        thicknesses: Thickness by fabric [m].
        captures: Which face lies up in which capture.
        camera_height: Height of the camera above the plate, measured with a rule [m]; None where it was not. Not used
            where pictures of the board held at angles give it.
        printed: Size of the printed board over its nominal size.
        image_size: Width of the silhouettes [px].
        accepted: Least confidence of an outline that is written.
    """

    cloth_radius: float
    plate_radius: float
    weights: Mapping[int, float] = field(default_factory=dict)
    thicknesses: Mapping[int, float] = field(default_factory=dict)
    captures: Mapping[int, str] = field(default_factory=lambda: {1: "up", 2: "up", 3: "down", 4: "down"})
    camera_height: float | None = None
    printed: float = 1.0
    image_size: int = 512
    accepted: float = ACCEPTED


@dataclass(frozen=True)
class Prepared:
    """Outcome of one photograph.

    Attributes:
        picture: The photograph.
        confidence: Score from 0 to 1 of how likely its outline is right within half a millimetre.
        doubts: Reasons against it, in words.
        written: Whether its silhouette was written.
    """

    picture: DrapePicture
    confidence: float
    doubts: tuple[str, ...]
    written: bool


@dataclass(frozen=True)
class Preparation:
    """Outcome of a folder.

    Attributes:
        out: Folder of the data set.
        view: The calibrated camera.
        protocol: Nominal values of the silhouettes.
        pictures: What became of each photograph.
        unweighed: Fabrics whose areal density is not known.
    """

    out: Path
    view: PlateView
    protocol: Protocol
    pictures: tuple[Prepared, ...]
    unweighed: tuple[int, ...]

    @property
    def doubtful(self) -> list[Prepared]:
        """Photographs whose silhouette was not written."""
        return [picture for picture in self.pictures if not picture.written]

    def document(self) -> dict[str, Any]:
        """Its part of the JSON document."""
        return {
            "out": self.out,
            "protocol": self.protocol.document(),
            "calibration": calibration_notes(self.view),
            "written": len(self.pictures) - len(self.doubtful),
            "doubtful": len(self.doubtful),
            "fabrics_without_weight": list(self.unweighed),
            "images": [
                {
                    "path": one.picture.path,
                    "name": one.picture.name,
                    "confidence": one.confidence,
                    "warnings": list(one.doubts),
                    "written": one.written,
                }
                for one in self.pictures
            ],
        }


def calibration_notes(view: PlateView) -> dict[str, Any]:
    """Results of the calibration with their uncertainties, for `notes` of protocol.json.

    Args:
        view: The calibrated camera.

    Returns:
        Values with their standard deviations; None where nothing is known.
    """
    spread = view.uncertainty
    height = float(view.eye[2])
    return {
        "from": view.source,
        "photograph_px_per_m": round(view.scale, 1),
        "scale_sd_relative": float(f"{spread.scale:.2g}"),
        "centre_sd_m": float(f"{spread.centre_m:.2g}"),
        "camera_tilt_rad": round(view.tilt, 5),
        "camera_tilt_sd_rad": float(f"{spread.tilt_rad:.2g}"),
        "camera_off_axis_m": [round(float(value), 4) for value in view.eye[:2]] if view.knows_height else None,
        "camera_height_m": round(height, 4) if view.knows_height else None,
        "camera_height_sd_m": float(f"{spread.height_m:.2g}") if view.knows_height else None,
        "lens_k1": round(float(view.distortion[0]), 5),
    }


def protocol_of(view: PlateView, setting: Setting) -> Protocol:
    """Nominal values of the silhouettes that are written.

    Args:
        view: The calibrated camera.
        setting: Description of the experiment by its user.

    Returns:
        The protocol; pinhole where the camera's height is known.

    Raises:
        BadPhotograph: A value that no drape meter has, such as the height that calibration found.
    """
    size = setting.image_size
    known = {"camera_height_m": float(view.eye[2]), "projection": "pinhole"} if view.knows_height else {}
    try:
        return Protocol(
            cloth_radius_m=setting.cloth_radius,
            plate_radius_m=setting.plate_radius,
            gravity_m_s2=9.81,
            image_size_px=size,
            px_per_m=size / (_VIEW * setting.cloth_radius),
            centre_px=((size - 1) / 2, (size - 1) / 2),
            image_y="up",
            foreground="dark",
            captures=dict(setting.captures),
            **known,
        )
    except ValidationError as error:
        raise BadPhotograph(
            first_fault(error),
            remedy="correct the diameters or --camera-height, or calibrate with more pictures of the board",
            kind="protocol-invalid",
        ) from error


def require_free(folder: Path, out: Path) -> None:
    """Refuses a folder in which a data set would mix with other files, or its pictures with the photographs.

    Args:
        folder: The photographs.
        out: Folder of the data set that is to be made of them.

    Raises:
        BadPhotograph: It holds more than a table of weights, or lies in the folder of the photographs.
    """
    if not free(out, _WRITTEN, allowed=(TABLE,)):
        raise BadPhotograph("is not empty", where=out, remedy="give a new folder, or remove it", kind="not-empty")
    if out.resolve().is_relative_to(folder.resolve()):
        raise BadPhotograph(
            "lies in the folder of the photographs, where its pictures would be taken for photographs the next time",
            where=out, remedy="give a folder beside it", kind="not-empty",
        )  # fmt: skip


def prepare(folder: Path, out: Path, setting: Setting, done: Callable[[str], None] = lambda name: None) -> Preparation:
    """Prepares a folder of photographs. The data set appears when it is whole; after an error nothing is left of it.

    Args:
        folder: The photographs.
        out: Folder to write; must not exist, or hold nothing but a table of weights.
        setting: Description of the experiment by its user.
        done: Called with the name of each photograph that is finished.

    Returns:
        What became of it. Doubtful outlines are drawn in `check/`, and not written as silhouettes; photographs that
        cannot be read count as doubtful.

    Raises:
        BadPhotograph: Anything that one has to mend first: the folder, the calibration, a picture of another camera.
    """
    require_free(folder, out)
    pictures = find_pictures(folder)
    view, turn = _view(pictures, setting)
    protocol = protocol_of(view, setting)
    fabrics = sorted({picture.fabric for picture in pictures.drapes})
    document = protocol.document() | {"notes": {"made_from": "photographs", "calibration": calibration_notes(view)}}
    prepared = []
    with whole_folder(out, _WRITTEN) as part:
        for picture in pictures.drapes:
            prepared.append(_prepared(picture, view, turn, protocol, setting, part))
            done(picture.name)
        (part / PROTOCOL).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
        (part / FABRICS).write_text(fabrics_table(fabrics, setting), encoding="utf-8")
    unweighed = tuple(number for number in fabrics if number not in setting.weights)
    return Preparation(out, view, protocol, tuple(prepared), unweighed)


def _view(pictures: Pictures, setting: Setting) -> tuple[PlateView, int]:
    """The calibrated camera, and the orientation that its pictures have in their headers."""

    def named(path: Path | None) -> Named | None:
        return None if path is None else (str(path), read_photograph(path))

    held = [(str(path), read_photograph(path)) for path in pictures.boards_held]
    board, plate = named(pictures.board_on_plate), named(pictures.plate)
    view = calibrated(board, held, plate, setting.plate_radius, height=setting.camera_height, printed=setting.printed)
    ruler = board or plate
    assert ruler is not None  # or there is no view
    return view, ruler[1].turn


def _prepared(
    picture: DrapePicture, view: PlateView, turn: int, protocol: Protocol, setting: Setting, out: Path
) -> Prepared:
    try:
        photograph = read_photograph(picture.path)
    except BadPhotograph as error:  # the others are prepared all the same
        return Prepared(picture, 0.0, (error.what,), False)
    require_turn(photograph, turn, str(picture.path))
    require_size(photograph, view.size, str(picture.path))
    outline, on_axis = outline_on_axis(photograph, view, setting.plate_radius, setting.cloth_radius)
    good = outline.confidence >= setting.accepted
    reasons = () if good else doubts(outline.evidence)
    title = f"{picture.name}: confidence {outline.confidence:.2f}" + ("" if good else f", {'; '.join(reasons)}")
    drawn = overlay(photograph, view, outline.radii, setting.plate_radius, title, good)
    (out / CHECKS).mkdir(parents=True, exist_ok=True)
    _write(out / CHECKS / f"check_{picture.name}.jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if good:
        place = out / _DATA / f"Fabric {picture.fabric}" / "silhouettes"
        place.mkdir(parents=True, exist_ok=True)
        _write(place / f"{picture.name}.png", silhouette(on_axis.radii, protocol), [])
    return Prepared(picture, outline.confidence, reasons, good)


def _write(path: Path, levels: np.ndarray, options: list[int]) -> None:
    coded, data = cv2.imencode(path.suffix, levels, options)
    assert coded
    path.write_bytes(data.tobytes())


def fabrics_table(fabrics: list[int], setting: Setting) -> str:
    """Text of fabrics.csv.

    Args:
        fabrics: Numbers.
        setting: Gives weights and thicknesses.

    Returns:
        The table; empty fields where nothing is known.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["fabric", "areal_density_kg_m2", "thickness_m"])
    for number in fabrics:
        values = (known.get(number) for known in (setting.weights, setting.thicknesses))
        table.writerow([number, *("" if value is None else f"{value:.6g}" for value in values)])
    return text.getvalue()
