"""Effects of the support and the cut against geometry and statics that are known exactly."""

import math
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
import torch

from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.shape import smooth_field
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.effects import apply_all, effect, parse
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.setup import Setup, drape_setups

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")

MESH = disc_mesh(150)
DROP = DrapeSettings(steps=20)
BOUNDARY = ("off-centre", "plate-tilt", "plate-radius", "plate-slip", "cut-size")


def _setup(mesh: Mesh = MESH, **changes) -> Setup:
    field = smooth_field(1e-3, 0.03, np.random.default_rng(3))
    cloth = uniform_material(density=0.192, bending=2e-5)
    laying = torch.from_numpy(field(mesh.material))
    return Setup(mesh, changes.pop("settings", DROP), cloth, laying=laying, **changes)


def _ring(mesh: Mesh, near: float) -> np.ndarray:
    """Distances from the axis of the vertices that lie on a circle of the unchanged mesh."""
    return np.hypot(*mesh.material[np.isclose(np.hypot(*MESH.material.T), near, atol=1e-6)].T)


def _mass(setup: Setup) -> float:
    return float(setup.cloth().vertex_mass(setup.mesh).sum())


def test_off_centre_widens_the_overhang_on_one_side_and_keeps_the_mass():
    setup = parse("off-centre:shift=0.004,direction=30").apply(_setup())
    rim = setup.mesh.material[MESH.boundary] - 0.004 * np.array([math.cos(math.pi / 6), 0.5])
    np.testing.assert_allclose(np.hypot(*rim.T), CLOTH_RADIUS, atol=1e-12)
    width = np.hypot(*setup.mesh.material[MESH.boundary].T) - PLATE_RADIUS
    assert width.max() - width.min() == pytest.approx(0.008, rel=0.01)  # vertices may not lie in the very direction
    np.testing.assert_allclose(_ring(setup.mesh, PLATE_RADIUS), PLATE_RADIUS, atol=1e-12)
    assert _mass(setup) == pytest.approx(_mass(_setup()), rel=1e-12)


@pytest.mark.parametrize("error", [-0.01, 0.003])
def test_plate_radius_is_met_and_the_cloth_keeps_its_size(error):
    setup = effect("plate-radius").apply(_setup(), {"error": error})
    assert setup.held == PLATE_RADIUS + error
    np.testing.assert_allclose(_ring(setup.mesh, PLATE_RADIUS), PLATE_RADIUS + error, atol=1e-12)
    np.testing.assert_array_equal(_ring(setup.mesh, CLOTH_RADIUS), _ring(MESH, CLOTH_RADIUS))
    fixed = DrapeSimulator(setup.mesh, setup.settings).system.fixed
    np.testing.assert_array_equal(fixed, DrapeSimulator(MESH, DROP).system.fixed)


@pytest.mark.parametrize("error", [-0.01, 0.004])
def test_cut_size_is_met_about_the_cloths_own_centre(error):
    setup = apply_all([parse("off-centre:shift=0.005,direction=90"), parse(f"cut-size:error={error}")], _setup())
    rim = setup.mesh.material[MESH.boundary] - np.array([0, 0.005])
    np.testing.assert_allclose(np.hypot(*rim.T), CLOTH_RADIUS + error, atol=1e-12)
    np.testing.assert_allclose(_ring(setup.mesh, PLATE_RADIUS), PLATE_RADIUS, atol=1e-12)
    assert _mass(setup) == pytest.approx(_mass(_setup()) * (1 + error / CLOTH_RADIUS) ** 2, rel=1e-9)


@pytest.mark.parametrize("order", list(permutations(range(4))))
def test_moves_are_one_in_any_order(order):
    texts = ["off-centre:shift=0.01,direction=30", "off-centre:shift=0.006", "plate-radius:error=-0.01"]
    causes = [parse(text) for text in [*texts, "cut-size:error=0.01"]]
    setup = apply_all([causes[i] for i in order], _setup())
    distance = np.hypot(*MESH.material.T)
    outward = MESH.material / np.maximum(distance, 1e-12)[:, None]
    shift = np.array([0.01 * math.cos(math.pi / 6) + 0.006, 0.005])
    edge, rim = (PLATE_RADIUS - 0.01) * outward, shift + (CLOTH_RADIUS + 0.01) * outward
    way = np.maximum((distance - PLATE_RADIUS) / (CLOTH_RADIUS - PLATE_RADIUS), 0)[:, None]
    inside = np.minimum(distance / PLATE_RADIUS, 1)[:, None]
    np.testing.assert_allclose(setup.mesh.material, (1 - way) * inside * edge + way * rim, atol=1e-12)
    assert setup.held == pytest.approx(PLATE_RADIUS - 0.01, rel=1e-12)


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_a_cause_may_stand_before_the_one_that_makes_room_for_it(order):
    texts = ["plate-radius:error=0.01", "off-centre:shift=0.025", "cut-size:error=0.01"]
    setup = apply_all([parse(texts[i]) for i in order], _setup(disc_mesh(150, radius=0.12)))
    assert np.hypot(*setup.mesh.material[setup.mesh.boundary].T).min() == pytest.approx(0.105, abs=2e-4)
    assert setup.held == pytest.approx(0.1, rel=1e-12)
    with pytest.raises(SimulationError, match=r"beyond the plate of radius 0\.1 m"):
        apply_all([parse(texts[i]) for i in order], _setup(disc_mesh(150, radius=0.11)))


def test_a_mesh_that_was_exchanged_is_the_one_that_is_moved():
    moved = parse("off-centre:shift=0.01").apply(_setup())
    other = disc_mesh(200)
    again = parse("cut-size:error=0.004").apply(replace(moved, mesh=other)).mesh
    np.testing.assert_array_equal(again.material, parse("cut-size:error=0.004").apply(_setup(other)).mesh.material)


@pytest.mark.parametrize("text", ["off-centre:shift=0.01", "plate-radius:error=0.005", "cut-size:error=-0.008"])
def test_a_cloth_laid_otherwise_is_flat_and_free_of_strain(text):
    setup = parse(text).apply(Setup(MESH, DROP, uniform_material(density=0.192, bending=2e-5)))
    laid = setup.initial().numpy()
    system = DrapeSimulator(setup.mesh, setup.settings).system
    np.testing.assert_array_equal(laid[:, :2], setup.mesh.material)
    first, second = (laid[setup.mesh.faces[:, k]] - laid[setup.mesh.faces[:, 0]] for k in (1, 2))
    areas = 0.5 * np.cross(first, second)[:, 2]
    np.testing.assert_allclose(areas, system.elements.face_area, rtol=1e-12)


def _sag(setup: Setup) -> float:
    """Mean height of the rim of a stiff cloth, whose shallow rest has no folds to choose from [m]."""
    stiff = uniform_material(density=0.192, bending=2e-3)
    plain = Setup(setup.mesh, DrapeSettings(mode="equilibrium", plate_radius=setup.held), stiff)
    (shape,) = drape_setups([plain])
    assert shape is not None
    return float(shape[torch.from_numpy(setup.mesh.boundary), 2].mean())


@pytest.mark.parametrize(
    ("text", "sizes"),
    [("plate-radius:error=0.008", {"plate_radius": 0.098}), ("cut-size:error=0.008", {"radius": 0.158})],
)
def test_a_warped_mesh_sags_as_a_mesh_made_for_it(text, sizes):
    warped = parse(text).apply(_setup(disc_mesh(400)))
    made = Setup(disc_mesh(400, **sizes), warped.settings, warped.material)
    sag, expected, before = _sag(warped), _sag(made), _sag(_setup(disc_mesh(400)))
    assert abs(sag - expected) < 0.1 * abs(expected - before)  # stretched triangles bend a little otherwise


def test_a_tilted_plate_rests_under_turned_gravity():
    angle, downhill = math.radians(12), np.array([math.cos(math.radians(40)), math.sin(math.radians(40)), 0])
    settings = DrapeSettings(mode="equilibrium")
    (shape,) = drape_setups([parse("plate-tilt:angle=12,direction=40").apply(_setup(settings=settings))])
    assert shape is not None
    across = np.cross([0, 0, 1], downhill)
    frame = np.stack([math.cos(angle) * downhill - math.sin(angle) * np.array([0, 0, 1]), across])
    basis = np.column_stack([downhill, across, [0, 0, 1]])  # of the level plate
    tilted = np.column_stack([*frame, np.cross(*frame)])
    level = shape.numpy() @ tilted @ basis.T
    system = DrapeSimulator(MESH, settings).system
    np.testing.assert_allclose(level[system.fixed], MESH.flat[system.fixed], atol=1e-12)
    cloth = _setup().cloth()
    mass = cloth.vertex_mass(MESH).numpy()
    weight = mass[:, None] * settings.gravity
    force = _elastic(system, level, cloth, mass) + weight * (math.sin(angle) * downhill - [0, 0, math.cos(angle)])
    assert np.abs(force[~system.fixed]).max() < 1e-7 * weight.sum()
    wrong = _elastic(system, level, cloth, mass) - weight * [0, 0, 1]
    assert np.abs(wrong[~system.fixed]).max() > 1e-4 * weight.sum()


def _elastic(system, shape, cloth, mass) -> np.ndarray:
    p = Parameters(cloth.stretch.numpy()[None], cloth.bending.numpy()[None], mass, np.zeros(len(MESH.hinges)))
    force = system.forces(np.ascontiguousarray(shape), MESH.flat, p, exact=True)[0]
    return force + mass[:, None] * [0, 0, system.gravity]


def test_a_tilted_drape_is_differentiable_to_its_angle_and_direction():
    weights = torch.from_numpy(np.random.default_rng(0).normal(size=(MESH.vertices, 3)))

    def measure(angle, direction):
        value = {"angle": angle, "direction": direction}
        (shape,) = drape_setups([effect("plate-tilt").apply(_setup(settings=DrapeSettings(steps=8)), value)])
        assert shape is not None
        return (shape * weights).sum()

    at = [torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in (5.0, 20.0)]
    found = torch.autograd.grad(measure(*at), at)
    step = 1e-4
    for k in (0, 1):
        high, low = ([v.item() + sign * step * (k == i) for i, v in enumerate(at)] for sign in (1, -1))
        assert found[k].item() == pytest.approx(float(measure(*high) - measure(*low)) / (2 * step), rel=1e-5)


def test_plate_slip_goes_as_far_every_time_and_anywhere():
    cause = parse("plate-slip:slide=0.006")
    centres = []
    for laying in range(400):
        mesh = cause.apply(Setup(MESH, DROP, _setup().material, laying_seed=(7, laying))).mesh
        centres.append((mesh.material - MESH.material)[MESH.boundary].mean(0))
    centres = np.array(centres)
    np.testing.assert_allclose(np.hypot(*centres.T), 0.006, rtol=1e-9)
    angle = np.arctan2(centres[:, 1], centres[:, 0])
    for m in (1, 2, 3):  # Rayleigh's test: of 400 uniform angles, |mean exp(i m a)| > .13 once in a thousand times
        assert abs(np.exp(1j * m * angle).mean()) < 0.13
    assert cause.apply(_setup(laying_seed=(7, 1))).mesh is cause.apply(_setup(laying_seed=(7, 1))).mesh


def test_two_slips_go_in_directions_of_their_own():
    cause = parse("plate-slip:slide=0.003")
    once, twice = (apply_all(causes, _setup(laying_seed=(7, 1))).mesh for causes in ([cause], [cause, cause]))
    first, both = ((mesh.material - MESH.material)[MESH.boundary].mean(0) for mesh in (once, twice))
    assert np.hypot(*first) == pytest.approx(0.003)
    assert np.hypot(*(both - first)) == pytest.approx(0.003)
    assert not np.allclose(both, 2 * first, atol=1e-4)


@pytest.mark.parametrize("name", BOUNDARY)
def test_face_down_the_laboratorys_side_stays_where_it_is(name):
    value = {"direction": 25.0} if any(p.name == "direction" for p in effect(name).parameters) else {}
    up, down = (effect(name).apply(_setup(side=side), value) for side in ("up", "down"))
    flat = [setup.to_camera(setup.initial()).numpy() for setup in (up, down)]
    rims = [shape[MESH.boundary].mean(0) for shape in flat]
    slopes = [np.linalg.lstsq(shape[:, :2], shape[:, 2], rcond=None)[0] for shape in flat]
    np.testing.assert_allclose(rims[0][:2], rims[1][:2], atol=1e-9)
    np.testing.assert_allclose(slopes[0], slopes[1], atol=5e-3)  # the laid-down undulation has a slope of its own


@pytest.mark.parametrize("name", BOUNDARY)
def test_equal_setups_share_a_mesh_and_small_causes_change_little(name):
    cause, tiny = effect(name), {effect(name).severity.name: 1e-7}
    assert cause.apply(_setup(), {}).mesh is cause.apply(_setup(), {}).mesh
    changed = cause.apply(_setup(), tiny).initial() - _setup().initial()
    assert 0 < float(changed.abs().max()) < 1e-6


def test_grain_goes_with_a_displaced_cloth():
    quarter = np.array([[0.0, 1.0], [-1.0, 0.0]])
    skewed = Mesh(MESH.material, MESH.faces, MESH.material[MESH.faces] @ quarter)
    moved = parse("off-centre:shift=0.01,direction=70").apply(_setup(skewed)).mesh
    np.testing.assert_allclose(moved.corners, moved.material[MESH.faces] @ quarter, atol=1e-12)


def test_a_cloth_that_leaves_the_plate_is_refused():
    small = disc_mesh(150, radius=0.11)
    with pytest.raises(SimulationError, match=r"reach beyond the plate of radius 0\.09 m.*smaller severity"):
        parse("off-centre:shift=0.025").apply(_setup(small))


def test_a_cloth_that_nearly_leaves_the_plate_is_refused_in_the_same_words():
    """Its rim is a polygon, whose sides come nearer than its corners."""
    small = disc_mesh(150, radius=0.12)
    with pytest.raises(SimulationError, match=r"reach beyond the plate of radius 0\.09 m.* as near as 0\.0900"):
        parse("off-centre:shift=0.03").apply(_setup(small))
