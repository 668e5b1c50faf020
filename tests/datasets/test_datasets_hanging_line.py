"""What a line of sight that is not vertical sees of a hanging cloth."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy import ndarray

from cusick_bench.datasets import load
from cusick_bench.datasets.files.hanging_line import (
    BULGE,
    DEEPEST,
    outline_depth,
    rim_depth,
    with_perspective,
    without_perspective,
)
from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.files.silhouette import camera_of, drape_coefficient_of
from cusick_bench.sim.render.silhouette import render

RADII = RELEASE.plate_radius_m + np.array([0.0005, 0.003, 0.008, 0.015, 0.03, 0.05, 0.059])


def hanging(radius: float, protocol: Protocol = RELEASE) -> tuple[ndarray, ndarray]:
    """Distances beyond the plate's edge and depths of a line of cloth that ends at a radius [m]."""
    beyond = radius - protocol.plate_radius_m
    deep = min(float(rim_depth(np.array([radius]), protocol)[0]), DEEPEST * beyond)
    depth = np.linspace(0, deep, 20001)
    return beyond * np.expm1(-depth / (BULGE * beyond)) / np.expm1(-deep / (BULGE * beyond)), depth


@pytest.mark.parametrize("slope", [0.02, 0.07, 0.14, 0.5])
def test_the_outline_recedes_to_the_outermost_point_that_is_seen(slope: float) -> None:
    found = RADII - RELEASE.plate_radius_m - slope * outline_depth(RADII, np.full_like(RADII, slope), RELEASE)
    expected = [float((beyond - slope * depth).max()) for beyond, depth in map(hanging, RADII)]
    np.testing.assert_allclose(found, expected, atol=1e-8)
    assert np.all(np.array(expected) >= 0), "the edge of the plate hides what hangs behind it"


def test_the_rim_is_seen_from_outside_and_where_it_hangs_far_out() -> None:
    deep, hidden = rim_depth(RADII, RELEASE), RADII - RELEASE.plate_radius_m < 1e-3
    from_outside = outline_depth(RADII, np.full_like(RADII, -0.1), RELEASE)
    np.testing.assert_allclose(from_outside[~hidden], deep[~hidden])
    assert np.all(from_outside[hidden] < 0.3 * deep[hidden]), "the rim of a deep valley hangs back under the plate"
    far, near = outline_depth(RADII, np.full_like(RADII, 0.1), RELEASE)[[-1, 0]]
    assert far == pytest.approx(deep[-1])
    assert near < 0.1 * deep[0]


@pytest.mark.parametrize("height", [0.7, 1.0, 3.0])
def test_a_near_eye_sees_the_outermost_point_too_and_its_view_is_turned_back(height: float) -> None:
    lines = [hanging(radius) for radius in RADII]
    seen = np.array([float(((RELEASE.plate_radius_m + u) * height / (height + z)).max()) for u, z in lines])
    np.testing.assert_allclose(with_perspective(RADII, RELEASE, height), seen, atol=5e-5)
    np.testing.assert_allclose(without_perspective(seen, RELEASE, height), RADII, atol=2e-4)
    back = without_perspective(with_perspective(RADII, RELEASE, height), RELEASE, height)
    np.testing.assert_allclose(back, RADII, atol=1e-6)


def test_perspective_is_differentiable() -> None:
    radii = torch.tensor([0.08, 0.093, 0.11, 0.14, 0.16], dtype=torch.float64, requires_grad=True)
    true = without_perspective(radii, RELEASE, 0.9)
    np.testing.assert_allclose(true.detach(), without_perspective(radii.detach().numpy(), RELEASE, 0.9), atol=1e-12)
    (slopes,) = torch.autograd.grad(true.sum(), radii)
    step = 1e-7
    high, low = (without_perspective(radii.detach().numpy() + sign * step, RELEASE, 0.9) for sign in (1, -1))
    np.testing.assert_allclose(slopes, (high - low) / (2 * step), rtol=1e-4)


def test_flat_cloth_and_the_plate_are_seen_where_they_are() -> None:
    edges = np.array([0.05, RELEASE.plate_radius_m, RELEASE.cloth_radius_m, RELEASE.cloth_radius_m + 0.01])
    np.testing.assert_allclose(without_perspective(edges, RELEASE, 0.7), edges, atol=2e-6)
    np.testing.assert_allclose(with_perspective(edges, RELEASE, 0.7), edges, atol=2e-6)
    np.testing.assert_allclose(outline_depth(edges, np.full_like(edges, 0.1), RELEASE)[2:], 0, atol=1e-6)


@pytest.mark.parametrize(("plate", "cloth"), [(0.12, 0.20), (0.24, 0.40), (0.011, 0.05)])
def test_sizes_that_no_picture_of_the_release_holds_are_corrected_too(plate: float, cloth: float) -> None:
    scale = 120 / cloth
    protocol = Protocol(
        cloth_radius_m=cloth, plate_radius_m=plate, px_per_m=scale, projection="pinhole", camera_height_m=5 * cloth
    )
    radii = np.linspace(plate + 0.2 * (cloth - plate), cloth, 9)
    back = without_perspective(with_perspective(radii, protocol), protocol)
    np.testing.assert_allclose(back, radii, rtol=1e-6)


@pytest.mark.parametrize(("height", "most"), [(0.55, 0.025), (0.85, 0.01), (1.5, 0.005)])
def test_the_drape_coefficient_of_the_shipped_cloths_does_not_depend_on_the_camera(height: float, most: float) -> None:
    dataset = load("synthetic").select(sample=[1, 2, 3])
    near = replace(RELEASE, projection="pinhole", camera_height_m=height)
    wrong = []
    for row in range(len(dataset)):
        mesh = dataset.sample(row).mesh
        assert mesh is not None
        points = torch.from_numpy(np.array(mesh.vertices, dtype=np.float64))
        faces = np.asarray(mesh.faces, dtype=np.int64)
        pictures = [(render(points, faces, camera_of(one)).numpy(), one) for one in (RELEASE, near)]
        far, seen = (drape_coefficient_of(picture, one) for picture, one in pictures)
        wrong.append(seen - far)
    assert np.abs(wrong).max() < most, f"drape coefficients differ by {np.array(wrong).round(4)}"
