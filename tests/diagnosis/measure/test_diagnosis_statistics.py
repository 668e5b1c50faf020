"""Statistics of the diagnosis, of drapes whose statistics are known."""

from math import pi, sqrt

import numpy as np
import pytest
from toy_cloths import draw

from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.profile import Profile, profile_from_image
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.inference.residuals.samples import sample_statistics
from cusick_bench.diagnosis.measure.captures import ANGLES, captures_from_profiles
from cusick_bench.diagnosis.measure.statistics import (
    GROUPS,
    LOCKED,
    NAMES,
    PHASE_FREE,
    RESOLUTION,
    capture_statistics,
    columns,
    mirrored,
    rotated,
    specimen_statistics,
)

THETA = np.arange(ANGLES) * (2 * pi / ANGLES)


def rings(generator, count, *, roughness=1.0):
    """Random closed profiles with folds and with everything that has an angle."""
    orders = np.arange(1, 15)
    size = 0.004 * roughness * np.exp(-(((orders - 7) / 4) ** 2)) + 0.0005
    harmonics = (generator.normal(size=(count, 14)) + 1j * generator.normal(size=(count, 14))) * size
    return 0.12 + np.real(harmonics @ np.exp(-1j * np.outer(orders, THETA)))


def statistic(values, name):
    return values[..., NAMES.index(name)]


def locked(values, name):
    return statistic(values, f"{name}_real") + 1j * statistic(values, f"{name}_imaginary")


def fabric(radii, sample, side, capture, **known):
    return captures_from_profiles(
        radii, sample=np.array(sample), side=np.array(side, dtype=str), capture=np.array(capture), **known
    )


def test_a_cloth_turned_over_about_y_is_seen_as_its_mirror_image():
    def cloth(angle):
        return 0.12 + 0.004 * np.cos(angle - 0.3) + 0.003 * np.cos(7 * angle - 1)

    seen = np.stack([cloth(THETA), cloth(pi - THETA), cloth(THETA)])
    sides = ["up", "down", ""]
    captures = fabric(seen, [1, 1, 1], sides, [1, 3, 5])
    assert captures.cloth_frame() == pytest.approx(np.stack([cloth(THETA)] * 3), abs=1e-15)
    about_x = fabric(np.stack([cloth(-THETA)]), [1], ["down"], [1], protocol=Protocol(turn_over="about the x axis"))
    assert about_x.cloth_frame()[0] == pytest.approx(cloth(THETA), abs=1e-15)


@pytest.mark.parametrize(
    ("words", "warp"),
    [("x", 0), ("X-axis", 0), ("the x axis", 0), ("around x", 0), ("", pi), ("y", pi), ("about y: x becomes -x", pi)],
)
def test_the_axis_about_which_a_cloth_is_turned_may_stand_alone(words, warp):
    seen = fabric(np.full((1, len(THETA)), 0.12), [1], ["down"], [1], protocol=Protocol(turn_over=words))
    assert seen.warp_seen_down == warp


def test_every_statistic_of_a_known_curve():
    radii = 0.12 + 0.01 * np.cos(8 * THETA - 1) + 0.003 * np.cos(2 * THETA - 0.5) + 0.001 * np.cos(14 * THETA)
    values = capture_statistics(radii[None])[0]
    assert values.shape == (len(NAMES),)
    assert statistic(values, "mean_radius") == pytest.approx(0.12)
    mean_square = 0.12**2 + (0.01**2 + 0.003**2 + 0.001**2) / 2
    assert statistic(values, "area_dc") == pytest.approx((mean_square - 0.09**2) / (0.15**2 - 0.09**2))
    assert statistic(values, "quantile_95") == pytest.approx(np.quantile(radii, 0.95) - 0.12)
    assert statistic(values, "amplitude_8") == pytest.approx(0.01)
    assert statistic(values, "amplitude_5") == pytest.approx(0, abs=1e-12)
    assert statistic(values, "amplitude_high") == pytest.approx(0.001)
    assert statistic(values, "folds") == 8
    assert 8 < statistic(values, "fold_centroid") < 9.1
    assert statistic(values, "fold_depth") == pytest.approx(sqrt((0.01**2 + 0.001**2) / 2))
    assert statistic(values, "roughness") == pytest.approx(sqrt((0.08**2 + 0.014**2) / 2))
    assert locked(values, "harmonic_2") == pytest.approx(0.003 * np.exp(0.5j))
    assert locked(values, "harmonic_1") == pytest.approx(0, abs=1e-12)


def test_envelope_says_where_folds_are_deep_whatever_their_phase():
    depth, where = 0.6, 0.8
    for phase in (0.0, 1.0, 2.5):
        folds = 0.01 * (1 + depth * np.cos(2 * (THETA - where))) * np.cos(9 * THETA - phase)
        shape = 0.12 + 0.005 * np.cos(2 * THETA - 0.1) + 0.004 * np.cos(THETA)  # no part of the folds
        values = capture_statistics((shape + folds)[None])[0]
        expected = 2 * depth / (1 + depth**2 / 2) * np.exp(2j * where)
        assert locked(values, "envelope_2") == pytest.approx(expected, rel=0.01)
        assert locked(values, "envelope_1") == pytest.approx(0, abs=1e-9)


def test_envelope_of_the_slope_weighs_orders_and_the_cube_knows_crests_from_valleys():
    shape = 0.12 + 0.004 * np.cos(THETA)
    few, many = (1 + np.cos(THETA - 0.8)) * np.cos(7 * THETA), (1 + np.cos(THETA + pi - 0.8)) * np.cos(14 * THETA)
    values = capture_statistics((shape + 0.004 * (few + many))[None])[0]  # as deep on both sides, steeper on one
    assert abs(locked(values, "envelope_1")) < 0.05
    expected = (7**2 - 14**2) / (7**2 + 14**2) * 4 / 3 * np.exp(0.8j)
    assert locked(values, "slope_envelope_1") == pytest.approx(expected, rel=0.05)
    narrow = np.exp(2 * np.cos(8 * THETA))
    crested = 0.004 * (narrow - narrow.mean()) * np.cos(THETA - 0.5)  # narrow crests here, narrow valleys there
    assert np.angle(locked(capture_statistics((shape + crested)[None])[0], "cubed_1")) == pytest.approx(0.5, abs=1e-6)


def between(valleys, crests, folds=9):
    """Statistics of a profile whose valleys and crests lie on two curves."""
    return capture_statistics((valleys + (crests - valleys) * (1 + np.cos(folds * THETA)) / 2)[None])[0]


def test_crests_and_valleys_are_told_apart():
    moved = 0.002 * np.cos(THETA - 0.4)
    plain, crests, valleys, both = (
        between(0.098 + moved * v, 0.13 + moved * c) for v, c in ((0, 0), (0, 1), (1, 0), (1, 1))
    )
    assert 0.12 < statistic(plain, "crest_radius") < 0.13
    assert 0.002 < statistic(plain, "valley_gap") - 0.008 < 0.006  # its smooth minimum lies above the minimum
    expected = 0.002 * np.exp(0.4j)
    for name in ("crest_1", "valley_1"):
        assert locked(both, name) == pytest.approx(expected, rel=0.02)
    for moved_one, own, other in ((crests, "crest_1", "valley_1"), (valleys, "valley_1", "crest_1")):
        assert np.real(locked(moved_one, own) / expected) > 0.5
        assert abs(locked(moved_one, other)) < 0.2 * abs(locked(moved_one, own))
    assert abs(locked(crests, "nearness_1")) < abs(locked(valleys, "nearness_1")) / 3
    assert np.angle(locked(valleys, "nearness_1")) == pytest.approx(0.4 - pi)  # opposite to the shift


def test_outline_beside_the_plate():
    limp, stiff = between(np.full(ANGLES, 0.091), np.full(ANGLES, 0.12)), between(0.12 + 0 * THETA, 0.14 + 0 * THETA)
    assert statistic(limp, "plate_nearness") > 0.1 > 0.001 > statistic(stiff, "plate_nearness")
    assert statistic(limp, "valley_gap") < 0.005 < 0.03 < statistic(stiff, "valley_gap")
    larger = capture_statistics(np.full((1, ANGLES), 0.1), Protocol(cloth_radius_m=0.15, plate_radius_m=0.095))[0]
    usual = capture_statistics(np.full((1, ANGLES), 0.1))[0]
    assert (statistic(usual, "valley_gap"), statistic(larger, "valley_gap")) == pytest.approx((0.01, 0.005))
    # A picture that misses half of the plate still has statistics of a moderate size.
    assert np.abs(capture_statistics(0.08 + 0.06 * np.cos(THETA)[None])).max() < 20


def test_skewnesses_change_their_sign_with_crests_and_valleys():
    narrow = np.exp(1.5 * np.cos(9 * THETA))
    folds = 0.005 * (narrow - narrow.mean())
    crested, valleyed = (capture_statistics((0.12 + sign * folds)[None])[0] for sign in (1, -1))
    for name in ("slope_skewness", "curvature_skewness"):
        assert statistic(crested, name) == pytest.approx(-statistic(valleyed, name), rel=1e-6)
    assert statistic(crested, "slope_skewness") > 0.1
    assert statistic(crested, "curvature_skewness") < -0.1
    assert statistic(valleyed, "valley_curvature") > statistic(crested, "valley_curvature") > 0


def test_folds_become_more_and_the_centroid_follows():
    values = capture_statistics(0.12 + 0.006 * np.cos(np.outer(np.arange(4, 14), THETA)))
    assert statistic(values, "folds").tolist() == list(range(4, 14))
    assert (np.diff(statistic(values, "fold_centroid")) > 0.7).all()


def test_a_cloth_without_folds_has_finite_statistics():
    values = capture_statistics(np.full((1, ANGLES), 0.15))[0]
    assert np.isfinite(values).all()
    assert statistic(values, "area_dc") == pytest.approx(1)
    assert statistic(values, "folds") == 0
    assert np.abs(values[list(columns(*LOCKED))]).max() < 1e-12
    assert statistic(values, "crest_radius") == pytest.approx(0.15)
    assert statistic(values, "valley_gap") == pytest.approx(0.06)
    assert np.abs(values[list(GROUPS["asymmetry"])]).max() < 1e-12
    # A trace of noise must not look like an opinion on where the folds are.
    noise = 0.12 + 2e-5 * np.random.default_rng(0).normal(size=(1, ANGLES))
    assert np.abs(capture_statistics(noise)[0, list(GROUPS["envelope"])]).max() < 0.01
    assert np.abs(capture_statistics(noise)[0, list(GROUPS["asymmetry"])]).max() < 0.01


def test_protocol_gives_the_radii():
    values = capture_statistics(np.full((1, ANGLES), 0.1), Protocol(cloth_radius_m=0.12, plate_radius_m=0.06))
    assert statistic(values, "area_dc")[0] == pytest.approx((0.1**2 - 0.06**2) / (0.12**2 - 0.06**2))


@pytest.mark.parametrize("degrees", [1, 37, 90, 200])
def test_turned_drapes(degrees):
    radii = rings(np.random.default_rng(1), 20)
    turned = capture_statistics(np.roll(radii, degrees, axis=1))
    assert turned == pytest.approx(rotated(capture_statistics(radii), np.radians(degrees)), abs=1e-11)
    assert turned[:, : len(PHASE_FREE)] == pytest.approx(capture_statistics(radii)[:, : len(PHASE_FREE)], abs=1e-11)
    each = np.radians(np.arange(20.0))
    one_by_one = np.stack([rotated(row, angle) for row, angle in zip(capture_statistics(radii), each, strict=True)])
    assert rotated(capture_statistics(radii), each) == pytest.approx(one_by_one, abs=1e-14)


def test_mirrored_drapes():
    radii = rings(np.random.default_rng(2), 20)
    captures = fabric(radii, [1] * 20, ["down"] * 20, range(20))
    seen = capture_statistics(captures.cloth_frame())
    assert seen == pytest.approx(mirrored(capture_statistics(radii)), abs=1e-11)
    assert mirrored(mirrored(seen)) == pytest.approx(seen, abs=1e-15)
    assert np.abs(mirrored(seen) - seen).max() > 1e-3


def test_groups_share_out_all_statistics():
    assert len(set(NAMES)) == len(NAMES) == len(RESOLUTION)
    assert sorted(column for group in GROUPS.values() for column in group) == list(range(len(NAMES)))


def test_profiles_that_have_no_statistics():
    with pytest.raises(DiagnosisError, match="finite"):
        capture_statistics(np.full((1, ANGLES), np.nan))
    with pytest.raises(DiagnosisError, match="angles"):
        capture_statistics(np.full((1, 20), 0.1))


def test_specimens_and_their_contrasts():
    size = np.array([0.120, 0.122, 0.126, 0.128, 0.110, 0.111, 0.113, 0.13])
    sample = [1, 1, 1, 1, 2, 2, 2, 3]
    side = ["up", "up", "down", "down", "up", "up", "up", "down"]
    capture = [2, 1, 3, 4, 1, 2, 3, 3]  # sample 1's first rows are out of order
    table = specimen_statistics(fabric(np.tile(size[:, None], ANGLES), sample, side, capture))
    assert table.samples.tolist() == [1, 2, 3]
    assert table.count.tolist() == [[2, 2, 0], [3, 0, 0], [0, 1, 0]]
    assert statistic(table.mean, "mean_radius")[0, :2] == pytest.approx([0.121, 0.127])
    assert statistic(table.face_odd, "mean_radius")[0] == pytest.approx(0.003)
    assert np.isnan(table.face_odd[1:]).all()
    # Up: capture 2 minus capture 1 is -2 mm; down: +2 mm.
    assert statistic(table.order_odd, "mean_radius")[:2] == pytest.approx([0.0, 0.003], abs=1e-12)
    assert np.isnan(table.order_odd[2]).all()
    assert statistic(table.mean[table.count > 0], "mean_radius") == pytest.approx([0.121, 0.127, 0.334 / 3, 0.13])


def test_samples_know_their_share_of_later_captures_and_take_an_unknown_face_for_a_missing_upper_one():
    size = np.array([0.120, 0.121, 0.122, 0.130, 0.110, 0.140, 0.115, 0.117])
    sample = [1, 1, 1, 1, 2, 2, 3, 3]
    side = ["up", "up", "up", "down", "up", "", "", ""]
    found = sample_statistics(fabric(np.tile(size[:, None], ANGLES), sample, side, [1, 2, 3, 4, 1, 2, 1, 2]))
    assert statistic(found.specimens, "mean_radius")[:, 0] == pytest.approx([0.121, 0.110, 0.116])
    assert statistic(found.specimens, "mean_radius")[0, 1] == pytest.approx(0.130)
    assert np.isnan(found.specimens[1:, 1]).all()
    assert found.later == pytest.approx((2 / 3 + 0 + 1 / 2) / 3), "two of three, none of one, one of two"


def test_what_belongs_to_the_camera_repeats_in_its_frame():
    ring = 0.12 + 0.004 * np.cos(THETA)  # the camera sees every drape moved towards +x
    captures = fabric(np.stack([ring, ring]), [1, 1], ["up", "down"], [1, 3])
    odd = {frame: specimen_statistics(captures, frame).face_odd[0] for frame in ("cloth", "camera")}
    assert locked(odd["cloth"], "harmonic_1") == pytest.approx(-0.004)
    assert np.abs(odd["camera"]).max() < 1e-12


def test_profiles_and_toy_images_agree_in_their_statistics():
    profile = Profile(0.12 + 0.008 * np.cos(7 * np.arange(720) * pi / 360 - 0.4))
    seen = profile_from_image(draw(profile), angles=ANGLES)
    difference = capture_statistics(seen.radii[None])[0] - capture_statistics(profile.radii[None, ::2])[0]
    assert (np.abs(difference) < RESOLUTION).all()
