"""Profiles and what is read from them, against shapes whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from toy_cloths import draw, surface, wavy_profile

from cusick_bench.datasets import DataError, load
from cusick_bench.datasets.files.hanging_line import rim_depth
from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.datasets.files.silhouette import drape_coefficient_of, fold_count_of, profile_of
from cusick_bench.datasets.profile import (
    Profile,
    amplitude_spectrum,
    drape_coefficient,
    fold_count,
    profile_from_image,
    profile_from_mesh,
)
from cusick_bench.sim.cloth.folds import ring_folds
from cusick_bench.sim.constants import PIXELS_PER_METRE

TENTH_OF_A_PIXEL = 0.1 / PIXELS_PER_METRE


def disc(radius: float) -> Profile:
    return Profile(np.full(720, radius))


@pytest.mark.parametrize("folds", [3, 7, 12])
def test_profile_of_a_drawn_shape_to_a_fraction_of_a_pixel(folds):
    truth = wavy_profile(folds)
    measured = profile_from_image(draw(truth))
    assert measured.radii.shape == (720,)
    assert measured.rms(truth) < TENTH_OF_A_PIXEL
    assert np.abs(measured.radii - truth.radii).max() < 5 * TENTH_OF_A_PIXEL


def test_angles_run_counter_clockwise_from_x_with_y_up():
    image = np.zeros((256, 256))
    image[60:196, 60:196] = 1.0
    image[20:60, 126:130] = 1.0  # a flap towards the first row: +y
    radii = profile_from_image(image).radii
    assert np.argmax(radii) == pytest.approx(180, abs=3)  # 90 degrees
    assert np.argmax(profile_from_image(image, image_y="down").radii) == pytest.approx(540, abs=3)


def test_scale_centre_and_torch_images():
    truth = wavy_profile(5, mean=0.1)
    image = draw(truth, centre=(120.0, 131.0), scale=600.0)
    measured = profile_from_image(torch.from_numpy(image), centre=(120.0, 131.0), pixels_per_metre=600.0)
    assert measured.rms(truth) < TENTH_OF_A_PIXEL
    assert profile_from_image(image, pixels_per_metre=600.0).rms(truth) > 10 * TENTH_OF_A_PIXEL


def test_bytes_are_read_as_metrics_read_them():
    image = np.round(255 * draw(wavy_profile(6))).astype(np.uint8)
    assert np.array_equal(profile_from_image(image).radii, profile_from_image(image / 255).radii)
    assert drape_coefficient(image) == drape_coefficient(image / 255)


@pytest.mark.parametrize("levels", [np.int64, np.uint16, np.float32])
def test_levels_other_than_bytes_are_refused(levels):
    """A drape coefficient of 195 for levels 0 to 255, and radii that were 2 % too large."""
    image = np.round(255 * draw(wavy_profile(6))).astype(levels)
    for measure in (profile_from_image, drape_coefficient):
        with pytest.raises(DataError, match=r"coverage must be in \[0, 1\], got 0 to 255; divide"):
            measure(image)
        measure(image / np.float32(255))
        with pytest.raises(DataError, match=r"must have a height and a width, got the shape .* one by one"):
            measure(np.stack([image, image]) / 255)


def test_the_outermost_edge_counts_and_no_cloth_is_zero():
    ring = draw(disc(0.14)) - draw(disc(0.13)) + draw(disc(0.10))
    assert profile_from_image(ring).radii == pytest.approx(0.14, abs=TENTH_OF_A_PIXEL)
    assert (profile_from_image(np.zeros((256, 256))).radii == 0).all()
    assert profile_from_image(np.ones((256, 256))).radii.min() > 0.17


@pytest.mark.parametrize("projection", ["parallel", "pinhole"])
def test_a_ray_without_cloth_has_no_radius_for_any_camera(projection):
    protocol = replace(RELEASE, projection=projection)
    half = draw(disc(0.12))
    half[:, 100:] = 0  # what is left lies left of the axis
    radii = profile_of(half, protocol).radii
    assert radii[0] == 0
    assert radii[360] == pytest.approx(0.12, abs=0.01)
    assert not profile_of(0 * half, protocol).radii.any()


@pytest.mark.parametrize("height", [0.7, 1.5])
def test_cloth_that_hides_behind_the_plate_covers_nothing_to_any_camera(height):
    protocol = replace(RELEASE, projection="pinhole", camera_height_m=height)
    seen = draw(disc(RELEASE.plate_radius_m))
    assert drape_coefficient_of(seen, RELEASE) == pytest.approx(0, abs=2e-3)
    assert drape_coefficient_of(seen, protocol) == pytest.approx(0, abs=5e-3)


def test_mesh_outline_equals_its_silhouette_and_turns_with_the_mesh():
    truth = wavy_profile(7)
    vertices, faces = surface(truth)
    outline = profile_from_mesh(vertices, faces)
    assert outline.radii[::4] == pytest.approx(truth.radii[::4], abs=1e-12)  # where the mesh has its corners
    assert outline.rms(profile_from_image(draw(truth))) < 5 * TENTH_OF_A_PIXEL
    quarter = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]])  # rows: x -> y
    turned = profile_from_mesh(vertices @ quarter, faces)
    assert turned.rms(outline.rotated(90)) < 1e-12
    assert turned.rms(outline.rotated(270)) > 1e-3


def test_faces_of_a_large_mesh_may_be_of_32_bits():
    """Edges were numbered in the faces' own type, which overflowed: radii of 0 from 46341 vertices on."""
    vertices, faces = surface(wavy_profile(7))
    vertices, faces = np.vstack([np.zeros((50_000, 3)), vertices]), faces + 50_000
    expected = profile_from_mesh(vertices, faces)
    assert profile_from_mesh(vertices, faces.astype(np.int32)) == expected
    assert expected.radii.min() > 0.1


def test_profiles_are_equal_where_their_radii_are():
    """`==` and `in` ended in NumPy's "truth value of an array is ambiguous"."""
    one, other = wavy_profile(7), wavy_profile(8)
    assert one == Profile(one.radii.copy())
    assert one != other
    assert one in [other, Profile(one.radii.copy())]
    assert one != Profile(one.radii[::2])
    assert one != "a profile"


def test_drape_coefficient_of_discs():
    for radius, expected in ((0.15, 1.0), (0.09, 0.0), (0.12, (0.12**2 - 0.09**2) / (0.15**2 - 0.09**2))):
        assert drape_coefficient(draw(disc(radius))) == pytest.approx(expected, abs=1e-3)
    half = draw(disc(0.12), scale=361.5)
    assert drape_coefficient(half, pixels_per_metre=361.5) == pytest.approx(expected, abs=3e-3)
    assert drape_coefficient(draw(disc(0.12)), cloth_radius=0.12) == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize(
    ("measure", "message"),
    [
        (lambda image: profile_from_image(image, image_y="Up"), "image_y must be up or down, got 'Up'"),
        (lambda image: profile_from_image(image, pixels_per_metre=-723.0), "pixels_per_metre must be > 0"),
        (lambda image: profile_from_image(image, centre=(np.nan, 127.5)), "centre must be a finite column and row"),
        (lambda image: profile_from_image(image, angles=0), "at least 1 ray, got 0"),
        (lambda image: drape_coefficient(image, cloth_radius=0.09, plate_radius=0.15), "0 <= plate < cloth"),
        (lambda image: drape_coefficient(image, cloth_radius=0.09), r"got plate 0\.09 m and cloth 0\.09 m"),
        (lambda image: drape_coefficient(image, pixels_per_metre=0), "pixels_per_metre must be > 0"),
        (lambda image: fold_count(Profile(profile_from_image(image).radii * np.nan)), "finite radii"),
        (lambda image: fold_count(Profile(np.zeros(0))), "finite radii"),
    ],
)
def test_options_that_cannot_be_are_refused_and_not_measured_with(measure, message):
    """`Up` was read as down, and a plate wider than its cloth gave a drape coefficient between 0 and 1."""
    with pytest.raises(DataError, match=message):
        measure(draw(disc(0.12)))


@pytest.mark.parametrize("folds", [2, 5, 8, 13])
def test_folds_are_counted_whatever_their_phase(folds):
    angles = disc(0.12).angles
    for phase in np.linspace(0, 2 * np.pi, 7):
        assert fold_count(Profile(0.12 + 0.004 * np.cos(folds * angles - phase))) == folds
    ripple = 0.001 * np.cos(29 * angles)  # below the prominence
    assert fold_count(Profile(0.12 + ripple)) == 0
    assert fold_count(Profile(0.12 + 0.004 * np.cos(folds * angles) + 0.004 * np.cos(40 * angles))) == folds


def test_spectrum_holds_the_amplitudes():
    angles = disc(0.12).angles
    spectrum = amplitude_spectrum(Profile(0.12 + 0.01 * np.cos(8 * angles - 1) + 0.003 * np.sin(2 * angles)), modes=10)
    expected = np.zeros(11)
    expected[[0, 2, 8]] = 0.12, 0.003, 0.01
    assert spectrum == pytest.approx(expected, abs=1e-12)


def test_spectrum_of_few_angles_holds_the_amplitude_of_its_last_order():
    for count in (60, 61):
        angles = Profile(np.zeros(count)).angles
        assert amplitude_spectrum(Profile(0.12 + 0.004 * np.cos(30 * angles)))[30] == pytest.approx(0.004)


def test_folds_are_the_peaks_of_that_prominence():
    """As scipy's find_peaks counts them on the circle cut open at its lowest point."""
    from scipy.signal import find_peaks

    generator = np.random.default_rng(0)
    counts = []
    for _ in range(300):
        harmonics = np.zeros(181, complex)
        harmonics[1:21] = generator.normal(size=(2, 20)).T @ [1, 1j] / generator.uniform(1, 20)
        ring = np.fft.irfft(harmonics, 360)
        prominence = generator.uniform(0.05, 4) * ring.std()
        cut = np.roll(ring, -int(np.argmin(ring)))
        expected = len(find_peaks(np.append(cut, cut[0]), prominence=prominence)[0])
        assert ring_folds(ring, prominence=prominence, harmonics=20) == expected
        counts.append(expected)
    assert min(counts) < 3 < 10 < max(counts)


def test_drapes_of_one_shape_have_the_same_folds_whatever_their_size():
    """A swell of 1.2 mm is no fold of the standard's cloth, one of 0.3 mm none of one of a quarter of its size."""
    quarter = replace(RELEASE, cloth_radius_m=0.0375, plate_radius_m=0.0225, px_per_m=4 * RELEASE.px_per_m)
    for depth, folds in ((0.0012, 0), (0.0025, 7), (0.02, 7)):
        radii = 0.12 + depth * np.cos(7 * disc(0.12).angles)
        assert fold_count_of(Profile(radii), RELEASE) == fold_count_of(Profile(radii / 4), quarter) == folds


@pytest.mark.parametrize("cloth", ["fabric_1", "fabric_2", "fabric_3", "fabric_4", "fabric_5"])
def test_rims_of_folded_cloth_hang_in_straight_lines_on_average(cloth: str) -> None:
    dataset = load("synthetic").select(cloth=cloth, sample=1)
    mesh = dataset.sample(0).mesh
    assert mesh is not None
    points, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    edges, count = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0, return_counts=True)
    rim = points[np.unique(edges[count == 1])]
    depth = rim_depth(np.hypot(rim[:, 0], rim[:, 1]), dataset.protocol)
    apart = depth + rim[:, 2]
    assert abs(apart.mean()) < 0.0025
    assert apart.std() < 0.0015
    assert np.corrcoef(depth, -rim[:, 2])[0, 1] > 0.97
