"""The outline of the cloth in a photograph, and the evidence for it."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.photographs.calibration.view import PlateView
from cusick_bench.photographs.reading import Photograph, linear_light
from cusick_bench.photographs.segmentation.colour import learnt, likelihood
from cusick_bench.photographs.segmentation.confidence import Evidence, confidence
from cusick_bench.photographs.segmentation.curve import Curve, curve_of, normals, outermost
from cusick_bench.photographs.segmentation.edge import edge_strength
from cusick_bench.photographs.segmentation.edge_model import fitted_model, read_outline
from cusick_bench.photographs.segmentation.path import closed_path
from cusick_bench.photographs.segmentation.plane import PlanePicture
from cusick_bench.photographs.segmentation.polar import STEP, PolarPicture, polar_picture
from cusick_bench.photographs.segmentation.refine import refined
from cusick_bench.photographs.segmentation.shading import evenly_lit
from cusick_bench.photographs.segmentation.snap import snapped
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS

_REGION = 0.7  # weight of a millimetre of wrongly coloured places
_EDGE = 1.0  # weight of an edge's strength
_STIFFNESS = 0.12
_LEAST, _MOST = 0.97, 1.06  # plate radii and flat radii between which the outline lies
_WEAK = 1.2  # [standard deviations] least strength of an edge
_SECTOR = 15  # number of angles, 1 degree apart, whose strange places are counted together
_SNAPS = 2  # how often the outline is moved to the nearest edges
_BESIDE = (1.0e-3, 3.0e-3, 2e-4)  # [m] from the outline, inwards, between which the cloth is looked at; and steps
_WHITE = 250.0  # level from which on a place is taken to be overexposed, as noise and JPEG make it a little darker
_ROUNDS = 1  # how often colours are learnt again from the outline


@dataclass(frozen=True, eq=False)
class Outline:
    """Outline of the cloth at the scale of the plate's plane.

    Attributes:
        radii: Radii [m] at equidistant angles, counter-clockwise from the right of the picture.
        evidence: What speaks for it and against it.
        confidence: Score from 0 to 1 of how likely it is right within half a millimetre; no fitted probability.
    """

    radii: Float[ndarray, " angles"]
    evidence: Evidence
    confidence: float


@dataclass(frozen=True, eq=False)
class FoundByLight:
    """The outline by colours, edges and levels of light, before the network reads it.

    Attributes:
        radii: Radii [m] at equidistant angles.
        ratio: Log likelihood ratio of cloth against ground at every place.
        edges: Strength of an edge at every place.
        measures: Fields of the evidence that are measured on the way.
    """

    radii: Float[ndarray, " angles"]
    ratio: Float[ndarray, "angles radii"]
    edges: Float[ndarray, "angles radii"]
    measures: dict[str, float]


def found_by_light(picture: PolarPicture) -> FoundByLight:
    """Finds the cloth's outline by colours, edges and levels of light.

    Args:
        picture: Evenly lit.

    Returns:
        The outline, and what was seen on the way.
    """
    generator = np.random.default_rng(0)  # of the places that colours are learnt from: a picture always reads the same
    edges, span = edge_strength(picture), _span(picture)
    ratio, strange = likelihood(picture, learnt(picture, generator))
    path = earlier = _path(ratio, edges, span, _REGION, _EDGE)
    for _ in range(_ROUNDS):
        ratio, _ = likelihood(picture, learnt(picture, generator, picture.radii[path]))
        earlier, path = path, _path(ratio, edges, span, _REGION, _EDGE)
    learning = float(1e3 * STEP * np.percentile(np.abs(path - earlier), 97))
    curve, before, strength = curve_of(picture.radii[path]), picture.radii[path], np.zeros(0)
    for _ in range(_SNAPS):
        known = learnt(picture, generator, outermost(curve))
        before, (curve, strength) = outermost(curve), snapped(picture.plane, known, curve)
    radii, missing, width = refined(picture.plane, curve)
    measures = {
        "learning_mm": learning,
        "weak_fine": float((strength < _WEAK).mean()),
        "unsettled_mm": float(1e3 * np.percentile(np.abs(outermost(curve) - before), 97)),
        "unfound": missing,
        "width_mm": 1e3 * width,
        "strange": float(cv2.blur(np.tile(strange, 3).reshape(1, -1), (_SECTOR, 1))[0].max()),
    }
    return FoundByLight(radii, ratio, edges, measures)


def find_outline(photograph: Photograph, view: PlateView, plate: float, cloth: float) -> Outline:
    """Finds the cloth's outline.

    Args:
        photograph: The picture.
        view: The calibrated camera.
        plate: Radius of the plate [m].
        cloth: Radius of the flat cloth [m].

    Returns:
        The outline with its confidence.
    """
    picture = evenly_lit(polar_picture(photograph, view, plate, cloth))
    found = found_by_light(picture)
    curve, spread = read_outline(picture.plane, curve_of(found.radii), fitted_model())
    radii = outermost(curve)
    evidence = replace(
        _evidence(picture, found.ratio, found.edges, radii),
        **found.measures,
        expected_mm=float(1e3 * np.sqrt(2 * np.mean(spread**2))),
        reread_mm=float(1e3 * abs(np.mean(radii - found.radii))),
        off_circle_mm=1e3 * _off_circle(radii),
        burnt=_burnt(picture.plane, curve),
    )
    return Outline(radii, evidence, confidence(evidence))


def _off_circle(radii: Float[ndarray, " angles"]) -> float:
    """Root-mean-square deviation of an outline from a circle about a place near the axis [m]."""
    harmonics = np.fft.rfft(radii) / len(radii)
    return float(np.sqrt(2 * np.sum(np.abs(harmonics[2:]) ** 2)))


def _burnt(picture: PlanePicture, curve: Curve) -> float:
    """Share of an outline inside of which the photograph is white, so that nobody knows how bright the cloth is.

    The sensor's blur then lifts ground beside the rim to white as well, by more the brighter the cloth is.
    """
    places = curve[:, None] - np.arange(*_BESIDE)[:, None] * normals(curve)[:, None]
    light, _ = replace(picture, shading=np.zeros_like(picture.shading)).light_at(places)
    return float((np.median(light.min(axis=-1), axis=1) > linear_light(np.array(_WHITE))).mean())


def _span(picture: PolarPicture) -> slice:
    """Columns between which the outline lies."""
    return slice(picture.column(_LEAST * picture.plate), picture.column(_MOST * picture.cloth) + 1)


def _path(ratio: ndarray, edges: ndarray, span: slice, region: float, edge: float) -> ndarray:
    gain = np.cumsum(ratio, axis=1) * STEP * 1e3  # [mm] of places that are rightly inside
    cost = -2 * region * gain - edge * edges
    return closed_path(cost[:, span], _STIFFNESS) + span.start


def _steepness(picture: PolarPicture) -> float:
    """Ratio of the steepness of folds, in mm per angle, to that of the standard's plate and cloth; at least 1.

    They grow with the overhang over the plate's radius and with the size of the cloth. What is measured along the
    radius is divided by it: an outline that runs along the radius is neither ragged nor without an edge.
    """
    overhang = (picture.cloth - picture.plate) / picture.plate
    return max(1.0, overhang / (CLOTH_RADIUS / PLATE_RADIUS - 1) * picture.cloth / CLOTH_RADIUS)


def _evidence(picture: PolarPicture, ratio: ndarray, edges: ndarray, radii: ndarray) -> Evidence:
    """Evidence for an outline."""
    span, path = _span(picture), np.array([picture.column(radius) for radius in radii])
    alone = [_path(ratio, edges, span, *weights) for weights in ((_REGION, 0.15), (0.05, _EDGE))]
    row = np.arange(len(path))
    last = len(picture.radii) - 1

    def beside(step: ndarray | int) -> ndarray:
        return np.clip(path[:, None] + step, 0, last)

    strip = 2 + np.arange(1, round(4e-3 / STEP))
    sureness = np.concatenate([ratio[row[:, None], beside(-strip)], -ratio[row[:, None], beside(strip)]], axis=1)
    along = edges[row[:, None], beside(np.arange(-2, 3))].max(axis=1)
    columns = np.arange(edges.shape[1])[None]
    far = (np.abs(columns - path[:, None]) > 3e-3 / STEP) & (columns >= span.start) & (columns < span.stop)
    smooth = cv2.GaussianBlur(np.pad(radii, 8, mode="wrap").reshape(1, -1), (9, 1), 2.0)[0, 8:-8]
    return Evidence(
        edge=float(np.median(along)),
        weak_edge=float((along < _WEAK).mean()) / _steepness(picture),
        rival=float((np.where(far, edges, 0).max(axis=1) > along).mean()),
        colour=float((sureness > 0).mean()),
        undecided=float((np.abs(sureness) < 0.5).mean()),
        roughness_mm=float(1e3 * np.std(radii - smooth)) / _steepness(picture),
        at_limit=float(((path <= span.start + 1) | (path >= span.stop - 2)).mean()),
        unseen=float(1 - picture.seen[row, beside(8)[:, 0]].mean()),
        beyond_plate=float((np.median(radii) - picture.plate) / (picture.cloth - picture.plate)),
        disagreement_mm=float(1e3 * STEP * max(np.percentile(np.abs(path - other), 95) for other in alone)),
    )
