"""The true world: every law acts, does nothing at severity 0, and those with a known answer give it."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.constants import CLOTH_RADIUS, GRAVITY, PLATE_RADIUS
from cusick_bench.sim.effects import registered
from cusick_bench.sim.effects.directions import leaned
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.suite.design import EFFECTS, OUTSIDE, Plan
from cusick_bench.withheld.suite.labels import label_of
from cusick_bench.withheld.world.fields import matern_field
from cusick_bench.withheld.world.laws import OUTSIDE as OUTSIDE_LAWS
from cusick_bench.withheld.world.laws import material
from cusick_bench.withheld.world.photograph import PIXEL, photograph, seen_from_above
from cusick_bench.withheld.world.registry import world_of
from cusick_bench.withheld.world.scene import Scene, gravity_vector, unit_vector
from cusick_bench.withheld.world.triangles import contact
from cusick_bench.withheld.world.triangles.placed_disc import on_plate, placed
from cusick_bench.withheld.world.triangles.systems import SceneSystems
from cusick_bench.withheld.world.true_case import TrueCase

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")

DRAWS = EFFECTS | OUTSIDE
law = world_of("paper").law
VERTICES, STEPS = 150, 30


def scene(side="up", capture=1, **more):
    return replace(Scene((1, 2), 1, capture, side, capture % 2 == 0), **more)


def drawn(name, multiple):
    return DRAWS[name].parameters(multiple * DRAWS[name].typical, np.random.default_rng(0))


@pytest.fixture(scope="module")
def pictures():
    """The first sample's pictures of a limp cloth under a cause."""

    def take(causes):
        return list(TrueCase((3, 2), causes, VERTICES, STEPS).pictures(1))

    return take


@pytest.fixture(scope="module")
def base(pictures):
    return pictures({})


def test_every_effect_of_the_package_has_a_law_and_a_draw():
    laws = set(world_of("paper").laws)
    assert set(registered()) <= laws
    assert laws == set(EFFECTS) | set(OUTSIDE)
    assert set(OUTSIDE_LAWS) == set(OUTSIDE)
    assert not set(EFFECTS) & set(OUTSIDE)
    assert len(OUTSIDE) >= 5


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_labels_speak_the_packages_language(name):
    if name not in registered():
        pytest.skip(f"{name} is not registered in this version")
    effect, draw = registered()[name], EFFECTS[name]
    assert draw.severity == effect.severity.name
    assert draw.typical == pytest.approx(effect.severity.typical)
    assert effect.signed or draw.negative == 0
    for seed in range(20):
        value = draw.parameters(8 * draw.typical, np.random.default_rng(seed))
        assert set(effect.complete(value)) == set(value)  # nothing unknown, left out, or out of bounds


@pytest.mark.parametrize("name", sorted(DRAWS))
def test_a_law_acts_and_is_absent_at_zero(name, pictures, base):
    value = drawn(name, 4)
    absent = pictures({name: value | {DRAWS[name].severity: 0.0}})
    # a smear, a threshold or a thickness of zero cannot be told; a threshold still cuts the blurred picture
    for without, plain in zip(absent, base, strict=True):
        np.testing.assert_allclose(without.vertices, plain.vertices, atol=2e-9)
    acting = pictures({name: value})
    changed = [np.abs(a.levels.astype(float) - b.levels).mean() for a, b in zip(acting, base, strict=True)]
    if name == "self-contact":  # acts where folds touch only: see the test of its force
        return
    assert max(changed) > 0.25, changed


def test_a_law_is_named():
    with pytest.raises(WithheldError, match="world 'paper' has no law called 'gremlins'"):
        law("gremlins")


@pytest.mark.parametrize("centre", [(0.0, 0.0), (0.012, -0.005), (0.0, 0.03)])
def test_an_off_centre_mesh_keeps_its_circles_and_angles(centre):
    mesh = disc_mesh(300)
    moved = placed(mesh, 0.15, 0.09, np.array(centre))
    rim = mesh.boundary
    edge = np.flatnonzero(np.abs(np.hypot(*mesh.material.T) - 0.09) < 1e-9)
    np.testing.assert_allclose(np.hypot(*(moved.material[rim] - centre).T), 0.15, atol=1e-12)
    np.testing.assert_allclose(np.hypot(*moved.material[edge].T), 0.09, atol=1e-12)
    assert on_plate(moved, 0.09).sum() == on_plate(mesh, 0.09).sum()
    assert moved.areas.sum() == pytest.approx(mesh.areas.sum(), rel=2e-3)
    assert _smallest_angle(moved) > 0.75 * _smallest_angle(mesh)


def _smallest_angle(mesh):
    a, b, c = (mesh.material[mesh.faces[:, k]] for k in range(3))
    cosine = [
        ((q - p) * (r - p)).sum(1) / np.hypot(*(q - p).T) / np.hypot(*(r - p).T)
        for p, q, r in ((a, b, c), (b, c, a), (c, a, b))
    ]
    return float(np.arccos(np.max(cosine)))


def test_a_cloth_cannot_fall_off_its_plate():
    with pytest.raises(WithheldError, match="take a smaller shift"):
        placed(disc_mesh(150), 0.15, 0.09, np.array([0.06, 0.0]))


def test_fields_are_matern():
    """Standard deviation, and the correlation (1 + a) exp(-a), a = sqrt(3) d / length, of smoothness 3/2."""
    points = np.array([[0.0, 0.0], [0.02, 0.0], [0.0, 0.04]])
    generator = np.random.default_rng(0)
    values = np.array([matern_field(2.0, 0.03, 1.5, generator)(points) for _ in range(4000)])
    scaled = np.sqrt(3) * np.array([0.02, 0.04]) / 0.03
    correlation = np.corrcoef(values.T)[0, 1:]
    np.testing.assert_allclose(values.std(0), 2.0, rtol=0.05)
    np.testing.assert_allclose(correlation, (1 + scaled) * np.exp(-scaled), atol=0.05)


def test_the_bending_discretisation_differs_but_not_on_average():
    systems = SceneSystems(400, 5, "paper")
    system = systems.system_of(scene())
    plain = DrapeSystem(system.mesh, "paper", 0.0, system.fixed, system.spring).elements
    ratio = system.elements.hinge_weight / plain.hinge_weight
    assert system.elements.hinge_weight.mean() == pytest.approx(plain.hinge_weight.mean())
    assert 0.05 < ratio.std() < 0.5
    assert (system.elements.hinge_scale > 0).all()


def test_a_roll_has_its_curvature():
    """Turning of the tangent over the mean disc chord is the curvature times the way."""
    surface = material.rolled(30.0, unit_vector(90.0))
    s = np.linspace(-0.15, 0.15, 2001)
    x, y, z = surface(np.column_stack([np.full_like(s, 0.02), s])).T
    slope = np.unwrap(np.arctan2(np.diff(z), np.diff(y)))
    slope -= slope[len(slope) // 2]
    middle = 0.5 * (s[1:] + s[:-1])
    np.testing.assert_allclose(slope, 30 * (0.9 * middle + 0.4 / 3 * middle**3 / 0.15**2), atol=0.015)
    np.testing.assert_allclose(np.hypot(np.diff(y), np.diff(z)), np.diff(s), rtol=1e-3)
    np.testing.assert_allclose(x, 0.02)


@pytest.mark.parametrize("number", range(6))
def test_a_patch_weighs_what_the_packages_own_would(number):
    """ln of the factor at the centre, and its integral, 2 pi size^2 times that."""
    one = replace(scene(), seed=(number,))
    value = {"stiffening": 1.1, "direction": 40.0, "radius": 0.12, "size": 0.02}
    field = law("local-stiff-patch")(one, value).log_bending[0]
    assert field(0.12 * unit_vector(40.0)[None])[0] == pytest.approx(1.1, rel=1e-3)
    axis = np.arange(-0.2, 0.2, 5e-4)
    grid = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    assert field(grid).sum() * 25e-8 == pytest.approx(1.1 * 2 * np.pi * 0.02**2, rel=0.02)
    assert field(0.12 * unit_vector(220.0)[None])[0] == pytest.approx(0, abs=1e-6)


def test_a_hem_is_at_the_rim_and_not_at_the_plate():
    field = law("rim-stiffening")(scene(), {"stiffening": 1.1, "width": 0.01}).log_bending[0]
    np.testing.assert_allclose(field(np.array([[0.149, 0.0], [0.0, -0.12], [0.09, 0.0]])), [1.1, 0, 0], atol=1e-3)


@pytest.mark.parametrize("order", [1, -1])
def test_a_hem_lies_at_the_rim_of_a_cloth_cut_too_large(order):
    hem, cut = ("rim-stiffening", {"stiffening": 1.1, "width": 0.01}), ("cut-size", {"error": 0.004})
    made = TrueCase((3, 2), dict([hem, cut][::order]), VERTICES, STEPS).scene(1, 1)
    field = made.log_bending[-1]
    np.testing.assert_allclose(field(np.array([[0.153, 0.0], [0.0, -0.147], [0.0, 0.141]])), [1.1, 1.1, 0], atol=0.1)


def _one_case(vertices=150):
    system = SceneSystems(vertices, 5, "paper").system_of(scene())
    faces, hinges = len(system.elements.faces), len(system.elements.hinges)
    p = Parameters(
        np.ones((faces, 6, 4)), np.full((hinges, 3, 5), 1e-5), np.full(system.mesh.vertices, 1e-5), np.zeros(hinges)
    )
    return system, p


def test_bending_friction_opens_a_loop_of_its_couple():
    """At one hinge, moment over weight and B, going up less going down, is twice the hinge's share of HB / B."""
    system, p = _one_case()
    memory = law("bending-friction")(scene(), {"ratio": 30.0}).internal_variables[0](system, p, scene())
    scale, moments = system.elements.hinge_scale, {}
    for k in np.concatenate([np.arange(0, 80, 0.25), np.arange(80, -80, -0.25), np.arange(-80, 80, 0.25)]):
        angle = np.full(len(scale), k) / scale
        now, _ = memory.advance(system.mesh.flat, angle, p, 0.03)
        factor = now.bending[:, 0, 0] / 1e-5
        moments.setdefault(k, []).append((factor * (angle - now.rest_angle) * scale)[0])
    down, up = moments[0.0][-2:]
    assert up - down == pytest.approx(2 * 30 * 0.5**0.5, rel=0.05)


def test_shear_friction_opens_a_loop_of_its_stress():
    system, p = _one_case()
    limit = np.radians(2.0)
    memory = law("shear-friction")(scene(), {"ratio": 2.0}).internal_variables[0](system, p, scene())
    stress = {}
    way = np.concatenate([np.arange(0, 0.2, 1e-3), np.arange(0.2, -0.2, -1e-3), np.arange(-0.2, 0.2, 1e-3)])
    for shear in np.round(way, 6):
        x = system.mesh.flat.copy()
        x[:, 0] += shear * x[:, 1]
        now, force = memory.advance(x, np.zeros(len(p.rest_angle)), p, 0.03)
        work = (force[:, 0] * x[:, 1]).sum() / system.mesh.areas.sum()  # less the stress that it takes away
        stress.setdefault(shear, []).append(now.stretch[0, 0, 3] * shear - work)
    down, up = stress[0.0][-2:]
    assert up - down == pytest.approx(2 * limit, rel=0.05)


def test_creep_leaves_the_given_part_of_the_moment_and_is_half_forgotten_when_turned():
    system, p = _one_case()
    angle = np.linspace(-1, 1, len(p.rest_angle))
    start = law("creep")(scene(), {"loss": 0.3}).internal_variables[0]
    first = start(system, p, scene())
    kept = {"Creep": first.carried_over(angle)}
    flat = system.mesh.flat
    again = start(system, p, replace(scene(capture=2), carried_over=kept)).advance(flat, angle, p, 1e3)[0]
    np.testing.assert_allclose(angle - again.rest_angle, 0.7 * angle, atol=1e-12)
    turned = start(system, p, replace(scene("down", 3), carried_over=kept)).advance(system.mesh.flat, -angle, p, 1e-9)[
        0
    ]
    np.testing.assert_allclose(turned.rest_angle, -0.3 * 0.35 * angle, atol=1e-6)


def test_face_and_back_stiffen_as_asked():
    system, p = _one_case()
    value = {"asymmetry": 0.4}
    for side in ("up", "down"):
        memory = law("face-asymmetry")(scene(side), value).internal_variables[0](system, p, scene(side))
        convex = np.full(len(p.rest_angle), 40.0) / system.elements.hinge_scale
        ratio = memory.advance(system.mesh.flat, convex, p, 0.03)[0].bending[0, 0, 0] / 1e-5
        assert ratio == pytest.approx(1.4 if side == "up" else 0.6, rel=1e-3)


def test_a_tilted_plate_turns_gravity():
    for side, east in (("up", 1.0), ("down", -1.0)):
        one = law("plate-tilt")(scene(side), {"angle": 10.0, "direction": 0.0})
        pull = gravity_vector(one)
        np.testing.assert_allclose(
            pull, GRAVITY * np.array([east * np.sin(np.radians(10)), 0, -np.cos(np.radians(10))]), atol=1e-12
        )


@pytest.mark.parametrize("side", ["up", "down"])
def test_what_hangs_plumb_on_a_tilted_plate_is_seen_plumb(side):
    """The plate's frame, in which gravity is askew, is turned back for the camera; its axis leans downhill."""
    tilted = law("plate-tilt")(scene(side), {"angle": 10.0, "direction": 30.0})
    placed_exactly = replace(world_of("paper").fabric_of((5, 1)).variability, shift=0.0, turn=0.0)
    axis = np.array([0.0, 0.0, 1.0])
    plumb, leaning = seen_from_above(np.stack([gravity_vector(tilted), axis]), tilted, placed_exactly)
    np.testing.assert_allclose(plumb, [0, 0, -GRAVITY], atol=1e-12)
    np.testing.assert_allclose(leaning[:2], np.sin(np.radians(10)) * unit_vector(30.0), atol=1e-12)


def test_skewed_grain_of_a_quarter_turn_swaps_warp_and_weft():
    systems = SceneSystems(150, 5, "paper")
    plain = systems.system_of(scene()).elements
    turned = systems.system_of(scene(skew=(90.0, 90.0))).elements
    direction = plain.direction_low + plain.direction_fraction
    np.testing.assert_allclose(turned.direction_low + turned.direction_fraction, 2 - direction, atol=1e-9)
    np.testing.assert_allclose(turned.face_u, plain.face_v, atol=1e-9)


def test_a_threshold_moves_a_straight_edge_by_its_shift():
    """On a strip that lies askew, so that the pixels' own steps average out."""
    turn = np.radians(8.0)
    across, along = np.array([np.cos(turn), np.sin(turn), 0]), np.array([-np.sin(turn), np.cos(turn), 0])
    corners = np.array([a * 0.05 * across + b * 1.0 * along for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    widths = []
    for shift in (0.0, 1e-3, -1e-3):
        shade = 1 - photograph(corners, faces, law("threshold")(scene(), {"shift": shift})) / 255.0
        shade[shade < 0.03] = 0  # noise of the background, clipped at white
        widths.append(shade.sum(1).mean() * PIXEL * np.cos(turn))
    np.testing.assert_allclose(widths, [0.1, 0.102, 0.098], atol=6e-4)


@pytest.mark.parametrize("shift", [0.0, 3.5e-4, 1.4e-3, -2.8e-3])
def test_a_threshold_leaves_edges_as_soft_as_they_are_in_any_picture(shift):
    """Sharper ones would tell its label, however little it moves the outline."""
    angle, middle = np.linspace(0, 2 * np.pi, 400, endpoint=False), np.zeros((1, 3))
    radius = 0.125 + 0.012 * np.cos(6 * angle)
    outline = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(400)])
    faces = np.column_stack([np.zeros(400, int), 1 + np.arange(400), 1 + np.roll(np.arange(400), -1)])
    one = scene(noise=0.0)
    grey = []
    for taken in (one, law("threshold")(one, {"shift": shift})):
        shade = photograph(np.vstack([middle, outline]), faces, taken) / 255.0
        grey.append(np.count_nonzero((shade > 0.1) & (shade < 0.9)))
    assert grey[1] == pytest.approx(grey[0], rel=0.1)


def test_sheets_that_overlap_are_pushed_apart():
    system, p = _one_case(1200)
    x = system.mesh.flat.copy()
    fold = x[:, 0] > 0.11  # folded under, 1 mm below what was there
    x[fold, 0], x[fold, 2] = 0.22 - x[fold, 0], -1e-3
    force = contact.repulsion(system, p.mass, x, 2e-3)
    np.testing.assert_allclose(force.sum(0), 0, atol=1e-12)
    assert force[fold, 2].sum() < -1e-6
    assert np.abs(contact.repulsion(system, p.mass, x, 5e-4)).max() == 0
    assert np.abs(contact.repulsion(system, p.mass, system.mesh.flat, 5e-3)).max() == 0


def seen(points, name, **value):
    return law(name)(scene(), value).seen[0](np.array(points))


def test_the_camera_moves_what_it_sees_the_way_that_labels_and_effects_say():
    """Scale and offset by their values, what hangs low or lies far out smaller, a leaning axis as the package leans."""
    rim = [[0.12, 0.0, -0.04], [0.0, 0.12, -0.04], [-0.12, 0.0, -0.04], [0.0, -0.12, -0.04]]
    reach = np.hypot(*seen(rim, "camera-scale", error=0.1)[:, :2].T)
    assert reach.mean() == pytest.approx(1.1 * 0.12)
    moved = seen(rim, "camera-offset", shift=0.01, direction=90.0) - rim
    np.testing.assert_allclose(moved, np.tile([0, 0.01, 0], (4, 1)), atol=5e-3)
    assert moved[0, 1] > 4e-3
    far = 0.12 / (1 + 0.7 * 0.04)
    np.testing.assert_allclose(np.hypot(*seen(rim, "perspective", inverse_height=0.7)[:, :2].T), far, rtol=3e-3)
    assert (np.hypot(*seen(rim, "perspective", inverse_height=0.7)[:, :2].T) < far).all()
    flat = [[PLATE_RADIUS, 0.0, 0.0], [0.14, 0.0, 0.0]]
    edge, outer = seen(flat, "lens", strength=4.0)[:, 0]
    assert edge == pytest.approx(PLATE_RADIUS)
    assert outer < 0.139
    below = seen([[0.0, 0.0, -0.04]], "camera-tilt", angle=10.0, direction=30.0)[0, :2]
    expected = leaned(torch.tensor([[0.0, 0.0, -0.04]]), torch.tensor(10.0), torch.tensor(30.0))[0, :2].numpy()
    np.testing.assert_allclose(below, expected, rtol=0.02)


def test_plate_and_cloth_are_where_and_as_large_as_labels_say():
    assert law("plate-radius")(scene(), {"error": 0.002}).plate_radius == pytest.approx(PLATE_RADIUS + 0.002)
    assert law("cut-size")(scene(), {"error": 0.002}).radius == pytest.approx(CLOTH_RADIUS + 0.002)
    for side, east in (("up", 1), ("down", -1)):  # of the laboratory, seen from the cloth
        one = law("off-centre")(scene(side), {"shift": 0.01, "direction": 30.0})
        assert np.rad2deg(np.arctan2(one.centre[1], east * one.centre[0])) == pytest.approx(30)
        assert np.hypot(*one.centre) == pytest.approx(0.01, rel=0.5)
        wind = law("draught")(scene(side), {"speed": 1.0, "direction": 0.0}).pressures[0]
        assert (wind(np.array([[1.0, 0.0, 0.0]]))[0] > 0) == (side == "up")
    heavier = law("density-bias")(scene(), {"bias": 0.2}).log_mass[0](np.zeros((1, 2)))
    assert np.exp(heavier[0]) == pytest.approx(1.2, abs=0.06)
    assert sum(law("grain-skew")(scene(), {"angle": 5.0}).skew) / 2 == pytest.approx(5)


def test_effects_of_no_list_are_as_large_and_lie_where_their_parameters_say():
    seam = law("seam")(scene(), {"size": 1.0, "direction": 30.0, "offset": 0.05})
    on_it = 0.05 * unit_vector(120.0) + np.array([[-0.08], [0.0], [0.1]]) * unit_vector(30.0)
    np.testing.assert_allclose(np.exp(seam.log_bending[0](on_it)), 6.0)
    np.testing.assert_allclose(np.exp(seam.log_mass[0](on_it)), 2.0)
    np.testing.assert_allclose(seam.log_bending[0](on_it + 0.02 * unit_vector(120.0)), 0, atol=1e-6)
    (push,) = law("charge")(scene(), {"share": 0.4}).accelerations
    rim = CLOTH_RADIUS * unit_vector(70.0)
    np.testing.assert_allclose(push(np.array([[*rim, -0.03]]))[0], [*(0.4 * GRAVITY * unit_vector(70.0)), 0])
    (longer,) = law("frilled")(scene(), {"growth": 0.03}).growth
    np.testing.assert_allclose(longer(np.array([rim, 0.5 * rim])), [0.03, 0.03 / 64])
    (outline,) = law("elliptical-cut")(scene(), {"elongation": 0.02, "direction": 40.0}).outlines
    np.testing.assert_allclose(outline(np.radians([40.0, 130.0, 220.0])), [1.02, 0.98, 1.02])
    (ridge,) = law("crease-ring")(scene(), {"angle": 20.0, "radius": 0.12}).rest
    inside, top, outside = ridge(np.outer([0.118, 0.12, 0.122], unit_vector(70.0)))
    turned = np.degrees(np.arctan((top - inside) / 0.002) + np.arctan((top - outside) / 0.002))
    assert turned == pytest.approx(20.0)


def test_a_smear_runs_along_its_direction():
    """Of a small disc: the spread grows by that of a line of the length, along 30 degrees and not across."""
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    disc = np.column_stack([0.02 * np.cos(angle), 0.02 * np.sin(angle), 0 * angle])
    faces = np.column_stack([np.zeros(60, int), 1 + np.arange(60), 1 + np.roll(np.arange(60), -1)])
    spreads = []
    for one in (scene(noise=0.0), law("smear")(scene(noise=0.0), {"length": 24.0, "direction": 30.0})):
        shade = 1 - photograph(np.vstack([np.zeros(3), disc]), faces, one) / 255.0
        y, x = np.mgrid[:256, :256] - 127.5
        places = np.stack([x.ravel(), -y.ravel()])
        spreads.append(np.cov(places, aweights=shade.ravel(), ddof=0))
    along, across = unit_vector(30.0), unit_vector(120.0)
    more = spreads[1] - spreads[0]
    assert along @ more @ along == pytest.approx(24.0**2 / 12 * 10 / 8, rel=0.02)  # nine exposures, ends included
    assert abs(across @ more @ across) < 1


def test_labels_say_where_a_hem_is():
    plan = Plan("case_0001", 1, "single", {"rim-stiffening": {"stiffening": 1.1, "width": 0.01}}, 2.0, "typical")
    assert label_of(plan).content()["location"]["radius_m"] == pytest.approx([0.14, 0.15])
