"""The polar plate: exact drapes, forces that derive from the energy, and laws at its points that do as they say."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.constants import CLOTH_RADIUS, GRAVITY, PLATE_RADIUS
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.world.laws import material as material_laws
from cusick_bench.withheld.world.laws.boundary import wavy
from cusick_bench.withheld.world.polar import band, kernels
from cusick_bench.withheld.world.polar import drop as drop_module
from cusick_bench.withheld.world.polar.cloths import PolarCloths, displacement, intervals
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


CENTRE = (0.006, -0.004)


@pytest.fixture(scope="module")
def coarse():
    return polar_grid(3, 12, Disc(CLOTH_RADIUS, PLATE_RADIUS, CENTRE, (wavy(0.02, 3, 0.4),)))


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


@pytest.mark.parametrize("by", ["pressures", "accelerations"])
def test_a_cloth_whose_weight_is_carried_stays_flat(coarse, by):
    """By a pressure from below of its weight per area, or by what pulls it up as strongly as gravity pulls it down."""
    places = []

    def carry(at):
        places.append(at)
        up = np.zeros_like(at) + np.array([0.0, 0.0, GRAVITY])
        return np.full(len(at), DENSITY * GRAVITY) if by == "pressures" else up

    def fallen(**loads):
        plate = PolarPlate(coarse, isotropic(coarse, -5.0, 0.0), DENSITY * coarse.weight, scene(**loads))
        return drop(plate, np.zeros((coarse.rows * coarse.angular, 3)), 5)[0]

    assert np.abs(fallen()).max() > 1e-3
    assert np.abs(fallen(**{by: (carry,)})).max() < 1e-12
    flat = np.column_stack([coarse.points.reshape(-1, 2), np.zeros(coarse.weight.size)])
    expected = flat if by == "accelerations" else np.tile([0.0, 0.0, 1.0], (len(flat), 1))  # places, or normals
    np.testing.assert_allclose(places[-1], expected, atol=1e-9)


def test_a_cloth_without_stiffness_falls_as_a_stone_in_air(coarse):
    """Its splines fall at their own speed, but for the plate, which holds the slope: v' = (v - h g) / (1 + h c)."""
    none = np.zeros((*coarse.weight.shape, 6))
    limp = replace(isotropic(coarse, -5.0, 0.0), stretch=none, bending=none)
    u, _ = drop(PolarPlate(coarse, limp, DENSITY * coarse.weight, scene()), np.zeros((48, 3)), 5)
    speed = way = 0.0
    for step in range(5):
        h = 0.02 * 1.03**step
        speed = (speed - h * GRAVITY) / (1 + 0.8 * h)
        way += h * speed
    np.testing.assert_allclose(u, projected(coarse, np.full(coarse.weight.shape, way)), atol=1e-12)


def test_the_first_step_is_that_of_implicit_euler(coarse):
    """(M (1 + h c) + h^2 K) v = h F, from a flat cloth at rest."""
    material, flat, h = isotropic(coarse, -2.0, 0.0), np.zeros((48, 3)), 0.02
    u, _ = drop(PolarPlate(coarse, material, DENSITY * coarse.weight, scene()), flat, 1)
    inertia, stiffness, weight = zero_band(coarse), zero_band(coarse), np.zeros_like(flat)
    kernels.add_mass(coarse.unknowns, coarse.value, DENSITY * coarse.weight, inertia)
    elastic(coarse, material, flat, 1.0, stiffness)
    load = (DENSITY * coarse.weight)[..., None] * np.array([0.0, 0.0, -GRAVITY])
    kernels.spread(coarse.unknowns, coarse.value, load, weight)
    inert, stiff = (kernels.times(matrix, u.ravel() / h) for matrix in (inertia, stiffness))
    assert np.abs(h * h * stiff).max() > 0.01 * np.abs(inert).max()
    np.testing.assert_allclose(
        (1 + 0.8 * h) * inert + h * h * stiff, h * weight.ravel(), atol=1e-9 * np.abs(h * weight).max()
    )


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


def matrices(tables):
    """Symmetric matrices from entries 11, 12, 13, 22, 23, 33."""
    full = np.zeros((*tables.shape[:-1], 3, 3))
    full[..., *UPPER] = tables
    return full + np.triu(full, 1).swapaxes(-1, -2)


def form(tables, direction):
    """Twice the energy per area of a strain or curvature of 1 along a direction [deg]."""
    c, s = unit_vector(direction)
    along = np.array([c * c, s * s, 2 * c * s])
    return matrices(tables) @ along @ along


def cloth_of(stretch, bending):
    """A cloth of one table row of C, and of three bending stiffnesses at all curvatures."""
    rows = torch.tensor(bending, dtype=torch.float64)[:, None].repeat(1, 5)
    return Material(torch.tensor(stretch, dtype=torch.float64).repeat(6, 1), rows, torch.tensor(DENSITY))


def test_the_membrane_is_that_of_the_tables_and_poissons_ratio_that_of_the_fabric(coarse, fabric):
    """As in the package: C is twice the table, but for the shear stiffness; D12 = nu sqrt(D11 D22)."""
    one = replace(fabric, material=cloth_of([150.0, 10.0, 60.0, 40.0], [4e-5, 3e-5, 1e-5]), poisson=0.2)
    found = material_of(one, coarse, scene())
    np.testing.assert_allclose(matrices(found.stretch)[0, 0], [[300, 20, 0], [20, 120, 0], [0, 0, 40]], atol=1e-9)
    np.testing.assert_allclose(found.bending[0, 0, 1], 0.2 * 2e-5, rtol=1e-9)


@pytest.mark.parametrize("skew", [(0.0, 0.0), (20.0, 20.0), (-10.0, 25.0)])
def test_yarns_run_askew_counter_clockwise_and_take_what_stretches_them(coarse, fabric, skew):
    """Without shear stiffness and coupling each yarn is a fibre: its stiffness times cos^4 of the angle to it."""
    one = replace(fabric, material=cloth_of([150.0, 0.0, 60.0, 0.0], [2e-5, 1e-5, 2e-5]), poisson=0.0)
    found = material_of(one, coarse, scene(skew=skew))
    for degrees in (0.0, 20.0, 55.0, 110.0):
        warp, weft = (unit_vector(degrees) @ unit_vector(yarn) for yarn in (skew[0], 90 + skew[1]))
        np.testing.assert_allclose(form(found.stretch, degrees), 300 * warp**4 + 120 * weft**4, rtol=1e-9)


def test_a_skewed_cloth_bends_along_its_grain_as_the_table_says(coarse, fabric):
    one = replace(fabric, material=cloth_of([150.0, 0.0, 60.0, 40.0], [2e-5, 1.3e-5, 2e-5]), poisson=0.1)
    found = material_of(one, coarse, scene(skew=(20.0, 20.0)))
    for degrees, stiffness in ((20.0, 2e-5), (65.0, 1.3e-5), (110.0, 2e-5), (155.0, 1.3e-5)):
        np.testing.assert_allclose(form(found.bending, degrees), stiffness, rtol=1e-9)


def test_a_cloth_that_has_grown_is_at_rest_at_its_new_length(coarse, fabric):
    """Green's strain of a stretch l is (l^2 - 1) / 2."""
    grown = material_of(fabric, coarse, scene(growth=(lambda points: np.full(len(points), np.log(1.1)),)))
    np.testing.assert_allclose(grown.rest_strain, np.broadcast_to([0.105, 0.105, 0.0], (36, 5, 3)), atol=1e-12)


def test_fields_lie_on_the_cloth_wherever_it_lies(coarse, fabric, monkeypatch):
    """Each is a function of the place in the cloth, whose centre is not the plate's."""
    at, dropped = coarse.points - np.array(CENTRE), []

    def field(points):
        return points @ np.array([3.0, -2.0])

    names = dict.fromkeys(("log_bending", "log_stretch", "growth", "log_mass"), (field,))
    rest = (lambda points: points[:, 0] ** 3,)
    one = scene(centre=CENTRE, outlines=(wavy(0.02, 3, 0.4),), rest=rest, **names)

    def not_dropped(plate, u, steps):
        dropped.append(plate)
        return u, {}

    monkeypatch.setattr("cusick_bench.withheld.world.polar.cloths.drop", not_dropped)
    PolarCloths(3, 12).drape(fabric, one, 1)
    (plate,) = dropped
    plain, found = material_of(fabric, coarse, scene()), plate.material
    factor = np.exp(field(at))
    np.testing.assert_allclose(found.bending, plain.bending * factor[..., None], rtol=1e-9)
    np.testing.assert_allclose(found.stretch, plain.stretch * factor[..., None], rtol=1e-9)
    np.testing.assert_allclose(1 + 2 * found.rest_strain[..., 0], factor**2, rtol=1e-9)
    np.testing.assert_allclose(found.rest_curvature[..., 0], 6 * at[..., 0], rtol=0.01, atol=1e-9)
    np.testing.assert_allclose(plate.mass, float(fabric.material.density) * factor * coarse.weight, rtol=1e-9)


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 2**0.5), (0.5, 0.5, 1.0)])
def test_stiffness_follows_the_curvature_as_the_table_does(coarse, fabric, direction):
    """A flat cloth that wants a curvature of 10 i per metre, whichever it is, has the stiffness of the i-th column."""
    material, flat = material_of(fabric, coarse, scene()), np.zeros((coarse.rows * coarse.angular, 3))
    columns = fabric.material.bending.numpy()[0]
    assert abs(columns[4] / columns[0] - 1) > 0.05
    for column in range(5):
        wanted = 10.0 * column * np.array(direction)
        bent = replace(material, rest_curvature=np.broadcast_to(wanted, (36, 5, 3)).copy())
        energy = drop_module._elastic(  # pyright: ignore[reportPrivateUsage]
            coarse, bent, flat, 0.0, np.zeros_like(flat), zero_band(coarse)
        )
        at_rest = 0.5 * matrices(material.bending)[0, 0] @ wanted @ wanted * coarse.weight.sum()
        assert energy == pytest.approx(at_rest * columns[column] / columns[0], rel=1e-9)


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


def test_creep_and_asymmetry_count_from_the_rest_shape(coarse):
    """Turned over, the rest shape and what is left of the creep bend the other way."""
    rest, reached = np.array([4.0, 0.0, 0.0]), np.array([20.0, 0.0, 0.0])
    plain = isotropic(coarse, -5.0, 0.0)
    up, down = (replace(plain, rest_curvature=plain.rest_curvature + side * rest) for side in (1, -1))
    still, curvature = np.zeros_like(plain.rest_curvature), plain.rest_curvature + reached
    (start,) = LAWS["creep"](scene(), {"loss": 0.3}).internal_variables
    kept = {"Creep": start(up, scene()).carried_over(curvature)}
    for one, material, gone in ((scene(capture=2), up, 0.95), (scene("down", 3), down, 0.3)):
        now = start(material, replace(one, carried_over=kept)).advance(still, one.up * curvature, material, 1e-9)
        expected = one.up * (rest + 0.3 * gone * (reached - rest))
        np.testing.assert_allclose(now.rest_curvature, np.broadcast_to(expected, still.shape), atol=1e-6)
    (start,) = LAWS["face-asymmetry"](scene(), {"asymmetry": 0.4}).internal_variables
    now = start(up, scene()).advance(still, up.rest_curvature, up, 0.03)
    np.testing.assert_array_equal(now.bending, up.bending)


def test_half_of_creep_takes_seconds_and_half_of_it_longer(coarse):
    """Of a curvature that is held the halves have gone 1 - exp(-t / 3 s) and 1 - exp(-t / 40 s), whatever the steps."""
    material = isotropic(coarse, -5.0, 0.0)
    (start,) = LAWS["creep"](scene(), {"loss": 0.3}).internal_variables
    ((strain, curvature),) = points_of(material, (20.0, 0.0))
    for steps in (1, 5):
        law = start(material, scene())
        for _ in range(steps):
            now = law.advance(strain, curvature, material, 3.0 / steps)
        gone = 1 - (np.exp(-1.0) + np.exp(-3 / 40)) / 2
        np.testing.assert_allclose(now.rest_curvature, 0.3 * gone * curvature, rtol=1e-9)
