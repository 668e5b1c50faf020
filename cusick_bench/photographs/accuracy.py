"""Errors of the outlines of synthetic photographs, and how well confidence tells wrong outlines from right ones.

Segmentation and confidence were tuned on laboratories with numbers below 1000; report figures for others only.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy import ndarray

from cusick_bench.photographs.calibration.view import PlateView
from cusick_bench.photographs.errors import BadPhotograph
from cusick_bench.photographs.preparation.calibrate import calibrated
from cusick_bench.photographs.preparation.reading_on_axis import outline_on_axis
from cusick_bench.photographs.reading import Photograph, focal_in_pixels
from cusick_bench.photographs.segmentation.confidence import ACCEPTED
from cusick_bench.photographs.studio.folder import calibration_pictures, focal_in_film, true_radii
from cusick_bench.photographs.studio.scene import Laboratory, Piece, make_drape, make_laboratory
from cusick_bench.photographs.studio.shot import photograph
from cusick_bench.photographs.studio.trouble import TROUBLES, troubled
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

TOLERANCE_MM = 0.5
LEVEL_DEG = 3.0  # largest angle off the plate's axis of a camera that is as level as docs/drape-meter.md asks for
SHOTS = 5  # photographs of a laboratory


@dataclass(frozen=True)
class Measured:
    """One photograph's outline against the truth.

    Attributes:
        laboratory, shot: Its numbers.
        calibration: What the camera was calibrated with.
        trouble: What was done to it, empty if nothing.
        beside_deg: Angle at the plate between its axis and the camera [degrees].
        rms_mm: Root-mean-square error of the radii [mm].
        bias_mm: Their mean error [mm].
        largest_mm: Their largest error [mm].
        confidence: Score of the outline, from 0 to 1.
        evidence: What the confidence is computed from.
    """

    laboratory: int
    shot: int
    calibration: str
    trouble: str
    beside_deg: float
    rms_mm: float
    bias_mm: float
    largest_mm: float
    confidence: float
    evidence: dict[str, float]

    @property
    def wrong(self) -> bool:
        """Whether the outline misses the tolerance."""
        return self.rms_mm > TOLERANCE_MM

    @property
    def accepted(self) -> bool:
        """Whether its silhouette would be written."""
        return self.confidence >= ACCEPTED


@dataclass(frozen=True)
class Accuracy:
    """Figures over many photographs.

    Attributes:
        photographs: Their number.
        within: Share whose root-mean-square error is at most `TOLERANCE_MM`.
        level: Number of photographs from at most `LEVEL_DEG` beside the axis.
        level_within: The same share among them.
        median_mm, most_mm: Median and 95 % quantile of that error [mm].
        accepted: Share that is accepted.
        accepted_within: The same share among the accepted.
        wrong: Number of outlines that miss the tolerance.
        recognised: Share of them that is not accepted.
    """

    photographs: int
    within: float
    level: int
    level_within: float
    median_mm: float
    most_mm: float
    accepted: float
    accepted_within: float
    wrong: int
    recognised: float


def accuracy(measured: Sequence[Measured]) -> Accuracy:
    """Sums up.

    Args:
        measured: Photographs.

    Returns:
        The figures; NaN where there is nothing to count.
    """
    if not measured:
        nan = math.nan
        return Accuracy(0, nan, 0, nan, nan, nan, nan, nan, 0, nan)
    errors = np.array([one.rms_mm for one in measured])
    accepted = np.array([one.accepted for one in measured], bool)
    level = np.array([one.beside_deg <= LEVEL_DEG for one in measured], bool)
    wrong = errors > TOLERANCE_MM
    return Accuracy(
        len(errors),
        float((~wrong).mean()),
        int(level.sum()),
        float((~wrong[level]).mean()) if level.any() else math.nan,
        float(np.median(errors)),
        float(np.percentile(errors, 95)),
        float(accepted.mean()),
        float((~wrong[accepted]).mean()) if accepted.any() else math.nan,
        int(wrong.sum()),
        float((~accepted[wrong]).mean()) if wrong.any() else math.nan,
    )


def measure(photographs: int, first: int, *, troubles: bool = False) -> Iterator[Measured]:
    """Draws photographs, finds their outlines and holds them against the truth.

    Args:
        photographs: Number of them.
        first: Number of the first laboratory.
        troubles: Whether to spoil every photograph in one of the ways of `TROUBLES`.

    Yields:
        What was measured.
    """
    for number in range(-(-photographs // SHOTS)):
        laboratory = make_laboratory(first + number)
        view = _view(laboratory)
        for shot in range(min(SHOTS, photographs - number * SHOTS)):
            trouble = TROUBLES[(number * SHOTS + shot) % len(TROUBLES)] if troubles else ""
            yield _measured(laboratory, view, shot, trouble)


def _photograph(laboratory: Laboratory, levels: ndarray) -> Photograph:
    camera = laboratory.camera
    return Photograph(levels, focal_in_pixels(focal_in_film(camera), (camera.width, camera.height)))


def _view(laboratory: Laboratory) -> PlateView:
    taken = {name: (name, _photograph(laboratory, levels)) for name, levels in calibration_pictures(laboratory).items()}
    held = [picture for name, picture in taken.items() if name not in ("board-plane", "plate")]
    try:
        return calibrated(taken.get("board-plane"), held, taken.get("plate"), PLATE_RADIUS)
    except BadPhotograph as error:
        raise BadPhotograph(f"laboratory {laboratory.seed}: {error}", kind=error.kind) from error


def _measured(laboratory: Laboratory, view: PlateView, shot: int, trouble: str) -> Measured:
    levels, drape = _taken(laboratory, shot, trouble)
    _, outline = outline_on_axis(_photograph(laboratory, levels), view, PLATE_RADIUS, CLOTH_RADIUS)
    error = 1e3 * (outline.radii - true_radii(laboratory, drape))
    return Measured(
        laboratory.seed,
        shot,
        laboratory.calibration,
        trouble,
        float(np.degrees(np.arctan2(np.hypot(*laboratory.camera.eye[:2]), laboratory.camera.eye[2]))),
        float(np.sqrt((error**2).mean())),
        float(error.mean()),
        float(np.abs(error).max()),
        outline.confidence,
        asdict(outline.evidence),
    )


def _taken(laboratory: Laboratory, shot: int, trouble: str) -> tuple[ndarray, Piece]:
    if trouble:
        return troubled(laboratory, shot, trouble)
    drape = make_drape(laboratory, shot)
    return photograph(laboratory, drape, shot), drape


def document(measured: Iterable[Measured]) -> list[dict[str, Any]]:
    """The photographs' part of the JSON document.

    Args:
        measured: Photographs.

    Returns:
        One object for each.
    """
    return [asdict(one) for one in measured]
