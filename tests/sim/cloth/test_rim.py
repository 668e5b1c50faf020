"""The rim as a smooth curve, and meshes made irregular."""

import numpy as np
import pytest

from cusick_bench.sim.cloth.irregular import jittered_mesh
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.cloth.rim import rim_curve
from cusick_bench.sim.effects.material.grain_skew import skewed
from cusick_bench.sim.errors import SimulationError


def test_the_flat_cloth_covers_all_of_the_annulus():
    mesh = disc_mesh(97)
    rim = rim_curve(mesh, mesh.flat)
    assert rim.drape_coefficient() == pytest.approx(1, abs=1e-4)
    assert (rim.radii.min(), rim.radii.max()) == pytest.approx((0.15, 0.15), abs=1e-5)


def test_folds_between_vertices_are_seen():
    mesh = disc_mesh(1205)
    angle = np.arctan2(mesh.material[:, 1], mesh.material[:, 0])
    factor = 0.9 + 0.05 * np.cos(8 * angle + 0.3)
    shape = np.column_stack([mesh.material * factor[:, None], -0.04 + 0.01 * np.sin(8 * angle)])
    rim = rim_curve(mesh, shape)
    assert (rim.radii.min(), rim.radii.max()) == pytest.approx((0.15 * 0.85, 0.15 * 0.95), abs=2e-5)
    assert rim.heights.min() == pytest.approx(-0.05, abs=2e-5)
    exact = (0.15**2 * (0.9**2 + 0.05**2 / 2) - 0.09**2) / (0.15**2 - 0.09**2)
    assert rim.drape_coefficient() == pytest.approx(exact, abs=2e-4)


@pytest.mark.parametrize("share", [0.1, 0.4])
def test_jitter_moves_interior_vertices_only(share: float):
    mesh = disc_mesh(297)
    moved = jittered_mesh(mesh, share, seed=3)
    way = np.hypot(*(moved.material - mesh.material).T)
    radius = np.hypot(*mesh.material.T)
    held = np.isclose(radius, 0.15) | np.isclose(radius, 0.09)
    spacing = np.sqrt(2 / np.sqrt(3) * mesh.areas.sum() / mesh.vertices)
    assert (way[held] == 0).all()
    assert (way[~held] > 0).all()
    assert 0.5 * share * spacing < way.max() <= share * spacing
    assert (moved.faces == mesh.faces).all()
    assert (moved.areas > 0.1 * mesh.areas).all()
    assert ((np.hypot(*moved.material.T) < 0.09) == (radius < 0.09))[~held].all()


def test_jitter_repeats_and_none_is_the_same_mesh():
    mesh = disc_mesh(97)
    assert jittered_mesh(mesh, 0.0) is mesh
    first, again, other = (jittered_mesh(mesh, 0.2, seed=seed).material for seed in (1, 1, 2))
    assert (first == again).all()
    assert not (first == other).all()


def test_jitter_keeps_the_grain():
    """Warp and weft of a skewed cloth lay along the axes again, as if it were not skewed."""
    mesh = disc_mesh(297)
    moved = jittered_mesh(skewed(mesh, 30.0), 0.3, seed=3)
    np.testing.assert_allclose(moved.corners, skewed(jittered_mesh(mesh, 0.3, seed=3), 30.0).corners, atol=1e-12)


@pytest.mark.parametrize("share", [-0.1, 0.5, float("nan")])
def test_jitter_that_turns_triangles_over_is_refused(share: float):
    with pytest.raises(SimulationError, match=r"jitter must be from 0 to 0\.4"):
        jittered_mesh(disc_mesh(97), share)
