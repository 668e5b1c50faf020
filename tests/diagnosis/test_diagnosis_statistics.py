"""Statistics, energy distance, floors and resampling of the diagnosis, against answers that are known."""

from math import erf, exp, pi, sqrt

import numpy as np
import pytest
from jaxtyping import TypeCheckError
from toy_cloths import draw, toy_profile, write_image, write_toy

from cusick_bench.datasets import load
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.profile import Profile, drape_coefficient, profile_from_image
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.measure.captures import ANGLES, captures_from_profiles, read_captures
from cusick_bench.diagnosis.measure.energy import Standardisation, energy_by_group
from cusick_bench.diagnosis.measure.floors import repeat_floor, split_half_floor, spread_by_level
from cusick_bench.diagnosis.measure.resampling import (
    bootstrap_distance,
    bootstrap_rows,
    bootstrap_weights,
    halves_by_cluster,
    sign_flip_test,
    two_sample_test,
)
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
from cusick_bench.metrics.energy import cluster_distances, energy_distance
from cusick_bench.metrics.errors import MetricError

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


# Captures


def test_a_cloth_turned_over_about_y_is_seen_as_its_mirror_image():
    def cloth(angle):
        return 0.12 + 0.004 * np.cos(angle - 0.3) + 0.003 * np.cos(7 * angle - 1)

    seen = np.stack([cloth(THETA), cloth(pi - THETA), cloth(THETA)])
    sides = ["up", "down", ""]
    captures = fabric(seen, [1, 1, 1], sides, [1, 3, 5])
    assert captures.cloth_frame() == pytest.approx(np.stack([cloth(THETA)] * 3), abs=1e-15)
    about_x = fabric(np.stack([cloth(-THETA)]), [1], ["down"], [1], protocol=Protocol(turn_over="about the x axis"))
    assert about_x.cloth_frame()[0] == pytest.approx(cloth(THETA), abs=1e-15)


def test_profiles_of_more_angles_are_taken_at_whole_degrees():
    fine = 0.12 + 0.004 * np.cos(np.arange(720) * pi / 360 - 0.3)
    captures = fabric(fine[None], [1], ["up"], [1])
    assert captures.radii[0] == pytest.approx(0.12 + 0.004 * np.cos(THETA - 0.3), abs=1e-15)
    assert captures.area[0] == pytest.approx(pi * (0.12**2 + 0.004**2 / 2))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radii": np.full((2, 100), 0.1)}, "multiple of 360"),
        ({"radii": np.zeros((2, ANGLES))}, "> 0 m"),
        ({"radii": np.full((2, ANGLES), np.nan)}, "finite"),
        ({"side": ["up", "front"]}, "front"),
        ({"sample": np.array([1])}, "sample"),
    ],
)
def test_captures_that_cannot_be(change, message):
    usual = {"radii": np.full((2, ANGLES), 0.1), "sample": np.array([1, 2]), "side": ["up", "up"]}
    with pytest.raises((DiagnosisError, TypeCheckError), match=message):  # whichever looks first
        captures_from_profiles(**{**usual, "capture": np.array([1, 1]), **change})


def toy_folder(tmp_path, **shape):
    root = write_toy(tmp_path / "toy", meshes=False, **shape)
    return root, root / "data" / "Fabric 7" / "silhouettes"


def test_captures_are_read_with_their_labels(tmp_path):
    root, _ = toy_folder(tmp_path, samples=3)
    dataset = load(root)
    captures = read_captures(dataset, "fabric_7")
    assert (len(captures), captures.notes) == (12, ())
    assert captures.sample.tolist() == [1] * 4 + [2] * 4 + [3] * 4
    assert captures.side.tolist() == ["up", "up", "down", "down"] * 3
    assert captures.capture.tolist() == [1, 2, 3, 4] * 3
    truth = toy_profile(7, 2, 3).radii[::2]
    assert captures.radii[6] == pytest.approx(truth, abs=5e-4)
    image = dataset.image(6).numpy()
    assert captures.area[6] == pytest.approx(pi * 0.09**2 + drape_coefficient(image) * pi * (0.15**2 - 0.09**2))
    # What the profile says of the area is what the image says.
    assert statistic(capture_statistics(captures.radii), "area_dc")[6] == pytest.approx(
        drape_coefficient(image), abs=1e-3
    )


def test_single_slips_are_left_out_and_said(tmp_path):
    root, folder = toy_folder(tmp_path, samples=4)
    (folder / "Fabric_7_Sample_1_Capture_1.png").write_bytes(b"no image")
    write_image(folder / "Fabric_7_Sample_2_Capture_4.png", draw(toy_profile(7, 2, 4), centre=(90.0, 127.5)))
    captures = read_captures(load(root), "fabric_7")
    assert len(captures) == 14
    assert not ((captures.sample == 2) & (captures.capture == 4)).any()
    notes = "\n".join(captures.notes)
    assert "Sample_1_Capture_1.png" in notes
    assert "Sample_2_Capture_4.png: off-centre" in notes


def test_what_all_images_share_is_no_slip(tmp_path):
    root, folder = toy_folder(tmp_path, samples=3)
    for path in sorted(folder.iterdir()):
        sample, capture = int(path.stem.split("_")[3]), int(path.stem.split("_")[5])
        write_image(path, draw(toy_profile(7, sample, capture), centre=(102.0, 127.5)))
    captures = read_captures(load(root), "fabric_7")
    assert len(captures) == 12
    assert captures.notes == ("12 of 12 images are off-centre, but like the others; kept",)


def test_the_tail_of_a_wide_spread_is_no_slip(tmp_path):
    root, folder = toy_folder(tmp_path, samples=5)
    for sample, column in zip(range(1, 6), (105.0, 115.0, 127.5, 140.0, 150.0), strict=True):  # 127.5 is the axis
        for capture in range(1, 5):
            path = folder / f"Fabric_7_Sample_{sample}_Capture_{capture}.png"
            write_image(path, draw(toy_profile(7, sample, capture), centre=(column, 127.5)))
    captures = read_captures(load(root), "fabric_7")
    assert len(captures) == 20
    assert "off-centre, but like the others" in captures.notes[0]


def test_a_fabric_without_a_usable_image_is_refused(tmp_path):
    root, folder = toy_folder(tmp_path, samples=2)
    dataset = load(root)
    for path in folder.iterdir():
        path.write_bytes(b"no image")
    with pytest.raises(DiagnosisError, match="no silhouette of fabric_7 can be used"):
        read_captures(dataset, "fabric_7")


def test_unknown_faces_are_said(tmp_path):
    root, folder = toy_folder(tmp_path, samples=2)
    (root / "protocol.json").write_text('{"captures": {"1": "up", "2": "up", "3": "", "4": ""}}')
    assert any("face of 4 of 8 images is unknown" in note for note in read_captures(load(root), "fabric_7").notes)
    assert folder.is_dir()


# Statistics


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
    assert statistic(table.face_even, "mean_radius")[0] == pytest.approx(0.124)
    assert statistic(table.face_odd, "mean_radius")[0] == pytest.approx(0.003)
    assert np.isnan(table.face_odd[1:]).all()
    # Up: capture 2 minus capture 1 is -2 mm; down: +2 mm.
    assert statistic(table.order_odd, "mean_radius")[:2] == pytest.approx([0.0, 0.003], abs=1e-12)
    assert np.isnan(table.order_odd[2]).all()
    assert table.specimen_sample.tolist() == [1, 1, 2, 3]
    assert statistic(table.specimens, "mean_radius") == pytest.approx([0.121, 0.127, 0.334 / 3, 0.13])


def test_what_belongs_to_the_camera_repeats_in_its_frame():
    ring = 0.12 + 0.004 * np.cos(THETA)  # the camera sees every drape moved towards +x
    captures = fabric(np.stack([ring, ring]), [1, 1], ["up", "down"], [1, 3])
    odd = {frame: specimen_statistics(captures, frame).face_odd[0] for frame in ("cloth", "camera")}
    assert locked(odd["cloth"], "harmonic_1") == pytest.approx(-0.004)
    assert np.abs(odd["camera"]).max() < 1e-12


# Energy distance


def clusters(generator, count, repeats, *, shift=0.0, numbers=3, correlation=0.95):
    """Vectors of samples whose captures follow each other as a first-order autoregression; and their labels."""
    values = np.zeros((count, repeats, numbers))
    values[:, 0] = generator.normal(size=(count, numbers))
    for i in range(1, repeats):
        fresh = generator.normal(size=(count, numbers))
        values[:, i] = correlation * values[:, i - 1] + sqrt(1 - correlation**2) * fresh
    return values.reshape(-1, numbers) + shift, np.repeat(np.arange(count), repeats)


@pytest.mark.parametrize("shared", [False, True])
def test_energy_distance_is_what_its_definition_says(shared):
    generator = np.random.default_rng(3)
    first, second = generator.normal(size=(9, 2)), generator.normal(size=(7, 2))
    own, other = np.array([0, 0, 1, 1, 1, 2, 3, 3, 4]), np.array([2, 2, 5, 0, 0, 6, 6])

    def mean(a, b, a_label, b_label, alone):
        terms = [
            np.linalg.norm(x - y)
            for x, p in zip(a, a_label, strict=True)
            for y, q in zip(b, b_label, strict=True)
            if alone or p != q
        ]
        return np.mean(terms)

    expected = 2 * mean(first, second, own, other, not shared)
    expected -= mean(first, first, own, own, False) + mean(second, second, other, other, False)
    assert energy_distance(first, second, own, other, shared=shared) == pytest.approx(expected, rel=1e-12)


def test_energy_distance_of_shifted_normals():
    generator = np.random.default_rng(4)
    first, second = generator.normal(size=(1500, 1)), generator.normal(size=(1500, 1)) + 1.0
    across = 2 / sqrt(pi) * exp(-0.25) + erf(0.5)  # mean |N(1, 2)|
    assert energy_distance(first, second) == pytest.approx(2 * across - 4 / sqrt(pi), rel=0.1)


def test_pairs_within_a_cluster_would_bias_it():
    generator = np.random.default_rng(5)
    kept, naive = [], []
    for _ in range(400):
        (first, own), (second, other) = (clusters(generator, 6, 3) for _ in range(2))
        kept.append(energy_distance(first, second, own, other))
        naive.append(energy_distance(first, second))
    error = np.std(kept) / sqrt(len(kept))
    assert abs(np.mean(kept)) < 3 * error
    assert np.mean(naive) > 10 * error


def test_shared_samples_are_not_compared_between_the_sets():
    generator = np.random.default_rng(6)
    found = []
    for _ in range(400):
        both = generator.normal(size=(8, 2))
        noisy = both + 0.3 * generator.normal(size=both.shape)
        again, labels = both + 0.3 * generator.normal(size=both.shape), np.arange(8)
        found.append(energy_distance(again, noisy, labels, labels, shared=True))
    assert abs(np.mean(found)) < 3 * np.std(found) / sqrt(len(found))


def test_distances_do_not_depend_on_units():
    generator = np.random.default_rng(7)
    first, second = generator.normal(size=(10, 4)), generator.normal(size=(12, 4)) + 0.5
    unit = np.array([1.0, 1e-3, 50.0, 2.0])
    plain, scaled = Standardisation.of_scales(np.ones(4)), Standardisation.of_scales(unit)
    expected = energy_distance(plain.apply(first), plain.apply(second))
    assert energy_distance(scaled.apply(first * unit), scaled.apply(second * unit)) == pytest.approx(expected)


def test_whitening_takes_correlations_off_and_is_safe_with_few_samples():
    generator = np.random.default_rng(8)
    mixing = np.array([[1.0, 0, 0], [0.6, 0.8, 0], [0, 0, 0.01]])
    many = generator.normal(size=(4000, 3)) @ mixing.T
    standard = Standardisation.of_spread(many, np.arange(4000), np.full(3, 1e-6), correlated=True)
    assert np.cov(standard.apply(many).T) * 3 == pytest.approx(np.eye(3), abs=0.15)
    assert np.linalg.eigvalsh(standard.covariance).min() > 0
    few = generator.normal(size=(6, 20)) @ generator.normal(size=(20, 20))
    small = Standardisation.of_spread(few, np.arange(6), np.full(20, 1e-6), correlated=True)
    assert np.linalg.cond(small.covariance) < 1e4
    assert np.isfinite(small.apply(few)).all()


def test_scales_are_of_samples_and_not_below_the_resolution():
    values = np.array([[0.0, 5.0], [2.0, 5.0], [10.0, 5.0], [12.0, 5.0]])
    standard = Standardisation.of_spread(values, np.array([1, 1, 2, 2]), np.array([0.1, 0.1]))
    assert np.sqrt(np.diag(standard.covariance)) == pytest.approx([sqrt(50), 0.1])
    with pytest.raises(DiagnosisError, match="at least 2 samples"):
        Standardisation.of_spread(values, np.ones(4, dtype=int), np.array([0.1, 0.1]))


def test_a_change_of_one_group_shows_in_that_group_alone():
    generator = np.random.default_rng(9)
    first, second = (capture_statistics(rings(generator, 300)) for _ in range(2))
    standard = Standardisation.of_spread(first, np.arange(300), RESOLUTION)
    second[:, NAMES.index("folds")] += 2
    found = energy_by_group(first, second, standard, GROUPS)
    assert found["number"] > 0.1
    assert max(abs(value) for name, value in found.items() if name != "number") < 0.02


def test_sets_without_an_energy_distance():
    with pytest.raises(MetricError, match="finite"):
        energy_distance(np.full((3, 2), np.nan), np.zeros((3, 2)))
    with pytest.raises((MetricError, TypeCheckError), match=r"same statistics|second"):  # whichever looks first
        energy_distance(np.zeros((3, 2)), np.zeros((3, 1)))
    with pytest.raises(MetricError, match="vectors"):
        energy_distance(np.zeros((0, 2)), np.zeros((3, 2)))
    assert np.isnan(energy_distance(np.zeros((3, 2)), np.ones((2, 2)), np.zeros(3, dtype=int)))


# Tests that keep samples together


def rejections(generator, *, clustered, repeats=3, shift=0.0, runs=300):
    count = 0
    for _ in range(runs):
        (first, own), (second, other) = (clusters(generator, 6, repeats, shift=s) for s in (0.0, shift))
        labels = (own, other) if clustered else (None, None)
        count += two_sample_test(cluster_distances(first, second, *labels), generator, 199) <= 0.05
    return count / runs


def test_repeats_taken_for_independent_are_rejected_and_clusters_hold_their_level():
    generator = np.random.default_rng(10)
    assert rejections(generator, clustered=False) > 0.3
    assert 0.015 < rejections(generator, clustered=True) < 0.09
    assert rejections(generator, clustered=True, shift=2.0, runs=60) > 0.8


def test_a_sample_in_both_sets_is_no_two_sample_test():
    generator, values = np.random.default_rng(11), np.random.default_rng(0).normal(size=(4, 2))
    shared = cluster_distances(values, values, np.arange(4), np.arange(4), shared=True)
    with pytest.raises(DiagnosisError, match="one set only"):
        two_sample_test(shared, generator)
    with pytest.raises(DiagnosisError, match="at least 2 samples"):
        two_sample_test(cluster_distances(values, values, np.zeros(4, dtype=int)), generator)


def test_sign_flips_hold_the_family_wise_level():
    generator = np.random.default_rng(12)
    mixing = generator.normal(size=(15, 15)) / 4
    rejected = 0
    for _ in range(400):
        spread = generator.gamma(1.0, size=(10, 1))  # samples need not be alike
        rejected += sign_flip_test(spread * (generator.normal(size=(10, 15)) @ mixing), generator, 400).p <= 0.05
    assert 0.015 < rejected / 400 < 0.085


def test_sign_flips_find_the_contrast_that_is_there():
    generator = np.random.default_rng(13)
    contrasts = generator.normal(size=(12, 20))
    contrasts[:, 4] += 3
    contrasts[3] = np.nan
    found = sign_flip_test(contrasts, generator)
    assert found.samples == 11
    assert found.p == pytest.approx(2 / 2**11)  # all flips tried: the data and their negative
    assert found.each[4] == found.p
    assert (np.delete(found.each, 4) > 0.05).all()
    known = np.delete(contrasts, 3, axis=0)
    assert found.t == pytest.approx(known.mean(0) / known.std(0, ddof=1) * sqrt(11))


def test_sign_flips_of_many_samples_are_drawn_and_never_certain():
    contrasts = np.random.default_rng(14).normal(size=(40, 2)) + 5
    assert sign_flip_test(contrasts, np.random.default_rng(0), 99).p == pytest.approx(0.01)
    constant = sign_flip_test(np.zeros((6, 2)), np.random.default_rng(0))
    assert (constant.p, constant.t.tolist()) == (1.0, [0.0, 0.0])
    with pytest.raises(DiagnosisError, match="at least 2 samples"):
        sign_flip_test(np.array([[1.0], [np.nan]]), np.random.default_rng(0))


def test_bootstrap_by_cluster_has_the_spread_of_new_samples():
    generator = np.random.default_rng(15)
    fresh, drawn = [], []
    for i in range(200):
        (first, own), (second, other) = (clusters(generator, 15, 2, shift=s) for s in (0.0, 1.5))
        pooled = cluster_distances(first, second, own, other)
        fresh.append(pooled.observed)
        if i < 20:
            drawn.append(bootstrap_distance(pooled, generator, 300).std())
    assert np.mean(drawn) == pytest.approx(np.std(fresh), rel=0.2)


def test_bootstrap_of_one_set_leaves_the_other_as_it_is():
    generator = np.random.default_rng(22)
    pooled = cluster_distances(np.ones((8, 2)), generator.normal(size=(20, 2)))
    assert bootstrap_distance(pooled, generator, 50, both=False) == pytest.approx(np.full(50, pooled.observed))
    assert bootstrap_distance(pooled, generator, 50).std() > 0.05 * pooled.observed


def test_permutations_keep_the_sizes_of_the_sets():
    """With sets of 2 and 3 samples, well apart, 1 of 10 ways to deal them is as extreme."""
    pooled = cluster_distances(np.array([[0.0], [0.1]]), np.array([[5.0], [5.1], [5.3]]))
    assert two_sample_test(pooled, np.random.default_rng(0), 4999) == pytest.approx(0.1, abs=0.02)


def test_bootstrap_draws_whole_clusters():
    generator, labels = np.random.default_rng(16), np.array([7, 7, 3, 3, 3, 9])
    for _ in range(20):
        rows, draw_of = bootstrap_rows(labels, generator)
        assert len(np.unique(draw_of)) == 3
        for number in range(3):
            own = rows[draw_of == number]
            assert len(set(labels[own])) == 1
            assert len(own) == np.count_nonzero(labels == labels[own[0]])
    weights = bootstrap_weights(5, generator, 2000)
    assert (weights.sum(1) == 5).all()
    assert weights.mean(0) == pytest.approx(np.ones(5), abs=0.1)


def test_same_generator_same_answer():
    first, own = clusters(np.random.default_rng(17), 6, 2)
    pooled = cluster_distances(first, first + 0.3, own, own)
    answers = [two_sample_test(pooled, np.random.default_rng(1)) for _ in range(2)]
    assert answers[0] == answers[1]


# Floors


def test_split_halves_lie_apart_by_nothing_on_average():
    generator = np.random.default_rng(18)
    floors, naive = [], []
    for _ in range(60):
        values, labels = clusters(generator, 12, 2)
        floors.append(split_half_floor(values, labels, generator, 200))
        naive.append(split_half_floor(values, np.arange(24), generator, 200).std())
    assert abs(np.mean(floors)) < 0.01
    assert np.mean([floor.std() for floor in floors]) > 1.3 * np.mean(naive)
    scaled = split_half_floor(values, labels, np.random.default_rng(0), 50, versus=12)
    assert scaled == pytest.approx(split_half_floor(values, labels, np.random.default_rng(0), 50) / 2)
    with pytest.raises(DiagnosisError, match="at least 4 samples"):
        split_half_floor(values[:6], labels[:6], generator)


def test_split_half_floor_scaled_to_a_simulation_is_the_floor_of_a_gap_that_is_none():
    generator = np.random.default_rng(19)
    gaps, floors = [], []
    for _ in range(150):
        (values, labels), (simulated, _) = clusters(generator, 12, 2), clusters(generator, 60, 1)
        gaps.append(energy_distance(values, simulated, labels))
        floors.append(split_half_floor(values, labels, generator, 100, versus=60).std())
    # 150 gaps tell their standard deviation to 6 % where they are normal, less well with a gap's long tail; halves that
    # are not scaled to 60 simulated samples would be wrong by a factor of 2 or so.
    assert np.mean(floors) == pytest.approx(np.std(gaps), rel=0.3)


def test_halves_are_halves():
    halves = halves_by_cluster(7, np.random.default_rng(20), 500)
    assert (halves.sum(1) == 3).all()
    assert halves.mean(0) == pytest.approx(np.full(7, 3 / 7), abs=0.08)


def test_floors_and_spreads_of_a_nested_design():
    generator = np.random.default_rng(21)
    samples, sides = np.repeat(np.arange(300), 4), np.tile(["up", "up", "down", "down"], 300)
    truth = (0.5, 0.3, 0.1)
    values = truth[0] * np.repeat(generator.normal(size=(300, 2)), 4, axis=0)
    values += truth[1] * np.repeat(generator.normal(size=(600, 2)), 2, axis=0)
    values += truth[2] * generator.normal(size=(1200, 2)) + (sides == "down")[:, None]
    spread = spread_by_level(values, samples, sides)
    for found, expected in zip((spread.sample, spread.face, spread.repeat), truth, strict=True):
        assert found == pytest.approx(np.full(2, expected), rel=0.15)
    floor = repeat_floor(values, samples, sides)
    assert floor.repeat == pytest.approx(truth[2] * sqrt(pi), rel=0.1)  # mean distance of two in the plane
    assert floor.repeat < floor.sample < floor.face  # the faces differ by 1 on average
    alone = spread_by_level(values[::4], samples[::4], sides[::4])
    assert np.isnan(alone.repeat).all()
    assert np.isnan(repeat_floor(values[::4], samples[::4], sides[::4]).repeat)


def test_profiles_and_toy_images_agree_in_their_statistics():
    profile = Profile(0.12 + 0.008 * np.cos(7 * np.arange(720) * pi / 360 - 0.4))
    seen = profile_from_image(draw(profile), angles=ANGLES)
    difference = capture_statistics(seen.radii[None])[0] - capture_statistics(profile.radii[None, ::2])[0]
    assert (np.abs(difference) < RESOLUTION).all()
