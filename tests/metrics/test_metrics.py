"""Metrics against known values, invariances and brute force."""

import numpy as np
import pytest
import torch
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from cusick_bench.metrics import (
    MetricError,
    Surface,
    expected_best,
    iou,
    iou_pairs,
    mse,
    mse_pairs,
    profile_rms,
    profile_rms_rotated,
    quantile_distance,
    ruled_surface,
    spectrum_distance,
)
from cusick_bench.metrics.distances.hausdorff_distance import hausdorff

ANGLES = 2 * np.pi * np.arange(720) / 720


def disc(column: float = 127.5, radius: float = 90.0) -> np.ndarray:
    row, col = np.mgrid[:256, :256]
    return np.clip(radius - np.hypot(col - column, row - 127.5) + 0.5, 0, 1)


def drape(folds: int = 7, phase: float = 0.0, depth: float = 0.01) -> np.ndarray:
    return 0.12 + depth * np.cos(folds * (ANGLES - phase)) + 0.2 * depth * np.sin(2 * (ANGLES - phase))


# -- images


def test_shifted_disc_has_the_area_of_the_lens_complement():
    """Two discs of radius r, s apart: their lens covers 2 r^2 acos(s / 2r) - s/2 sqrt(4 r^2 - s^2)."""
    r, s = 90.0, 12.0
    lens = 2 * r**2 * np.arccos(s / 2 / r) - s / 2 * np.sqrt(4 * r**2 - s**2)
    apart = 2 * (np.pi * r**2 - lens)
    shifted = disc(127.5 + s) > 0.5
    assert mse(shifted.astype(float), (disc() > 0.5).astype(float)) == pytest.approx(apart / 256**2, rel=0.02)
    assert iou(shifted.astype(float), disc()) == pytest.approx(lens / (2 * np.pi * r**2 - lens), rel=0.01)


def test_all_pairs_equal_one_by_one_for_floats_and_bytes():
    generator = np.random.default_rng(0)
    images, targets = generator.random((300, 8, 9)), generator.random((3, 8, 9))
    direct = ((images[:, None] - targets[None]) ** 2).mean((2, 3))
    np.testing.assert_allclose(mse_pairs(images, targets), direct, atol=1e-14)
    as_bytes = np.round(images * 255).astype(np.uint8)
    np.testing.assert_allclose(mse_pairs(as_bytes, targets), direct, atol=5e-3)
    both = (images[:, None] > 0.5) & (targets[None] > 0.5)
    either = (images[:, None] > 0.5) | (targets[None] > 0.5)
    np.testing.assert_allclose(iou_pairs(images, targets), both.sum((2, 3)) / either.sum((2, 3)))


def test_two_empty_silhouettes_overlap_wholly_and_one_alone_does_not():
    assert iou(np.zeros((4, 4)), np.zeros((4, 4))) == 1
    assert iou(np.zeros((4, 4)), np.ones((4, 4))) == 0


@pytest.mark.parametrize("pairs", [mse_pairs, iou_pairs])
def test_no_images_have_no_pairs_and_images_without_pixels_are_refused(pairs):
    some, none = np.zeros((2, 8, 9)), np.zeros((0, 8, 9))
    assert pairs(some, none).shape == (2, 0)
    assert pairs(none, some).shape == (0, 2)
    with pytest.raises(MetricError, match="must have pixels"):
        pairs(some[:, :0], some[:, :0])


@pytest.mark.parametrize(("pixels", "missing"), [(1, 0.023), (2, 0.012)])
def test_pixels_that_a_rim_crosses_take_a_sixth_of_a_pixel_off_the_error(pixels, missing):
    """What the module states: discs of .12 and .1 m, at the release's scale and at twice that."""
    count, fine = 256 * pixels, 8
    place = ((np.arange(count * fine) + 0.5) / (count * fine) - 0.5) * 256 / 723
    away = np.hypot(place[:, None], place)
    images = [(away < r).reshape(count, fine, count, fine).mean((1, 3)) for r in (0.12, 0.1)]
    plane = np.pi * (0.12**2 - 0.1**2) / (256 / 723) ** 2
    rims = 2 * np.pi * (0.12 + 0.1) * 723 * pixels
    assert mse(*images) == pytest.approx(plane - rims / 6 / count**2, rel=2e-3)
    assert 1 - mse(*images) / plane == pytest.approx(missing, abs=1e-3)


def test_images_that_carry_a_gradient_are_compared():
    """As `render` gives them of a cloth that is fitted."""
    image = torch.from_numpy(disc()).requires_grad_()
    assert mse(image, disc(130.5)) == mse(disc(), disc(130.5))
    assert iou(disc(130.5), image) == iou(disc(130.5), disc())
    assert mse_pairs(image[None], image[None]) == 0


def test_images_of_other_size_or_with_nan_are_refused():
    with pytest.raises(MetricError, match="one size"):
        mse(np.zeros((256, 256)), np.zeros((128, 128)))
    with pytest.raises(MetricError, match="finite"):
        mse(np.full((4, 4), np.nan), np.zeros((4, 4)))


@pytest.mark.parametrize("compare", [mse, iou])
def test_levels_that_are_no_bytes_are_refused_and_not_taken_for_coverage(compare):
    levels = np.round(255 * disc())
    for wrong in (levels, levels.astype(int), -disc()):
        with pytest.raises(MetricError, match=r"in \[0, 1\] .*; divide levels by"):
            compare(disc(), wrong)
    assert compare(disc(), levels.astype(np.uint8)) == pytest.approx(compare(disc(), disc()), abs=1e-5)


# -- surfaces


def test_distance_to_a_triangle_in_all_its_regions():
    triangle = Surface(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    points = np.array([[0.2, 0.2, 0.3], [-3, -4, 0], [2, 0, 0], [0, 3, 0], [0.5, -2, 0], [-2, 0.5, 0], [1, 1, 0]])
    np.testing.assert_allclose(triangle.distance(points), [0.3, 5, 1, 2, 2, 2, np.sqrt(0.5)], atol=1e-15)


def test_tree_finds_the_nearest_triangle_that_brute_force_finds():
    surface = Surface.of(ruled_surface(drape()[::9]))
    points = np.random.default_rng(1).normal(0, 0.1, (200, 3))
    single = [Surface(surface.vertices, face[None]).distance(points) for face in surface.faces]
    np.testing.assert_allclose(surface.distance(points), np.min(single, axis=0), atol=1e-15)


@given(st.lists(st.floats(-0.05, 0.05), min_size=3, max_size=3))
@settings(max_examples=15, deadline=None)
def test_hausdorff_distance_of_a_translated_surface_is_the_translation(shift):
    """Of a convex body: the vertex that lies farthest along the shift is its own nearest point."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    moved = mesh.copy()
    moved.apply_translation(shift)
    assert hausdorff(mesh, moved) == pytest.approx(float(np.linalg.norm(shift)), abs=5e-5)


def test_hausdorff_distance_of_parallel_sheets_and_of_rescaled_spheres():
    sheet = ruled_surface(drape())
    above = sheet.copy()
    above.apply_translation([0, 0, 0.02])
    assert hausdorff(sheet, above) == pytest.approx(0.02, abs=5e-5)
    small = trimesh.creation.icosphere(subdivisions=4, radius=0.1)
    large = trimesh.creation.icosphere(subdivisions=4, radius=0.13)
    assert hausdorff(small, large) == pytest.approx(0.03, abs=2e-4)


def test_maximum_inside_a_triangle_is_found():
    """Of an equilateral triangle, the point farthest from its corners is the middle, where the mesh has no vertex."""
    corners = np.array([[0.0, 0, 0], [0.06, 0, 0], [0.03, 0.03 * np.sqrt(3), 0]])
    triangle = Surface(corners, np.array([[0, 1, 2]]))
    specks = Surface(np.repeat(corners, 3, axis=0), np.arange(9).reshape(3, 3))
    assert hausdorff(triangle, specks, tolerance=1e-7) == pytest.approx(0.06 / np.sqrt(3), abs=1e-7)
    assert hausdorff(specks, triangle) == pytest.approx(0.06 / np.sqrt(3), abs=5e-5)


def test_hausdorff_distance_agrees_with_dense_sampling():
    first, second = ruled_surface(drape(7)[::6]), ruled_surface(drape(9, 0.3)[::6])
    exact = hausdorff(first, second, tolerance=1e-6)
    dense = [mesh.subdivide().subdivide().subdivide().subdivide().vertices for mesh in (first, second)]
    sampled = max(Surface.of(second).distance(dense[0]).max(), Surface.of(first).distance(dense[1]).max())
    assert sampled <= exact + 1e-6
    assert sampled == pytest.approx(exact, abs=1e-4)
    coarse = hausdorff(first, second, tolerance=1e-3)
    assert exact - 1e-3 <= coarse <= exact + 1e-6


def test_hausdorff_distance_is_symmetric_and_invariant_under_rigid_motion():
    first, second = ruled_surface(drape(7)), ruled_surface(drape(8, 0.2))
    distance = hausdorff(first, second, tolerance=1e-6)
    assert hausdorff(second, first, tolerance=1e-6) == pytest.approx(distance, abs=1e-6)
    motion = trimesh.transformations.rotation_matrix(1.0, [1, 2, 3], [0.1, 0, 0])
    first.apply_transform(motion)
    second.apply_transform(motion)
    assert hausdorff(first, second, tolerance=1e-6) == pytest.approx(distance, abs=1e-6)


def test_a_search_may_stop_early_but_never_understates_what_it_keeps():
    first, second = Surface.of(ruled_surface(drape(7))), Surface.of(ruled_surface(drape(8, 0.2)))
    distance = hausdorff(first, second)
    assert hausdorff(first, second, stop_above=distance + 1e-6) == distance
    assert distance / 2 < hausdorff(first, second, stop_above=distance / 2) <= distance


def test_a_vertex_of_no_triangle_is_no_point_of_the_surface():
    corners, faces = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]), np.array([[0, 1, 2]])
    stray = Surface(np.vstack([corners, [5.0, 5, 5]]), faces)
    lifted = Surface(corners + np.array([0, 0, 0.01]), faces)
    assert hausdorff(stray, lifted) == pytest.approx(0.01)
    assert hausdorff(lifted, stray) == pytest.approx(0.01)


def test_damaged_surfaces_are_refused():
    good = ruled_surface(drape())
    with pytest.raises(MetricError, match="finite"):
        hausdorff(good, Surface(np.full((3, 3), np.nan), np.array([[0, 1, 2]])))
    with pytest.raises(MetricError, match="exist"):
        Surface(np.zeros((3, 3)), np.array([[0, 1, 3]]))
    with pytest.raises(ValueError, match="tolerance"):
        hausdorff(good, good, tolerance=0.0)


def test_a_tolerance_below_rounding_comes_to_an_end():
    """Bisection went on for ever, until it wrote beyond its stack and ended the process."""
    first, second = ruled_surface(drape()[::20]), ruled_surface(drape(phase=0.4)[::20])
    finest = hausdorff(first, second, tolerance=1e-300)
    assert finest == pytest.approx(hausdorff(first, second, tolerance=1e-9), abs=1e-9)


def test_ruled_surface_has_straight_generators_of_the_slant_length():
    radii = drape()
    mesh = ruled_surface(radii)
    edge, rim = mesh.vertices[1:721], mesh.vertices[721:]
    np.testing.assert_allclose(np.linalg.norm(rim - edge, axis=1), 0.06, atol=1e-12)
    np.testing.assert_allclose(np.hypot(*rim[:, :2].T), radii)
    assert (mesh.face_normals[:, 2] > 0).all()
    assert (rim[:, 2] < 0).all()
    assert mesh.euler_number == 1
    flat = ruled_surface(np.full(720, 0.155))
    assert np.abs(flat.vertices[:, 2]).max() == 0


def test_a_ruled_surface_without_strips_is_refused():
    with pytest.raises(MetricError, match="at least 1 strip"):
        ruled_surface(np.full(720, 0.12), strips=0)


# -- profiles


@given(st.integers(0, 719))
@settings(max_examples=20, deadline=None)
def test_rotated_profile_distance_is_free_of_rotation(turn):
    assert profile_rms_rotated(drape(), np.roll(drape(), turn)) < 1e-8
    assert quantile_distance(drape(), np.roll(drape(), turn)) < 1e-15
    assert spectrum_distance(drape(), np.roll(drape(), turn)) < 1e-15


def test_rotations_between_the_samples_are_found():
    apart = drape(12, 0.0), drape(12, 0.5 * ANGLES[1])
    assert profile_rms(*apart) > 10 * profile_rms_rotated(*apart)
    assert profile_rms_rotated(*apart) < 1e-8


def test_profile_distances_of_known_shapes():
    assert profile_rms(drape(5, depth=0.0), drape(5, depth=0.0) + 0.003) == pytest.approx(0.003)
    one, other = 0.12 + 0.010 * np.cos(7 * ANGLES), 0.12 + 0.006 * np.cos(7 * ANGLES + 1)
    assert profile_rms_rotated(one, other) == pytest.approx(0.004 / np.sqrt(2), rel=1e-4)
    assert spectrum_distance(one, other) == pytest.approx(0.004 / np.sqrt(2))
    assert quantile_distance(one, other) == pytest.approx(0.004 / np.sqrt(2), rel=1e-3)
    # Folds of other number but equal depth: the radii are distributed alike, the spectra are not.
    nine = 0.12 + 0.010 * np.cos(9 * ANGLES)
    assert quantile_distance(one, nine) < 2e-4
    assert spectrum_distance(one, nine) == pytest.approx(0.010)
    assert profile_rms_rotated(one, nine) == pytest.approx(0.010, rel=1e-6)
    larger = np.roll(one, 90) + 0.003  # no turn takes a larger mean away
    assert profile_rms_rotated(one, larger) == pytest.approx(0.003)


def test_profiles_of_different_sampling_are_refused():
    for distance in (profile_rms, profile_rms_rotated, quantile_distance, spectrum_distance):
        with pytest.raises(MetricError, match="at least one radius"):
            distance(np.zeros(0), np.zeros(0))
    with pytest.raises(MetricError, match="same angles"):
        profile_rms(np.ones(720), np.ones(360))
    with pytest.raises(MetricError, match="finite"):
        profile_rms_rotated(np.ones(720), np.full(720, np.nan))


# -- draws


def test_expected_best_is_the_mean_over_all_subsets():
    from itertools import combinations

    values = np.random.default_rng(2).random((6, 2))
    for count in range(1, 7):
        subsets = [values[list(chosen)].min(0).mean() for chosen in combinations(range(6), count)]
        assert expected_best(values, count) == pytest.approx(np.mean(subsets))
    with pytest.raises(MetricError, match="draws"):
        expected_best(values, 7)


def test_a_best_of_distances_that_are_not_known_is_refused():
    with pytest.raises(MetricError, match="is NaN"):
        expected_best(np.array([[1.0], [np.nan], [3.0]]), 2)
