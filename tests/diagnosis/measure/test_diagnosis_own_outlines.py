"""What undoing a camera's error takes off a fabric's own outlines is what that error did to them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy import ndarray
from toy_atlas import statistics_of, toy_emulator, toy_outlines, with_planted

from cusick_bench.datasets import DrapeDataset, load
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.files.silhouette import camera_of, profile_of
from cusick_bench.diagnosis.atlas.base_model import PRIOR_MEAN
from cusick_bench.diagnosis.inference.residuals.feature_rows import MAY_BE_WRONG, MEANS
from cusick_bench.diagnosis.inference.residuals.samples import sample_statistics
from cusick_bench.diagnosis.inference.single_effects.hypotheses import Hypothesis, hypotheses, shifts
from cusick_bench.diagnosis.measure.captures import ANGLES, Captures, captures_from_profiles
from cusick_bench.diagnosis.measure.features import features
from cusick_bench.diagnosis.measure.own_outlines import OwnOutlines
from cusick_bench.diagnosis.measure.statistics import RESOLUTION, capture_statistics
from cusick_bench.sim.effects import effect
from cusick_bench.sim.render.silhouette import render

ANGLE = np.arange(ANGLES) * (2 * np.pi / ANGLES)
TURNED_OVER = (ANGLES // 2 - np.arange(ANGLES)) % ANGLES


@pytest.fixture(scope="module")
def plain() -> ndarray:
    """Outlines of six samples, up and down, in the cloth's frame [m]."""
    return toy_outlines(PRIOR_MEAN, 6, np.random.default_rng(0))


def seen(outlines: ndarray) -> Captures:
    """One capture of each face, as the camera sees it."""
    radii = np.stack([outlines[:, 0], outlines[:, 1][:, TURNED_OVER]], axis=1)
    return captures_from_profiles(
        radii.reshape(-1, ANGLES),
        sample=np.repeat(np.arange(1, len(outlines) + 1), 2),
        side=["up", "down"] * len(outlines),
        capture=np.ones(2 * len(outlines), dtype=int),
    )


@pytest.mark.parametrize(
    ("name", "severity", "direction"),
    [("camera-offset", 3e-3, 40.0), ("camera-offset", 1.5e-3, 250.0), ("camera-scale", -0.03, 0.0)],
)
def test_the_shift_is_what_the_error_did(plain: ndarray, name: str, severity: float, direction: float) -> None:
    wrong = with_planted(plain, name, {"shift": severity, "error": severity, "direction": direction})
    without, with_error = (features(statistics_of(one)) for one in (plain, wrong))
    expected = with_error.contrast - without.contrast
    angle = np.full((2, 1), np.deg2rad(direction))  # of the camera on both faces
    found = OwnOutlines(seen(wrong)).change(name, np.array([severity]), angle)
    apart = np.linalg.norm((found.contrast[0] - expected) / RESOLUTION)
    assert apart < 0.12 * np.linalg.norm(expected / RESOLUTION)
    if name == "camera-scale":  # all lengths scatter by as much more; toy outlines beside their place are interpolated
        assert np.ptp(found.spread[0]) > 0.02
        np.testing.assert_allclose(found.spread[0], with_error.spread - without.spread, atol=2e-3)


def test_captures_of_an_unknown_face_count_only_where_the_upper_one_is_missing(plain: ndarray) -> None:
    """As in a fabric's own statistics, from which the change is taken off."""
    known = seen(plain)
    upper = known.select(known.side == "up")
    severity, angle = np.array([3e-3]), np.zeros((2, 1))

    def change(*parts: Captures) -> ndarray:
        together = {
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in ("radii", "area", "sample", "side", "capture")
        }
        return OwnOutlines(replace(known, **together)).change("camera-offset", severity, angle).contrast

    unknown = replace(upper, side=np.full(len(upper), ""), radii=np.roll(upper.radii, 90, axis=1))
    np.testing.assert_array_equal(change(known, unknown), change(known))
    lower = known.select(known.side == "down")
    unknown = replace(upper, side=np.full(len(upper), ""))
    np.testing.assert_array_equal(change(unknown, lower), change(upper, lower))


def test_another_level_moves_an_outline_along_its_normal() -> None:
    radius, slope = 0.12 + 0.006 * np.cos(8 * ANGLE), -0.048 * np.sin(8 * ANGLE)
    along = (radius - 1j * slope) / np.hypot(radius, slope)  # the normal, from the ray's direction
    points = (radius + 1e-3 * along) * np.exp(1j * ANGLE)
    moved = np.interp(ANGLE, np.angle(points), np.abs(points), period=2 * np.pi)
    expected = (capture_statistics(moved[None]) - capture_statistics(radius[None]))[0]
    faces = np.stack([[moved, moved[TURNED_OVER]]] * 2)
    found = OwnOutlines(seen(faces)).change("threshold", np.array([1e-3]), None)
    apart = np.linalg.norm((found.contrast[0, 0] - expected) / RESOLUTION)
    assert apart < 0.12 * np.linalg.norm(expected / RESOLUTION)
    assert np.abs(found.contrast[0, 1] / RESOLUTION).max() < 0.05, "both faces are moved alike"


def test_many_directions_are_as_each_alone(plain: ndarray) -> None:
    outlines = OwnOutlines(seen(plain))
    degrees = np.arange(0.0, 360.0, 15.0)
    angles = np.deg2rad(np.stack([degrees, 180.0 - degrees]))
    many = outlines.change("camera-offset", np.full(len(degrees), 3e-3), angles)
    for place in (1, 10, 20):
        one = outlines.change("camera-offset", np.array([3e-3]), angles[:, [place]])
        apart = np.linalg.norm((many.contrast[place] - one.contrast[0]) / RESOLUTION)
        assert apart < 0.1 * np.linalg.norm(one.contrast[0] / RESOLUTION)


@pytest.mark.parametrize(("turn_over", "warp_seen"), [("about y", 180), ("about x", 0)])
def test_directions_of_the_laboratory_follow_how_the_cloth_is_turned_over(
    plain: ndarray, turn_over: str, warp_seen: int
) -> None:
    """The same pictures a camera gives that stands beside its place, of cloths turned over in either way."""
    offset = {"shift": 3e-3, "direction": 40.0}
    down = (warp_seen - np.arange(ANGLES)) % ANGLES
    pictures = np.stack([plain[:, 0], plain[:, 1][:, down]], axis=1)
    points = pictures * np.exp(1j * ANGLE) + offset["shift"] * np.exp(1j * np.deg2rad(offset["direction"]))
    beside = np.array(
        [[np.interp(ANGLE, np.angle(one), np.abs(one), period=2 * np.pi) for one in sample] for sample in points]
    )
    captures = replace(seen(plain), radii=beside.reshape(-1, ANGLES), protocol=Protocol(turn_over=turn_over))
    emulator = replace(toy_emulator(), outlines=OwnOutlines(captures))
    (hypothesis,) = (one for one in hypotheses(emulator) if one.name == "camera-offset" and one.frame == "lab")
    values = {name: np.array([value]) for name, value in offset.items()}
    found = shifts(emulator, hypothesis, PRIOR_MEAN, RESOLUTION, 0.0, values).features[0]
    shown = captures.cloth_frame().reshape(-1, 2, ANGLES)
    contrasts = [features(statistics_of(one)).contrast for one in (plain, shown)]
    expected = ((contrasts[1] - contrasts[0]) / RESOLUTION).ravel()
    assert np.linalg.norm(found[MEANS] - expected) < 0.12 * np.linalg.norm(expected)


@pytest.mark.parametrize(
    ("name", "value"), [("perspective", {"inverse_height": 2.0}), ("camera-scale", {"error": 0.03})]
)
def test_undoing_an_effect_that_keeps_all_symmetry_does_not_explain_noise(
    plain: ndarray, name: str, value: dict[str, float]
) -> None:
    """Stiff cloth under a near eye: without it folds are shallower, and so are the differences between samples."""
    emulator = replace(toy_emulator(), outlines=OwnOutlines(seen(plain)))
    values = {key: np.array([one]) for key, one in value.items()}
    found = shifts(emulator, Hypothesis(effect(name), "", 1.0), PRIOR_MEAN, RESOLUTION, 0.0, values).features[0]
    undone = (OwnOutlines(seen(plain)).change(name, *values.values(), None).contrast[0] / RESOLUTION).ravel()
    allowed = MAY_BE_WRONG[MEANS]
    assert np.abs(undone[~allowed]).max() > 0.1
    assert np.abs(found[~MAY_BE_WRONG]).max() == 0
    np.testing.assert_allclose(found[MEANS][allowed], undone[allowed])


@pytest.fixture(scope="module")
def drapes() -> DrapeDataset:
    """Meshes of the shipped cloths, three samples of each."""
    return load("synthetic").select(sample=[1, 2, 3])


def photographed(drapes: DrapeDataset, cloth: str, move: Callable[[ndarray], ndarray]) -> Captures:
    """Outlines of a cloth's meshes, their points moved before they are drawn."""
    rows = drapes.select(cloth=cloth)
    radii = []
    for row in range(len(rows)):
        mesh = rows.sample(row).mesh
        assert mesh is not None
        points = torch.from_numpy(move(np.array(mesh.vertices, dtype=np.float64)))
        picture = render(points, np.asarray(mesh.faces, dtype=np.int64), camera_of(drapes.protocol))
        radii.append(profile_of(picture.numpy(), drapes.protocol).radii)
    table = rows.table
    return captures_from_profiles(
        np.stack(radii),
        sample=table["sample"].to_numpy(),
        side=table["side"].tolist(),
        capture=table["capture"].to_numpy(),
    )


def near(points: ndarray) -> ndarray:
    """As an eye .7 m over the plate sees them."""
    return np.column_stack([points[:, :2] / (1 - points[:, 2:] / 0.7), points[:, 2]])


def leaning(points: ndarray) -> ndarray:
    """As a camera sees them whose axis leans by 4 deg along x."""
    x = points[:, 0] * np.cos(np.deg2rad(4)) + points[:, 2] * np.sin(np.deg2rad(4))
    return np.column_stack([x, points[:, 1:]])


@pytest.mark.parametrize(("name", "severity", "move"), [("perspective", 1 / 0.7, near), ("camera-tilt", 4.0, leaning)])
@pytest.mark.parametrize(
    ("cloth", "most"),
    [("fabric_1", 0.2), ("fabric_2", 0.13), ("fabric_3", 0.06), ("fabric_4", 0.06), ("fabric_5", 0.06)],
)
def test_what_hangs_on_depth_is_undone_without_knowing_it(
    drapes: DrapeDataset, cloth: str, most: float, name: str, severity: float, move: Callable[[ndarray], ndarray]
) -> None:
    plain, wrong = (photographed(drapes, cloth, one) for one in (np.copy, move))
    axis = np.zeros((2, 1))  # of the camera on both faces
    found = OwnOutlines(wrong).change(name, np.array([severity]), axis).contrast[0] / RESOLUTION
    zero = np.array([1e-9])
    without, with_error = (sample_statistics(one).features().contrast for one in (plain, wrong))
    expected = (with_error - without) / RESOLUTION
    assert np.linalg.norm(found - expected) < most * np.linalg.norm(expected)
    assert np.linalg.norm(OwnOutlines(wrong).change(name, zero, axis).contrast[0] / RESOLUTION) < 1e-3


def test_effects_of_the_cloth_are_not_undone(plain: ndarray) -> None:
    with pytest.raises(KeyError, match="'creep' does not act on the outline alone"):
        OwnOutlines(seen(plain)).change("creep", np.array([0.1]), None)
