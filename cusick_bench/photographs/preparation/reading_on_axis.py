"""Outline of a photograph for the data set: found, corrected to a view from the axis, and with a confidence."""

from dataclasses import replace

from cusick_bench.photographs.calibration.view import PlateView
from cusick_bench.photographs.preparation.on_axis import left_by_calibration, left_off_axis, seen_on_axis
from cusick_bench.photographs.reading import Photograph
from cusick_bench.photographs.segmentation.confidence import confidence
from cusick_bench.photographs.segmentation.outline import Outline, find_outline


def outline_on_axis(photograph: Photograph, view: PlateView, plate: float, cloth: float) -> tuple[Outline, Outline]:
    """Finds the cloth's outline and corrects it to a view from the axis.

    Args:
        photograph: The picture.
        view: The calibrated camera.
        plate: Radius of the plate [m].
        cloth: Radius of the flat cloth [m].

    Returns:
        The outline as the camera sees it, and as an eye on the axis would; both with the confidence of the latter.
    """
    found = find_outline(photograph, view, plate, cloth)
    evidence = replace(
        found.evidence,
        off_axis_mm=1e3 * left_off_axis(found.radii, view, plate, cloth),
        calibration_mm=1e3 * left_by_calibration(found.radii, view, plate, cloth),
    )
    seen = replace(found, evidence=evidence, confidence=confidence(evidence))
    return seen, replace(seen, radii=seen_on_axis(found.radii, view, plate, cloth))
