"""Parts that find the outline: light of places, colours that are looked up, a curve that is moved to edges."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from scipy.spatial import KDTree

from cusick_bench.photographs.calibration.view import PlateView, Uncertainty
from cusick_bench.photographs.reading import Photograph, linear_light
from cusick_bench.photographs.segmentation.colour import Neighbours, colour_features
from cusick_bench.photographs.segmentation.confidence import ACCEPTED, doubts
from cusick_bench.photographs.segmentation.curve import curve_of, normals, outermost, resampled
from cusick_bench.photographs.segmentation.outline import find_outline
from cusick_bench.photographs.segmentation.plane import PlanePicture, brightness_terms, plane_picture
from cusick_bench.photographs.segmentation.refine import refined
from cusick_bench.photographs.segmentation.snap import snapped

SCALE = 2500.0  # [px/m]
MIDDLE = (450.0, 450.0)  # [px]
GROUND, DARK, LIGHT = (90, 110, 120), (40, 40, 45), (180, 170, 210)  # levels, blue first
TURN = np.arange(720) * 2 * np.pi / 720


def _view():
    rotation = np.diag([1.0, -1.0, -1.0])
    matrix = np.array([[SCALE, 0, MIDDLE[0]], [0, SCALE, MIDDLE[1]], [0, 0, 1.0]])
    return PlateView((900, 900), matrix, np.zeros(5), rotation, np.array([0, 0, 1.0]), Uncertainty(0, 0, 0, 0), "")


def _true_radii(turn):
    return 0.12 + 0.012 * np.cos(6 * turn)


@cache
def _dotted_cloth() -> PlanePicture:
    """A cloth with six folds and dark dots, drawn four times as fine as its pixels."""
    fine = (np.arange(3600) + 0.5) / 4 - 0.5
    x, y = np.meshgrid((fine - MIDDLE[0]) / SCALE, (MIDDLE[1] - fine) / SCALE)
    inside = np.hypot(x, y) < _true_radii(np.arctan2(y, x))
    dot = np.hypot((x / 0.012) % 1 - 0.5, (y / 0.012) % 1 - 0.5) < 0.3
    levels = np.where(inside[..., None], np.where(dot[..., None], DARK, LIGHT), GROUND).astype(np.float32)
    levels = levels.reshape(900, 4, 900, 4, 3).mean(axis=(1, 3)) + np.random.default_rng(0).normal(0, 1, (900, 900, 3))
    return plane_picture(Photograph(np.clip(levels, 0, 255).astype(np.uint8), None), _view(), 0.17)


def _features(*levels):
    return colour_features(linear_light(np.array(levels, float)))


def _known() -> Neighbours:
    cloth, ground = np.repeat(_features(DARK, LIGHT), 5, axis=0), np.repeat(_features(GROUND), 5, axis=0)
    return Neighbours(KDTree(cloth), KDTree(ground))


def test_light_is_looked_up_where_it_lies_and_shading_is_taken_off():
    levels = np.full((900, 900, 3), 50, np.uint8)
    levels[:, 450:] = 200
    picture = plane_picture(Photograph(levels, None), _view(), 0.17)
    places = np.array([[[0.05, 0.01], [-0.05, 0.01], [0.5, 0.0]]])
    light, seen = picture.light_at(places)
    assert light[0, :2, 0] == pytest.approx(linear_light(np.array([200, 50])), rel=1e-5)
    assert seen.tolist() == [[True, True, False]]
    shading = np.array([0, 0.3, -0.2, 0.1, 0, 0.4])
    darker, _ = replace(picture, shading=shading).light_at(places)
    surface = brightness_terms(*np.moveaxis(places / 0.17, -1, 0)) @ shading
    assert darker == pytest.approx(light / np.exp(surface)[..., None], rel=1e-4)


def test_places_of_one_colour_are_looked_up_once_and_told_apart():
    generator = np.random.default_rng(1)
    which = generator.integers(0, 3, (40, 30))
    features = _features(DARK, LIGHT, GROUND)[which]
    ratio, strange = _known().judged(features)
    assert ratio.shape == which.shape
    assert ((ratio > 0) == (which < 2)).all()
    assert not strange.any()
    assert _known().judged(features + np.array([0.0, 40.0, 0.0]))[1].all()


def test_a_curve_has_even_points_and_normals_outwards():
    curve = curve_of(_true_radii(TURN))
    steps = np.linalg.norm(np.roll(curve, -1, axis=0) - curve, axis=1)
    assert steps == pytest.approx(5e-4, rel=0.02)
    assert (np.einsum("pi,pi->p", normals(curve), curve) > 0).all()
    assert outermost(resampled(curve)) == pytest.approx(_true_radii(TURN), abs=3e-5)


@pytest.mark.parametrize("off", [-2e-3, 1.5e-3])
def test_a_curve_beside_dotted_cloth_is_moved_to_its_rim(off):
    picture = _dotted_cloth()
    curve, strength = snapped(picture, _known(), curve_of(_true_radii(TURN) + off))
    assert np.sqrt(np.mean((outermost(curve) - _true_radii(TURN)) ** 2)) < 2.5e-4
    assert (strength > 1.2).mean() > 0.97
    radii, missing, width = refined(picture, curve)
    assert np.sqrt(np.mean((radii - _true_radii(TURN)) ** 2)) < 2e-4
    assert missing < 0.03
    assert width < 1.5e-3


def _steep_radii(turn):
    """Deep folds of a limp cloth on a small plate."""
    return 0.085 + 0.015 * np.tanh(2.5 * np.sin(7 * turn))


def test_steep_folds_on_a_small_plate_are_not_ragged():
    """Their outline runs along the radius, as it does not on the standard's plate."""
    fine = (np.arange(3600) + 0.5) / 4 - 0.5
    x, y = np.meshgrid((fine - MIDDLE[0]) / SCALE, (MIDDLE[1] - fine) / SCALE)
    inside = np.hypot(x, y) < _steep_radii(np.arctan2(y, x))
    levels = np.where(inside[..., None], np.array(LIGHT), GROUND).astype(np.float32)
    levels = levels.reshape(900, 4, 900, 4, 3).mean(axis=(1, 3)) + np.random.default_rng(0).normal(0, 1, (900, 900, 3))
    picture = Photograph(np.clip(levels, 0, 255).astype(np.uint8), None)
    found = find_outline(picture, _view(), plate=0.055, cloth=0.145)
    assert 1e3 * np.mean(found.radii - _steep_radii(TURN)) == pytest.approx(0, abs=0.05)
    assert found.confidence > ACCEPTED
    smaller = find_outline(picture, _view(), plate=0.055, cloth=0.110)  # of which such folds would be odd
    assert smaller.confidence < ACCEPTED
    assert smaller.evidence.roughness_mm > 2 * found.evidence.roughness_mm


@pytest.mark.parametrize(("plate", "cloth"), [(0.09, 0.15), (0.09, 0.12), (0.12, 0.15)])
def test_limp_cloth_is_no_bare_plate_whatever_its_overhang(plate, cloth):
    """Two limp drapes of one shape, the one of 24 cm (the standard's for limp cloth), which was asked for a cloth."""

    def limp(x, y):
        return np.hypot(x, y) < plate + (cloth - plate) * (0.15 + 0.12 * np.cos(7 * np.arctan2(y, x)))

    def bare(x, y):
        return np.hypot(x, y) < plate

    for inside, lies in ((limp, 0.15), (bare, 0.0)):
        picture = _levels(inside, (0.4, 0.4, 0.4), lambda x, y: np.full(x.shape, 0.04))
        found = find_outline(picture, _view(), plate=plate, cloth=cloth)
        assert found.evidence.beyond_plate == pytest.approx(lies, abs=0.015)
        assert ("is there a cloth?" in "; ".join(doubts(found.evidence))) == (inside is bare)
        assert (found.confidence > ACCEPTED) == (inside is limp)


def _levels(inside, cloth, outside, blur=1.0):
    """A photograph of flat colours, drawn four times as fine as its pixels; light adds up, and is cut off at white."""
    fine = (np.arange(3600) + 0.5) / 4 - 0.5
    x, y = np.meshgrid((fine - MIDDLE[0]) / SCALE, (MIDDLE[1] - fine) / SCALE)
    light = np.where(inside(x, y)[..., None], np.array(cloth), outside(x, y)[..., None]).astype(np.float32)
    light = light.reshape(900, 4, 900, 4, 3).mean(axis=(1, 3))
    light = cv2.GaussianBlur(light, (0, 0), blur)
    levels = 255 * np.clip(light, 0, 1) ** (1 / 2.2) + np.random.default_rng(0).normal(0, 1, light.shape)
    return Photograph(np.clip(levels, 0, 255).astype(np.uint8), None)


def _cloth(x, y):
    return np.hypot(x, y) < _true_radii(np.arctan2(y, x))


def test_a_paper_ring_under_pale_cloth_is_not_taken_for_the_cloth():
    """The ring that is weighed in the classical test has the size of the flat cloth: a drape coefficient of 100 %."""
    ring = _levels(_cloth, (0.6, 0.6, 0.6), lambda x, y: np.where(np.hypot(x, y) < 0.15, 0.95, 0.04))
    found = find_outline(ring, _view(), plate=0.09, cloth=0.15)
    assert found.radii == pytest.approx(np.full(720, 0.15), abs=5e-4)  # or the test tries nothing
    assert found.confidence < ACCEPTED
    assert "a paper ring" in "; ".join(doubts(found.evidence))


def test_an_overexposed_cloth_is_not_taken_for_a_larger_one():
    """White cloth that burns out blooms over its rim, on all sides alike, and its edge is as sharp as any."""
    burnt = _levels(_cloth, (3.5, 3.5, 3.5), lambda x, y: np.full(x.shape, 0.04), blur=2.0)
    found = find_outline(burnt, _view(), plate=0.09, cloth=0.15)
    assert np.mean(found.radii - _true_radii(TURN)) > 6e-4  # or the test tries nothing
    assert found.confidence < ACCEPTED
    assert doubts(found.evidence) == ("the cloth is overexposed along 100% of it, and looks larger than it is",)


def test_an_edge_that_is_wide_for_its_shape_is_not_read_too_far_out():
    """The network takes the blur of a clean edge for the shade of a rim that hangs, and adds .8 mm all around."""
    blurred = _levels(_cloth, (0.8, 0.8, 0.8), lambda x, y: np.full(x.shape, 0.03), blur=1.7)
    found = find_outline(blurred, _view(), plate=0.09, cloth=0.15)
    assert np.mean(found.radii - _true_radii(TURN)) > 6e-4  # or the test tries nothing
    assert found.confidence < ACCEPTED
    assert "light and network differ" in "; ".join(doubts(found.evidence))
