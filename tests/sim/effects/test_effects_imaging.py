"""Effects of the camera: where points are seen, exactly, and how outlines move."""

import math

import numpy as np
import pytest
import torch

from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.constants import PIXELS_PER_METRE
from cusick_bench.sim.effects import effect, parse
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.render.camera import ParallelCamera, PinholeCamera
from cusick_bench.sim.render.silhouette import render
from cusick_bench.sim.setup import Setup, Side

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")

MESH = disc_mesh(300)
BASE = Setup(MESH, DrapeSettings(), uniform_material(density=0.192, bending=1e-5))
IMAGING = ("camera-scale", "camera-offset", "camera-tilt", "perspective", "threshold")


def _draped() -> torch.Tensor:
    """A made-up drape with eight folds that overhang the plate's edge little."""
    x, y = torch.from_numpy(MESH.material).T
    radius, angle = torch.hypot(x, y), torch.atan2(y, x)
    hanging = (radius - 0.09).clamp_min(0) / 0.06
    seen = radius - hanging * (0.03 + 0.01 * torch.cos(8 * angle))
    return torch.stack([seen * torch.cos(angle), seen * torch.sin(angle), -0.04 * hanging], dim=1)


def _seen(text: str, points: torch.Tensor, side: Side = "up") -> torch.Tensor:
    return parse(text).apply(Setup(MESH, BASE.settings, BASE.material, side=side)).to_camera(points)


def _area(points: torch.Tensor) -> float:
    """Of the silhouette [m2]."""
    return float(render(points, MESH.faces, ParallelCamera()).sum()) / PIXELS_PER_METRE**2


def test_points_are_seen_where_the_formulas_say():
    point = torch.tensor([[0.10, -0.05, -0.04]], dtype=torch.float64)
    tilt, cosine, sine = math.radians(10), math.cos(math.radians(30)), math.sin(math.radians(30))
    along, across = 0.10 * cosine - 0.05 * sine, -0.10 * sine - 0.05 * cosine
    leaned = along * math.cos(tilt) - 0.04 * math.sin(tilt)
    expected = {
        "camera-scale:error=0.05": (0.105, -0.0525),
        "camera-offset:shift=0.002,direction=60": (0.101, -0.05 + 0.001 * math.sqrt(3)),
        "camera-tilt:angle=10,direction=30": (leaned * cosine - across * sine, leaned * sine + across * cosine),
        "perspective:inverse_height=2": (0.10 / 1.08, -0.05 / 1.08),
    }
    for text, place in expected.items():
        np.testing.assert_allclose(_seen(text, point)[0, :2], place, rtol=1e-12, err_msg=text)
    back = _seen("camera-tilt:angle=10,direction=210", _seen("camera-tilt:angle=10,direction=30", point))
    np.testing.assert_allclose(back, point, atol=1e-15)


def test_perspective_is_the_pinhole_camera_with_the_plate_in_scale():
    eye = PinholeCamera(eye_height_m=0.7)
    parallel = ParallelCamera(px_per_m=eye.focal_px / 0.7)
    points = _draped()
    found = parallel.project(_seen(f"perspective:inverse_height={1 / 0.7}", points))
    np.testing.assert_allclose(found, eye.project(points), rtol=1e-12)
    assert float((found - parallel.project(points)).abs().max()) > 3  # pixels: it matters


def test_a_point_above_the_eye_is_refused():
    with pytest.raises(SimulationError, match=r"below the eye at 0.5 m, but one is at 0.6 m; lower inverse_height"):
        _seen("perspective:inverse_height=2", torch.tensor([[0.0, 0.0, 0.6]], dtype=torch.float64))


@pytest.mark.parametrize("shift", [-0.004, 0.0007, 0.005])
def test_threshold_grows_a_circle_by_the_shift(shift):
    flat = torch.from_numpy(MESH.flat)
    seen = _seen(f"threshold:shift={shift}", flat)[torch.from_numpy(MESH.boundary), :2]
    np.testing.assert_allclose(torch.linalg.norm(seen, dim=1), 0.15 + shift, rtol=1e-6)


@pytest.mark.parametrize("shift", [-0.003, 0.003])
def test_threshold_moves_a_wavy_outline_along_its_normal(shift):
    points = _draped()
    rim = points[torch.from_numpy(MESH.boundary), :2]
    length = float(torch.linalg.norm(torch.roll(rim, -1, 0) - rim, dim=1).sum())
    grown = _area(_seen(f"threshold:shift={shift}", points)) - _area(points)
    # Steiner's formula for the area of a parallel curve; a radial shift would give 7 % less
    assert grown == pytest.approx(shift * length + math.pi * shift**2, rel=0.02)


@pytest.mark.parametrize("name", IMAGING)
def test_maps_are_differentiable_to_parameters_and_points(name):
    weights = torch.from_numpy(np.random.default_rng(1).normal(size=(MESH.vertices, 2)))
    direction = torch.from_numpy(np.random.default_rng(2).normal(size=(MESH.vertices, 3)))
    chosen = effect(name)

    def measure(severity, degrees, way):
        value = {chosen.severity.name: severity}
        if any(p.name == "direction" for p in chosen.parameters):
            value["direction"] = degrees
        return (chosen.apply(BASE, value).to_camera(_draped() + way * direction)[:, :2] * weights).sum()

    at = [torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in (chosen.severity.typical, 33.0, 0.0)]
    found = torch.autograd.grad(measure(*at), at, allow_unused=True)
    for k, step in ((0, 1e-6), (1, 1e-4), (2, 1e-8)):
        high, low = ([v.item() + sign * step * (k == i) for i, v in enumerate(at)] for sign in (1, -1))
        expected = float(measure(*high) - measure(*low)) / (2 * step)
        assert (0.0 if found[k] is None else float(found[k])) == pytest.approx(expected, rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("name", IMAGING)
def test_the_camera_stays_where_it_is_when_the_cloth_is_turned_over(name):
    points = _draped()
    mirrored = points * torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    torch.testing.assert_close(_seen(name, mirrored, side="down"), _seen(name, points), rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", IMAGING)
def test_small_causes_change_little(name):
    changed = effect(name).apply(BASE, {effect(name).severity.name: 1e-7}).to_camera(_draped()) - _draped()
    assert 0 < float(changed.abs().max()) < 1e-6
