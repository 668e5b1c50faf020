"""The network that reads outlines: what it is given, what it reads beside stripes, how it is fitted."""

from functools import cache

import numpy as np
import pytest
import torch

from cusick_bench.photographs.calibration.view import PlateView, Uncertainty
from cusick_bench.photographs.edge_fitting import bent, fit, offsets_to, view_of
from cusick_bench.photographs.reading import Photograph
from cusick_bench.photographs.segmentation.curve import curve_of, outermost, resampled
from cusick_bench.photographs.segmentation.edge_model import EdgeModel, fitted_model, read_outline
from cusick_bench.photographs.segmentation.plane import PlanePicture, plane_picture
from cusick_bench.photographs.segmentation.profiles import profiles
from cusick_bench.photographs.segmentation.refine import refined
from cusick_bench.photographs.studio.scene import make_laboratory

SCALE, MIDDLE, FINE = 2500.0, 450.0, 4  # [px/m], [px], drawn for each pixel
GROUND, DARK, LIGHT = (90, 110, 120), (60, 60, 65), (180, 170, 210)  # levels, blue first
TURN = np.arange(720) * 2 * np.pi / 720


def _true_radii(turn):
    return 0.12 + 0.012 * np.cos(6 * turn)


def _error(radii) -> float:
    """Root-mean-square error [m]."""
    return float(np.sqrt(np.mean((radii - _true_radii(TURN)) ** 2)))


@cache
def _picture(border: float) -> PlanePicture:
    """A light cloth with a dark stripe of some width [m] along its rim, blurred as by a lens."""
    place = ((np.arange(900 * FINE) + 0.5) / FINE - 0.5 - MIDDLE) / SCALE
    x, y = np.meshgrid(place, -place)
    inward = _true_radii(np.arctan2(y, x)) - np.hypot(x, y)
    levels = np.where((inward > border)[..., None], LIGHT, np.where((inward > 0)[..., None], DARK, GROUND))
    levels = levels.astype(np.float32).reshape(900, FINE, 900, FINE, 3).mean(axis=(1, 3))
    levels = _blurred(levels) + np.random.default_rng(0).normal(0, 1.5, levels.shape)
    rotation, matrix = np.diag([1.0, -1.0, -1.0]), np.array([[SCALE, 0, MIDDLE], [0, SCALE, MIDDLE], [0, 0, 1.0]])
    view = PlateView((900, 900), matrix, np.zeros(5), rotation, np.array([0, 0, 1.0]), Uncertainty(0, 0, 0, 0), "")
    return plane_picture(Photograph(np.clip(levels, 0, 255).astype(np.uint8), None), view, 0.17)


def _blurred(levels):
    for axis in (0, 1):
        levels = sum(share * np.roll(levels, step, axis) for step, share in ((-1, 0.2), (0, 0.6), (1, 0.2)))
    return levels


@pytest.mark.parametrize("off", [-0.8e-3, 0.6e-3])
def test_the_outline_of_plain_cloth_is_read(off):
    curve, spread = read_outline(_picture(0.0), curve_of(_true_radii(TURN) + off), fitted_model())
    assert _error(outermost(curve)) < 1.5e-4
    assert np.median(spread) < 2e-4


@pytest.mark.parametrize(("off", "most"), [(-0.4e-3, 0.25), (-0.8e-3, 0.5)])
def test_a_stripe_along_the_rim_is_read_as_cloth(off, most):
    """Halfway between the light of both sides lies at the stripe's inner border."""
    picture, start = _picture(1e-3), curve_of(_true_radii(TURN) + off)
    before = _error(refined(picture, start)[0])
    curve, _ = read_outline(picture, start, fitted_model())
    assert before > 1e-3
    assert _error(outermost(curve)) < most * before


def test_what_is_read_does_not_depend_on_the_exposure():
    picture = _picture(1e-3)
    bright = PlanePicture(picture.levels, picture.factor, picture.view, picture.reach, np.array([0.2, 0, 0, 0, 0, 0]))
    curve = resampled(curve_of(_true_radii(TURN)))
    assert profiles(bright, curve)[:, :-2] == pytest.approx(profiles(picture, curve)[:, :-2], abs=0.02)


def test_more_is_expected_to_be_wrong_where_there_is_no_edge():
    curve, far = resampled(curve_of(_true_radii(TURN))), resampled(curve_of(np.full(720, 0.155)))
    edge, nothing = (fitted_model().read(profiles(_picture(0.0), place))[1] for place in (curve, far))
    assert np.median(nothing) > 4 * np.median(edge)


def test_the_truth_is_measured_along_normals():
    curve = resampled(curve_of(np.full(720, 0.12)))
    assert offsets_to(np.full(720, 0.1207), curve) == pytest.approx(0.7e-3, abs=6e-5)
    assert np.isnan(offsets_to(np.full(720, 0.125), curve)).all()
    assert np.abs(outermost(bent(curve, np.random.default_rng(1))) - 0.12).max() < 8e-3


def test_the_view_of_a_known_camera_is_exact():
    camera = make_laboratory(5).camera
    points = np.array([[0.0, 0.0, 0.0], [0.1, 0.02, 0.0], [-0.05, 0.08, 0.0]])
    seen = view_of(camera).on_plane(camera.project(points))
    assert np.hypot(*seen.T) == pytest.approx(np.hypot(points[:, 0], points[:, 1]), abs=2e-6)


@pytest.mark.slow
def test_fitting_finds_a_place_and_its_error():
    generator = torch.Generator().manual_seed(1)
    contrast = torch.randn(3000, 1, generator=generator)
    features = torch.cat([0.1 * torch.randn(3000, 27, generator=generator), contrast, torch.zeros(3000, 1)], dim=1)
    noise = torch.where(contrast[:, 0] > 0, 0.05, 0.5) * torch.randn(3000, generator=generator)
    kept = fit(features, contrast[:, 0] + noise, 600, 0)
    model = EdgeModel(tuple((kept[f"weights{n}"], kept[f"offsets{n}"]) for n in range(3)))
    place, spread = model.read(features.numpy())
    assert 1e3 * place == pytest.approx(contrast[:, 0].numpy(), abs=0.6)
    assert np.median(spread[contrast[:, 0] < 0]) > 2 * np.median(spread[contrast[:, 0] > 0])
