"""Cameras: where known points land, and what is refused."""

import math

import pytest
import torch
from jaxtyping import TypeCheckError

from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.render.camera import ParallelCamera, PinholeCamera


def _points(*rows):
    return torch.tensor(rows, dtype=torch.float64)


def test_parallel_camera_maps_metres_to_723_pixels_with_image_y_up():
    seen = ParallelCamera().project(_points([0, 0, 0], [0.1, 0.05, -0.06], [-0.15, -0.15, 0.3]))
    expected = _points([127.5, 127.5], [127.5 + 72.3, 127.5 - 36.15], [127.5 - 108.45, 127.5 + 108.45])
    torch.testing.assert_close(seen, expected, rtol=0, atol=1e-12)


def test_parallel_camera_does_not_see_height():
    low, high = ParallelCamera().project(_points([0.07, -0.02, -0.06], [0.07, -0.02, 0.5]))
    assert torch.equal(low, high)


@pytest.mark.parametrize("camera", [ParallelCamera, PinholeCamera])
def test_image_y_down_mirrors_rows_about_the_centre(camera):
    points = _points([0.03, 0.11, -0.02], [-0.1, -0.04, 0])
    up = camera(centre_px=(100.0, 90.0)).project(points)
    down = camera(centre_px=(100.0, 90.0), image_y="down").project(points)
    assert torch.equal(up[:, 0], down[:, 0])
    torch.testing.assert_close(up[:, 1] - 90, 90 - down[:, 1])


def test_pinhole_camera_spans_its_field_of_view():
    """A point at the half angle of view lands on the image border, half a pixel beyond the last pixel's centre."""
    camera = PinholeCamera(fov_rad=0.5, eye_height_m=0.7)
    for height in (0.0, -0.06, 0.2):
        edge = (0.7 - height) * math.tan(0.25)
        seen = camera.project(_points([edge, 0, height], [0, edge, height], [-edge, -edge, height]))
        expected = _points([255.5, 127.5], [127.5, -0.5], [-0.5, 255.5])
        torch.testing.assert_close(seen, expected, rtol=0, atol=1e-11)


def test_pinhole_camera_shrinks_what_is_farther_in_proportion_to_depth():
    near, far = PinholeCamera(eye_height_m=0.7).project(_points([0.1, 0, 0], [0.1, 0, -0.7])) - 127.5
    torch.testing.assert_close(near, 2 * far)


def test_pinhole_camera_tends_to_the_parallel_one_from_far_away():
    eye = 1e6
    camera = PinholeCamera(fov_rad=2 * math.atan(128 / (723 * eye)), eye_height_m=eye)
    points = _points([0.1, 0.05, -0.06], [-0.12, 0.03, 0.0])
    torch.testing.assert_close(camera.project(points), ParallelCamera().project(points), rtol=0, atol=1e-4)


@pytest.mark.parametrize("camera", [ParallelCamera(), PinholeCamera()])
def test_projection_keeps_batch_dimensions_and_is_differentiable(camera):
    generator = torch.Generator().manual_seed(0)
    points = 0.1 * torch.randn(2, 3, 5, 3, generator=generator, dtype=torch.float64)
    assert camera.project(points).shape == (2, 3, 5, 2)
    assert torch.equal(camera.project(points)[1, 2], camera.project(points[1, 2]))
    assert torch.autograd.gradcheck(camera.project, points.requires_grad_())


@pytest.mark.parametrize("bad", [0.0, -723.0, math.nan, math.inf])
def test_impossible_numbers_are_refused_by_name_and_value(bad):
    for make, name in (
        (lambda: ParallelCamera(px_per_m=bad), "px_per_m"),
        (lambda: PinholeCamera(fov_rad=bad), "fov_rad"),
        (lambda: PinholeCamera(eye_height_m=bad), "eye_height_m"),
    ):
        with pytest.raises(SimulationError, match=f"{name}.*{bad}"):
            make()


@pytest.mark.parametrize("camera", [ParallelCamera, PinholeCamera])
def test_a_bad_frame_is_refused(camera):
    with pytest.raises((SimulationError, TypeCheckError), match="image_y"):  # whichever looks first
        camera(image_y="sideways")
    with pytest.raises(SimulationError, match="centre_px"):
        camera(centre_px=(127.5, math.nan))


def test_pinhole_camera_refuses_points_behind_the_eye():
    with pytest.raises(SimulationError, match=r"below the camera at 0\.7 m.*150"):
        PinholeCamera().project(_points([0, 0, 0], [10, 20, 150.0]))
