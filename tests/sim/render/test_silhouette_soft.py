"""The soft mask: its equation, written out pixel by pixel, and its relation to exact coverage."""

import numpy as np
import pytest
import torch

from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.render.camera import ParallelCamera
from cusick_bench.sim.render.silhouette import render
from cusick_bench.sim.render.soft_mask import soft_mask


def _distance_to_segment(point, a, b):
    along = np.clip((point - a) @ (b - a) / max((b - a) @ (b - a), 1e-300), 0, 1)
    return np.linalg.norm(point - a - along * (b - a))


def _pixel_by_pixel(points, faces, size, sharpness, margin):
    """The mask's definition in plain loops."""
    image, half = np.zeros((size, size)), size / 2
    for row in range(size):
        for column in range(size):
            centre, clear = np.array([column, row], dtype=float), 1.0
            for a, b, c in points[faces]:
                turns = np.array([np.linalg.det([q - p, centre - p]) for p, q in ((a, b), (b, c), (c, a))])
                if (turns >= 0).all() or (turns <= 0).all():
                    clear = 0.0
                    break
                low, high = np.min([a, b, c], 0) - margin * half, np.max([a, b, c], 0) + margin * half
                if (low <= centre).all() and (centre <= high).all():
                    d = min(_distance_to_segment(centre, p, q) for p, q in ((a, b), (b, c), (c, a))) / half
                    clear *= 1 - np.exp(-(d**2) * sharpness)
            image[row, column] = 1 - clear
    return image


@pytest.mark.parametrize(("sharpness", "margin"), [(7000.0, 0.02), (60.0, 0.3)])
def test_mask_follows_its_equation(sharpness, margin):
    rng = np.random.default_rng(0)
    points = rng.uniform(-4, 24, (12, 2))
    faces = np.array([rng.choice(12, 3, replace=False) for _ in range(6)])
    mask = soft_mask(torch.tensor(points), faces, 20, sharpness=sharpness, margin=margin).numpy()
    expected = _pixel_by_pixel(points, faces, 20, sharpness, margin)
    assert 0.01 < expected.mean() < 0.99
    np.testing.assert_allclose(mask, expected, atol=1e-12)


def test_a_straight_edge_fades_as_the_distance_says():
    """One large face to the left of x = 100.25: uncovered centres in the margin see it at their distance."""
    points = torch.tensor([[-900.0, 128.0], [100.25, -2000.0], [100.25, 2000.0]], dtype=torch.float64)
    mask = soft_mask(points, np.array([[0, 1, 2]]), 256)
    distance = (torch.arange(101, 103, dtype=torch.float64) - 100.25) / 128
    torch.testing.assert_close(mask[50, 101:103], torch.exp(-7000 * distance**2))
    assert mask[50, 100] == 1
    assert not mask[:, 103:].any()  # 2.75 px, past the margin of 2.56 px


def test_mask_is_a_little_larger_than_the_exact_silhouette():
    mesh = disc_mesh(297)
    vertices = torch.tensor(mesh.flat)
    exact = render(vertices, mesh.faces, ParallelCamera())
    soft = render(vertices, mesh.faces, ParallelCamera(), method="soft")
    assert ((soft > 0.5) >= (exact > 0.5)).all()
    perimeter = 2 * np.pi * 0.15 * 723
    assert 0.3 * perimeter < float(soft.sum() - exact.sum()) < 2.56 * perimeter


def test_collapsed_faces_count_as_the_segment_or_point_they_are():
    """A face collapsed to a point, and one collapsed to a segment, seen by uncovered pixel centres."""
    points = torch.tensor([[5.1, 5.0], [5.1, 5.0], [12.0, 4.2], [12.0, 9.2]], dtype=torch.float64, requires_grad=True)
    mask = soft_mask(points, np.array([[0, 1, 0], [2, 3, 2]]), 20, sharpness=300.0, margin=0.1)
    image = mask.detach().numpy()
    pixel_square = np.exp(-300 / 100)  # weight of a distance of one pixel
    assert image[5, 6] == pytest.approx(pixel_square**0.81)
    assert image[7, 11] == pytest.approx(pixel_square)
    assert image[10, 12] == pytest.approx(pixel_square**0.64)
    assert image[7, 12] == 1
    (gradient,) = torch.autograd.grad((mask**2).sum(), points)
    assert torch.isfinite(gradient).all()
    assert gradient.any(1).all()


def test_a_centre_that_rounds_onto_a_side_is_covered_and_keeps_gradients_finite():
    """Pixel (4, 3) lies on the first side up to rounding: outside of it, yet at distance 0."""
    side = [[3.075901553983005, 4.171553446328126], [2.8481968920339904, 3.6568931073437474]]
    points = torch.tensor([*side, [17 / 3, 19 / 3]], dtype=torch.float64, requires_grad=True)
    mask = soft_mask(points, np.array([[0, 1, 2]]), 8, margin=0.05)
    (gradient,) = torch.autograd.grad(mask.square().sum(), points)
    assert mask[4, 3] == 1
    assert torch.isfinite(gradient).all()


def test_gradcheck():
    generator = torch.Generator().manual_seed(1)
    points = 16 * torch.rand(7, 2, generator=generator, dtype=torch.float64) - 2
    faces = np.array([[0, 1, 2], [2, 1, 3], [4, 5, 6]])
    assert torch.autograd.gradcheck(
        lambda p: soft_mask(p, faces, 12, sharpness=80.0, margin=0.4), points.requires_grad_(), eps=1e-7
    )
