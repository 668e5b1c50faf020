"""Gradients of silhouettes against central differences and closed forms."""

import os
import subprocess
import sys

import numpy as np
import pytest
import torch

from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.render.camera import ParallelCamera, PinholeCamera
from cusick_bench.sim.render.silhouette import render

PIXELS = ParallelCamera(px_per_m=1.0, centre_px=(-0.5, -0.5), image_y="down")
"""Sees (x, y) as pixel coordinates whose pixel (row r, column c) covers [c, c + 1] x [r, r + 1]."""


def _draped(vertices, seed, overhang, folds=7):
    """A drape-like surface: flat on the plate, folds deepening to the rim; they overhang beyond about 1/folds."""
    mesh, rng = disc_mesh(vertices), np.random.default_rng(seed)
    radius, angle = np.hypot(*mesh.material.T), np.arctan2(*mesh.material.T[::-1])
    out = np.clip((radius - 0.09) / 0.06, 0, 1)
    phase = folds * angle + 0.3 * np.sin(angle + rng.uniform(0, 2 * np.pi))
    reach = np.minimum(radius, 0.09) + 0.06 * out * (0.35 + 0.3 * np.cos(phase))
    turned = angle + overhang * out * np.sin(phase)
    surface = np.column_stack([reach * np.cos(turned), reach * np.sin(turned), -0.05 * out])
    return torch.tensor(surface + rng.normal(0, 1e-5, surface.shape)), mesh.faces


def _relative_error(vertices, faces, camera, generator, step=1e-9, **options):
    """Error of the gradient of a random weighting of the pixels along a random direction, relative to its length."""
    weight = torch.randn(256, 256, generator=generator, dtype=torch.float64)
    direction = torch.randn(vertices.shape, generator=generator, dtype=torch.float64)
    leaf = vertices.clone().requires_grad_()
    (gradient,) = torch.autograd.grad((weight * render(leaf, faces, camera, **options)).sum(), leaf)
    ahead, behind = (render(vertices + s * step * direction, faces, camera, **options) for s in (1, -1))
    difference = (weight * (ahead - behind)).sum() / (2 * step)
    assert gradient.norm() > 1
    return float((difference - (gradient * direction).sum()).abs() / gradient.norm())


@pytest.mark.parametrize("camera", [ParallelCamera(), PinholeCamera()])
@pytest.mark.parametrize("overhang", [0.0, 0.1, 0.5])
@pytest.mark.parametrize("vertices", [297, 1205])
def test_coverage_gradient_on_drapes(vertices, overhang, camera):
    generator = torch.Generator().manual_seed(3)
    for seed in range(3):
        surface, faces = _draped(vertices, seed, overhang)
        assert _relative_error(surface, faces, camera, generator) < 1e-6


@pytest.mark.parametrize("overhang", [0.0, 0.5])
def test_soft_gradient_on_drapes(overhang):
    generator = torch.Generator().manual_seed(4)
    surface, faces = _draped(297, 0, overhang)
    assert _relative_error(surface, faces, ParallelCamera(), generator, method="soft") < 1e-6


def test_drapes_with_overhang_do_have_faces_turned_over():
    """Guards the tests above: their surfaces hold folds that cover each other."""
    for overhang, turned_over in ((0.0, False), (0.5, True)):
        surface, faces = _draped(1205, 0, overhang)
        side = surface[faces][:, 1:, :2] - surface[faces][:, :1, :2]
        share = float((torch.linalg.det(side) < 0).double().mean())
        assert (share > 0.02) == turned_over


@pytest.mark.parametrize("camera", [PIXELS, PinholeCamera(size_px=8, fov_rad=1.2, centre_px=(3.5, 3.5))])
def test_coverage_gradcheck_with_crossing_flipped_and_clipped_triangles(camera):
    generator = torch.Generator().manual_seed(5)
    points = torch.rand(9, 3, generator=generator, dtype=torch.float64)
    points = points * 10 - 1 if camera is PIXELS else points - 0.5
    faces = np.array([[0, 1, 2], [2, 1, 3], [4, 5, 6], [6, 7, 8], [0, 4, 8]])
    assert torch.autograd.gradcheck(lambda v: render(v, faces, camera, size=8), points.requires_grad_(), eps=1e-7)


def test_sides_along_rows_and_columns_have_their_full_gradient():
    """d(area)/d(top side) of an axis-parallel square: nothing is lost where an edge lies along the sweep."""
    square = torch.tensor([[2.25, 2.5, 0], [9.25, 2.5, 0], [9.25, 8.5, 0], [2.25, 8.5, 0]], dtype=torch.float64)
    square.requires_grad_()
    area = render(square, np.array([[0, 1, 2], [0, 2, 3]]), PIXELS, size=16).sum()
    (gradient,) = torch.autograd.grad(area, square)
    expected = [[-3, -3.5, 0], [3, -3.5, 0], [3, 3.5, 0], [-3, 3.5, 0]]  # half a side's length to each of its ends
    torch.testing.assert_close(gradient, torch.tensor(expected, dtype=torch.float64), rtol=0, atol=1e-12)


def test_hidden_vertices_and_those_outside_the_image_have_no_gradient():
    layers = torch.tensor(
        [[1, 1, 0], [14, 1, 0], [1, 14, 0], [2, 2, 1], [5, 3, 1], [3, 5, 1], [20, 3, 0], [25, 3, 0], [22, 9, 0]],
        dtype=torch.float64,
    ).requires_grad_()
    image = render(layers, np.arange(9).reshape(3, 3), PIXELS, size=16)
    (gradient,) = torch.autograd.grad((image * torch.arange(256.0).reshape(16, 16)).sum(), layers)
    assert (gradient[:3, :2] != 0).all()
    assert not gradient[3:].any()


def test_a_seam_that_just_closes_has_no_outline():
    """Vertex 4 lies on the diagonal that two triangles share, but only one of them is joined to it."""
    points = torch.tensor([[2, 2, 0], [10, 2, 0], [10, 10, 0], [2, 10, 0], [6, 6, 0]], dtype=torch.float64)
    for faces in ([[0, 1, 2], [0, 4, 3], [4, 2, 3]], [[0, 4, 3], [4, 2, 3], [0, 1, 2]]):
        for flip in (False, True):
            leaf = points[:, [1, 0, 2]] if flip else points.clone()
            image = render(leaf.requires_grad_(), np.array(faces), PIXELS, size=12)
            (gradient,) = torch.autograd.grad((image * torch.arange(144.0).reshape(12, 12)).sum(), leaf)
            assert not gradient[4].any()
            assert (gradient[:4, :2] != 0).all()


@pytest.mark.parametrize("method", ["coverage", "soft"])
def test_moving_the_cloth_inside_the_image_keeps_its_area(method):
    surface, faces = _draped(297, 1, 0.5)
    surface.requires_grad_()
    image = render(surface, faces, ParallelCamera(), method=method)
    (gradient,) = torch.autograd.grad(image.sum(), surface)
    tolerance = 1e-12 if method == "coverage" else 0.05  # the soft mask's area depends on how pixels sample it
    assert (gradient.sum(0).abs() < tolerance * gradient.abs().sum()).all()


@pytest.mark.parametrize("method", ["coverage", "soft"])
def test_collapsed_and_edge_on_triangles_give_finite_gradients(method):
    points = torch.tensor([[3, 3, 0], [9, 3, 0], [6, 9, 0], [6, 9, 0], [6, 6, 0], [6, 12, 0]], dtype=torch.float64)
    points.requires_grad_()
    image = render(points, np.array([[0, 1, 2], [2, 3, 2], [2, 3, 4], [2, 4, 5]]), PIXELS, method=method, size=16)
    (gradient,) = torch.autograd.grad((image**2).sum(), points)
    assert torch.isfinite(gradient).all()
    assert gradient[:3].any()


def test_gradients_of_a_batch_and_of_single_precision_vertices():
    surface, faces = _draped(297, 2, 0.1)
    batch = torch.stack([surface, 0.9 * surface]).float().requires_grad_()
    image = render(batch, faces, ParallelCamera())
    (gradient,) = torch.autograd.grad((image**2).sum(), batch)
    alone = batch[1].detach().double().requires_grad_()
    (expected,) = torch.autograd.grad((render(alone, faces, ParallelCamera()) ** 2).sum(), alone)
    assert gradient.dtype == torch.float32
    torch.testing.assert_close(gradient[1], expected.float())


@pytest.mark.slow
def test_a_gradient_follows_a_process_that_only_rendered(tmp_path):
    """Kernels that one process leaves in the cache serve the next, whichever of them it needs."""
    code = """
import sys
import os
import subprocess
import sys

import numpy as np
from cusick_bench.sim.render.coverage import area_gradient, pixel_areas
from cusick_bench.sim.render.outline import outline
points, faces = np.array([[0.2, 0.3], [3.1, 0.6], [1.5, 3.2]]), np.array([[0, 1, 2]])
pieces = outline(points, faces, 4)
if sys.argv[1] == "areas":
    print(pixel_areas(points, pieces, 4, 4).sum())
else:
    print(area_gradient(points, faces, pieces, np.ones((4, 4)))[2, 1])
"""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    found = []
    for what in ("areas", "gradient", "areas", "gradient"):
        command = [sys.executable, "-c", code, what]
        run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stderr[-500:]
        found.append(float(run.stdout))
    (a, b), (c, d), (e, f) = [0.2, 0.3], [3.1, 0.6], [1.5, 3.2]
    assert found[0] == pytest.approx(0.5 * ((c - a) * (f - b) - (e - a) * (d - b)))
    assert found[1] == pytest.approx(0.5 * (c - a))
    assert found[2:] == found[:2]
