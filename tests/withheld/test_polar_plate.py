"""The polar plate: exact drapes, forces that derive from the energy, and laws at its points that do as they say."""

from dataclasses import replace

import numpy as np
import pytest

from cusick_bench.sim.constants import CLOTH_RADIUS, GRAVITY, PLATE_RADIUS
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.world.laws import material as material_laws
from cusick_bench.withheld.world.laws.boundary import wavy
from cusick_bench.withheld.world.polar import band, kernels
from cusick_bench.withheld.world.polar.cloths import displacement, intervals
from cusick_bench.withheld.world.polar.drop import PolarPlate, drop, projected, zero_band
from cusick_bench.withheld.world.polar.grid import Disc, polar_grid
from cusick_bench.withheld.world.polar.history import LAWS
from cusick_bench.withheld.world.polar.material import PlateMaterial, material_of, rest_curvature
from cusick_bench.withheld.world.polar.outer_edge import outer_edge
from cusick_bench.withheld.world.registry import world_of
from cusick_bench.withheld.world.scene import Scene, unit_vector

pytestmark = pytest.mark.usefixtures("one_thread")

DENSITY, STRETCH = 0.2, 300.0
DISC = Disc(CLOTH_RADIUS, PLATE_RADIUS)
UPPER = np.triu_indices(3)


def scene(side="up", capture=1, **more):
    return replace(Scene((1, 2), 1, capture, side, capture % 2 == 0), **more)


@pytest.fixture(scope="module")
def coarse():
    return polar_grid(3, 12, Disc(CLOTH_RADIUS, PLATE_RADIUS, (0.006, -0.004), (wavy(0.02, 3, 0.4),)))


@pytest.fixture(scope="module")
def fabric():
    return world_of("polar").fabric_of((5, 1))


def isotropic(grid, ln_bending, poisson):
    """Material of the reference's ideal plates."""
    stiffness = np.exp(ln_bending) * DENSITY * GRAVITY * CLOTH_RADIUS**3
    shape, none = grid.weight.shape, np.zeros((*grid.weight.shape, 3))
    tables = [np.array([STRETCH, 0, 0, STRETCH, 0, STRETCH / 2])]
    tables += [stiffness * np.array([1, poisson, 0, 1, 0, (1 - poisson) / 2])]
    stretch, bending = (np.broadcast_to(table, (*shape, 6)).copy() for table in tables)
    return PlateMaterial(stretch, none, bending, none, 0.0)


def rim_of(grid, folds, ln_bending, poisson=0.0, steps=90):
    """Rim of an ideal plate that was raised by 6 mm cos(folds theta) ((r - r_p) / 6 cm)^2 and let go [m]."""
    plate = PolarPlate(grid, isotropic(grid, ln_bending, poisson), DENSITY * grid.weight, scene())
    distance, angle = np.hypot(*grid.points.T).T, np.arctan2(grid.points[..., 1], grid.points[..., 0])
    height = 0.006 * np.cos(folds * angle) * ((distance - PLATE_RADIUS) / 0.06) ** 2 * (folds > 0)
    u, _ = drop(plate, projected(grid, height), steps)
    around = np.linspace(0, 2 * np.pi, 8 * grid.angular, endpoint=False)
    moved = displacement(grid.radial, grid.angular, u, np.array([1.0]), around)[0]
    flat = np.column_stack([np.cos(around), np.sin(around), np.zeros_like(around)])
    return CLOTH_RADIUS * flat + moved


def drape_coefficient(rim):
    x, y = rim[:, 0], rim[:, 1]
    area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    return (area / np.pi - PLATE_RADIUS**2) / (CLOTH_RADIUS**2 - PLATE_RADIUS**2)


def test_a_stiff_plate_bends_as_the_exact_linear_one():
    rim = rim_of(polar_grid(4, 12, DISC), 0, 0.0)
    np.testing.assert_allclose(rim[:, 2], -0.5749e-3, rtol=2e-3)


@pytest.mark.parametrize(
    ("folds", "ln_bending", "poisson", "exact", "rim_min", "rim_max"),
    [
        (0, -2.0, -1 / 3, 0.99627, 0.149823, 0.149823),
        (6, -5.0, 0.0, 0.8585, 0.13846, 0.14812),
        (8, -5.8, 0.0, 0.7545, 0.13171, 0.14437),
        (8, -6.6, 0.3, 0.5679, 0.11770, 0.13926),
    ],
)
def test_folds_of_ideal_plates_are_right_at_the_default_size(folds, ln_bending, poisson, exact, rim_min, rim_max):
    """Bicubic shells refined and extrapolated, of accuracy 5e-4 to 2e-3; 1 point of drape coefficient is asked."""
    grid = polar_grid(*intervals(world_of("polar").vertices), DISC)
    rim = rim_of(grid, folds, ln_bending, poisson)
    assert drape_coefficient(rim) == pytest.approx(exact, abs=0.01)
    distance = np.hypot(rim[:, 0], rim[:, 1])
    assert distance.min() == pytest.approx(rim_min, abs=1e-3)
    assert distance.max() == pytest.approx(rim_max, abs=1e-3)


def elastic(grid, material, u, factor=0.0, matrix=None):
    """Energy [J] and forces [N]."""
    force = np.zeros_like(u)
    energy = kernels.elasticity(
        grid.unknowns, u, grid.stretch_weight, grid.weight, grid.slopes, material.stretch, material.rest_strain,
        material.bending, material.rest_curvature, material.growth, 15.0, factor, force,
        zero_band(grid) if matrix is None else matrix,
    )  # fmt: skip
    return energy, force


def some_displacement(grid, size=2e-3):
    return size * np.random.default_rng(0).normal(size=(grid.rows * grid.angular, 3))


def some_material(grid, fabric):
    more = {"rest": (lambda points: 0.002 * np.cos(60 * points[:, 0]),), "skew": (5.0, 9.0)}
    return replace(material_of(fabric, grid, scene(**more)), growth=0.0)


def test_forces_are_minus_the_gradient_of_the_energy(coarse, fabric):
    material, u = some_material(coarse, fabric), some_displacement(coarse)
    _, force = elastic(coarse, material, u)
    for node, axis in ((0, 0), (7, 1), (20, 2), (35, 2), (40, 0)):
        step = np.zeros_like(u)
        step[node, axis] = 1e-7
        slope = (elastic(coarse, material, u + step)[0] - elastic(coarse, material, u - step)[0]) / 2e-7
        assert force[node, axis] == pytest.approx(-slope, rel=1e-5, abs=1e-9 * np.abs(force).max())


def test_the_stiffness_is_the_slope_of_the_forces_where_nothing_is_stressed(coarse, fabric):
    material, u = replace(some_material(coarse, fabric), rest_curvature=np.zeros((36, 5, 3))), np.zeros((48, 3))
    matrix = zero_band(coarse)
    elastic(coarse, material, u, 1.0, matrix)
    step = some_displacement(coarse, 1e-8)
    _, force = elastic(coarse, material, step)
    product = kernels.times(matrix, step.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(product, -force, rtol=1e-4, atol=1e-5 * np.abs(force).max())


def test_the_stiffness_is_positive_and_the_band_solver_right(coarse, fabric):
    matrix = zero_band(coarse)
    elastic(coarse, some_material(coarse, fabric), some_displacement(coarse), 1.0, matrix)
    size, width = matrix.shape
    full = np.zeros((size, size))
    for d in range(width):
        full[np.arange(d, size), np.arange(size - d)] = matrix[: size - d, d]
        assert not matrix[size - d :, d].any()
    full = np.tril(full) + np.tril(full, -1).T
    assert np.linalg.eigvalsh(full).min() > 0
    right = np.random.default_rng(1).normal(size=size)
    found = right.copy()
    assert band.factorise(matrix)
    band.solve(matrix, found)
    np.testing.assert_allclose(full @ found, right, atol=1e-6 * np.abs(right).max())
    assert not band.factorise(-np.ones((3, 2)))


def test_points_of_integration_cover_the_cloth_wherever_the_plate_is():
    for centre in ((0.0, 0.0), (0.01, -0.012)):
        grid = polar_grid(4, 16, Disc(CLOTH_RADIUS, PLATE_RADIUS, centre))
        area = np.pi * (CLOTH_RADIUS**2 - PLATE_RADIUS**2)
        assert grid.weight.sum() == pytest.approx(area, rel=1e-4)
        assert grid.stretch_weight.sum() == pytest.approx(area, rel=2e-3)
        assert (np.hypot(*(grid.points - centre).T) < CLOTH_RADIUS).all()
        np.testing.assert_allclose(grid.value.sum(2)[grid.unknowns.min(1) >= 0], 1, atol=1e-12)


def test_splines_reproduce_a_bend_beside_the_axis():
    """A height of x^2 / 2 has the curvature (1, 0, 0) away from the clamp, up to what splines leave."""
    fine = polar_grid(20, 72, Disc(CLOTH_RADIUS, 0.03, (0.006, -0.004), (wavy(0.02, 3, 0.4),)))
    distance = np.hypot(*fine.points.T).T - 0.03
    height = 0.5e-3 * fine.points[..., 0] ** 2 * (1 - np.exp(-((distance / 0.02) ** 4)))
    u = projected(fine, height)
    state = [np.zeros((*fine.weight.shape, 3)) for _ in range(4)]
    kernels.strains(fine.unknowns, u, fine.value, fine.slopes, *state)
    far = distance > 0.07
    np.testing.assert_allclose(state[3][far], np.tile([1e-3, 0, 0], (far.sum(), 1)), atol=5e-5)


def test_the_cut_is_where_the_outline_says():
    angle, centre = np.linspace(0, 2 * np.pi, 50), np.array([0.01, 0.005])
    edge, turn, bend = outer_edge(angle, 0.15, 0.09, centre, (wavy(0.03, 2, 0.3),))
    x, y = edge * np.stack([np.cos(angle), np.sin(angle)]) - centre[:, None]
    np.testing.assert_allclose(np.hypot(x, y), 0.15 * (1 + 0.03 * np.cos(2 * np.arctan2(y, x) - 0.3)), atol=1e-9)
    for value, slope in ((edge, turn), (turn, bend)):
        np.testing.assert_allclose(np.gradient(value, angle)[2:-2], slope[2:-2], atol=0.02 * np.abs(slope).max())
    with pytest.raises(WithheldError, match="take a smaller shift"):
        outer_edge(angle, 0.15, 0.09, np.array([0.06, 0.0]), ())


def test_a_grid_has_a_least_size():
    assert intervals(576) == (8, 72)
    with pytest.raises(WithheldError, match="at least 36 intervals"):
        intervals(20)


def test_a_rolled_cloth_has_its_curvature_on_both_faces(coarse, fabric):
    points = coarse.points.reshape(-1, 2)
    rolled = scene(surfaces=(material_laws.rolled(20.0, unit_vector(90.0)),))
    way = points[:, 1] / CLOTH_RADIUS
    found = rest_curvature(rolled, points)
    np.testing.assert_allclose(found[:, 1], 20 * (0.9 + 0.4 * way**2), rtol=0.02)
    np.testing.assert_allclose(found[:, [0, 2]], 0, atol=0.1)
    up, down = (material_of(fabric, coarse, replace(rolled, side=side)).rest_curvature for side in ("up", "down"))
    np.testing.assert_array_equal(up, -down)


def test_skewed_grain_of_a_quarter_turn_swaps_warp_and_weft(coarse, fabric):
    plain, turned = (material_of(fabric, coarse, scene(skew=(angle, angle))) for angle in (0.0, 90.0))
    for one, other in ((plain.bending, turned.bending), (plain.stretch, turned.stretch)):
        np.testing.assert_allclose(other, one[..., [3, 1, 4, 0, 2, 5]], atol=1e-9 * one.max())
    bias = material_of(fabric, coarse, scene(skew=(45.0, 45.0))).bending[..., 0]
    assert bias[0, 0] == pytest.approx(float(fabric.material.bending[1, 0]), rel=1e-6)


def points_of(material, *ways):
    """E and k of a step in which every point has a curvature along 1 and a shear angle."""
    none = np.zeros_like(material.rest_curvature)
    for curvature, shear in ways:
        yield none + np.array([0, 0, shear]), none + np.array([curvature, 0, 0])


def test_bending_friction_opens_a_loop_of_its_couple(coarse):
    material = isotropic(coarse, -5.0, 0.0)
    (start,) = LAWS["bending-friction"](scene(), {"ratio": 30.0}).internal_variables
    law, moment = start(material, scene()), []
    for strain, curvature in points_of(material, *((k, 0.0) for k in (0, 40, 0, -40, 0))):
        now = law.advance(strain, curvature, material, 0.03)
        moment.append((now.bending * (curvature - now.rest_curvature)[..., :1])[0, 0, 0] / material.bending[0, 0, 0])
    np.testing.assert_allclose(moment, [0, 70, -30, -70, 30], atol=1e-9)


def test_shear_friction_opens_a_loop_of_its_stress(coarse):
    material = isotropic(coarse, -5.0, 0.0)
    (start,) = LAWS["shear-friction"](scene(), {"ratio": 2.0}).internal_variables
    law, stress = start(material, scene()), []
    for strain, curvature in points_of(material, *((0.0, g) for g in (0, 0.2, 0, -0.2, 0))):
        now = law.advance(strain, curvature, material, 0.03)
        stress.append((now.stretch[..., 5] * (strain - now.rest_strain)[..., 2])[0, 0] / (STRETCH / 2))
    limit = np.radians(2.0)
    np.testing.assert_allclose(stress, [0, 0.2 + limit, -limit, -0.2 - limit, limit], atol=1e-9)


def test_creep_leaves_the_given_part_of_the_moment_and_is_mostly_forgotten_when_turned(coarse):
    material = isotropic(coarse, -5.0, 0.0)
    (start,) = LAWS["creep"](scene(), {"loss": 0.3}).internal_variables
    ((strain, curvature),) = points_of(material, (20.0, 0.0))
    kept = {"Creep": start(material, scene()).carried_over(curvature)}
    later = start(material, scene(capture=2, carried_over=kept)).advance(strain, curvature, material, 1e4)
    np.testing.assert_allclose(later.rest_curvature, 0.3 * curvature)
    turned = start(material, scene("down", 3, carried_over=kept)).advance(strain, -curvature, material, 1e-9)
    np.testing.assert_allclose(turned.rest_curvature, -0.3 * 0.3 * curvature, atol=1e-6)


def test_face_and_back_stiffen_as_asked(coarse):
    """A cloth that hangs over the edge is convex seen from above: its curvature is negative."""
    material = isotropic(coarse, -5.0, 0.0)
    for side, factor in (("up", 1.4), ("down", 0.6)):
        (start,) = LAWS["face-asymmetry"](scene(side), {"asymmetry": 0.4}).internal_variables
        ((strain, curvature),) = points_of(material, (-600.0, 0.0))
        now = start(material, scene(side)).advance(strain, curvature, material, 0.03)
        assert now.bending[0, 0, 0] / material.bending[0, 0, 0] == pytest.approx(factor, rel=1e-3)
