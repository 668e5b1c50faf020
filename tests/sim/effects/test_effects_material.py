"""Effects of the material, and contact, against mechanics and geometry that are known exactly."""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy import ndarray

from cusick_bench.sim.cloth.heterogeneity import face_centres, hinge_centres
from cusick_bench.sim.cloth.material import Material, uniform_material
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.shape import smooth_field
from cusick_bench.sim.cloth.warp import cloth_circle
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS
from cusick_bench.sim.contact.barrier import smallest_distance
from cusick_bench.sim.contact.intersections import intersections
from cusick_bench.sim.effects import apply_all, effect, parse
from cusick_bench.sim.effects.material.grain_skew import skewed
from cusick_bench.sim.engine.dynamics.drop import drop
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.setup import Setup, drape_setups

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")

MESH = disc_mesh(150)
CLOTH = uniform_material(density=0.192, bending=2e-5)
WEIGHTLESS = 1e-300  # [m/s2]


def _setup(mesh: Mesh = MESH, **changes) -> Setup:
    height = smooth_field(1e-3, 0.03, np.random.default_rng(3))
    cloth = changes.pop("material", CLOTH)
    settings = changes.pop("settings", DrapeSettings(steps=20))
    return Setup(mesh, settings, cloth, laying=lambda p: torch.from_numpy(height(p.numpy())), **changes)


def _strip(rows: int, across: int, length: float = 0.1) -> Mesh:
    """Near-equilateral strip along x from 0 to `length`, with edges along y, so that it rolls up exactly."""
    h = length / rows
    lines, points = [], []
    for row in range(rows + 1):
        y = np.arange(across + 1.0) if row % 2 == 0 else np.concatenate([[0], np.arange(across) + 0.5, [across]])
        lines.append(len(points) + np.arange(len(y)))
        points += [(row * h, 2 * h / math.sqrt(3) * (value - across / 2)) for value in y]
    faces = []
    for left, right in itertools.pairwise(lines):
        i = j = 0
        while i + 1 < len(left) or j + 1 < len(right):
            next_left = points[left[i + 1]][1] if i + 1 < len(left) else np.inf
            next_right = points[right[j + 1]][1] if j + 1 < len(right) else np.inf
            faces.append(
                (left[i], right[j], left[i + 1]) if next_left < next_right else (left[i], right[j], right[j + 1])
            )
            i, j = (i + 1, j) if next_left < next_right else (i, j + 1)
    return Mesh(np.array(points), np.array(faces))


def _weightless(mesh: Mesh, fixed: ndarray) -> DrapeSystem:
    return DrapeSystem(mesh, "paper", WEIGHTLESS, fixed, np.zeros(mesh.vertices))


def _parameters(setup: Setup) -> Parameters:
    cloth = setup.cloth()
    return Parameters(
        cloth.stretch.reshape(-1, 6, 4).numpy(), cloth.bending.reshape(-1, 3, 5).numpy(),
        cloth.vertex_mass(setup.mesh).numpy(), setup.rest_angle().numpy(),
    )  # fmt: skip


def _rolled(mesh: Mesh, curvature: float) -> ndarray:
    """The strip on a cylinder about y: concave seen from its face where the curvature is positive."""
    x, y = mesh.material.T
    return np.column_stack([np.sin(curvature * x) / curvature, y, (1 - np.cos(curvature * x)) / curvature])


def _work_rate(force: Callable[[ndarray], ndarray], shape: Callable[[float], ndarray], at: float, step: float) -> float:
    """Generalised force that holds a shape of one parameter: work per change of the parameter."""
    velocity = (shape(at + step) - shape(at - step)) / (2 * step)
    return -float((force(shape(at)) * velocity).sum())


# --- rest curvature ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("curvature", "side"), [(20.0, "up"), (-20.0, "up"), (20.0, "down")])
def test_a_strip_without_weight_curls_to_its_radius_towards_its_face(curvature, side):
    """Face down, the strip is simulated in its mirror image: it curls away from above."""
    mesh = _strip(16, 3)
    setup = effect("rest-curvature").apply(_setup(mesh, side=side), {"curvature": curvature})
    system = _weightless(mesh, mesh.material[:, 0] < 0.1 / 16 + 1e-9)
    x = drop(system, _parameters(setup), mesh.flat, steps=150, step_seconds=0.05, record=False).positions[-1]
    points = x[mesh.material[:, 0] > 0.1 / 16 - 1e-9][:, [0, 2]]
    system_of_circle = np.column_stack([2 * points, np.ones(len(points))])
    (a, b, c), *_ = np.linalg.lstsq(system_of_circle, (points**2).sum(1), rcond=None)
    assert math.sqrt(c + a * a + b * b) == pytest.approx(1 / abs(curvature), rel=0.01)
    assert np.sign(b) == (np.sign(curvature) if side == "up" else -np.sign(curvature))


def test_the_cylinder_of_the_rest_curvature_is_free_of_stress_whatever_its_direction():
    mesh, curvature, degrees = disc_mesh(150), 30.0, 35.0
    setup = effect("rest-curvature").apply(_setup(mesh), {"curvature": curvature, "direction": degrees})
    n = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    s, t = mesh.material @ n, mesh.material @ [-n[1], n[0]]
    along, height = np.sin(curvature * s) / curvature, (1 - np.cos(curvature * s)) / curvature
    x = np.column_stack([along[:, None] * n + t[:, None] * [-n[1], n[0]], height])
    system = _weightless(mesh, np.zeros(mesh.vertices, bool))
    bending_only = Parameters(
        np.zeros((1, 6, 4)), np.ones((1, 3, 5)), np.zeros(mesh.vertices), _parameters(setup).rest_angle
    )
    curled = system.forces(x, x, bending_only, exact=True)[2]
    flat = system.forces(mesh.flat, mesh.flat, bending_only, exact=True)[2]
    assert curled < 1e-20 * flat
    area = mesh.areas.sum()
    assert flat == pytest.approx(0.5 * curvature**2 * area, rel=0.15)  # a plate of unit stiffness, on a coarse disc


def test_rest_curvature_follows_the_grain():
    curl = effect("rest-curvature")
    turned = apply_all([parse("grain-skew:angle=20"), parse("rest-curvature:direction=10")], _setup())
    torch.testing.assert_close(turned.rest_angle(), curl.apply(_setup(), {"direction": 30.0}).rest_angle())


# --- faces ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", ["up", "down"])
def test_moments_of_either_bending_are_as_one_plus_to_one_minus_the_asymmetry(side):
    mesh, a = _strip(10, 3), 0.3
    setup = effect("face-asymmetry").apply(_setup(mesh, side=side), {"asymmetry": a})
    system = _weightless(mesh, np.zeros(mesh.vertices, bool))
    p = replace(_parameters(setup), stretch=np.zeros((1, 6, 4)))  # bending alone: chords are shorter than arcs
    state = setup.states[0].start(system, p)

    def force(x: ndarray) -> ndarray:
        changed, q = state.advance(system, p, x, 0.0)
        return changed.forces(x, x, q, exact=False)[0]

    up, down = (_work_rate(force, lambda k: _rolled(mesh, k), curvature, 1e-4) for curvature in (-8.0, 8.0))
    elastic = _work_rate(lambda x: system.forces(x, x, p, exact=False)[0], lambda k: _rolled(mesh, k), -8.0, 1e-4)
    convex, concave = (up, down) if side == "up" else (down, up)  # of the cloth's face, which lies below if down
    assert abs(convex / concave) == pytest.approx((1 + a) / (1 - a), rel=1e-9)
    assert abs(convex) == pytest.approx((1 + a) * abs(elastic), rel=1e-9)


# --- grain ------------------------------------------------------------------------------------------------------------


def _anisotropic() -> Material:
    generator = np.random.default_rng(5)
    stretch = generator.uniform(50, 200, (6, 4))
    stretch[:, 1] *= 0.1
    return Material(
        torch.from_numpy(stretch), torch.from_numpy(generator.uniform(1e-5, 5e-5, (3, 5))), torch.tensor(0.192)
    )


@pytest.mark.parametrize("law", ["paper", "plate"])
def test_a_skew_of_ninety_degrees_swaps_warp_and_weft(law):
    cloth, settings = _anisotropic(), DrapeSettings(steps=20, law=law)
    stretch = cloth.stretch[[0, 5, 4, 3, 2, 1]][:, [2, 1, 0, 3]]
    swapped = Material(stretch, cloth.bending.flip(0), cloth.density)
    turned, expected = drape_setups(
        [_setup(skewed(MESH, 90.0), material=cloth, settings=settings), _setup(material=swapped, settings=settings)]
    )
    assert turned is not None
    assert expected is not None
    assert expected[:, 2].min() < -0.01
    torch.testing.assert_close(turned, expected, rtol=0, atol=1e-9)


def test_the_warp_turns_counter_clockwise():
    """Pulled along the turned warp, the energy is that of the warp's stiffness alone."""
    cloth = uniform_material(density=0.2, bending=1e-5, stretch=300.0, shear=1e-3)
    cloth.stretch[:, 2] = 1e-3  # no weft
    setup = effect("grain-skew").apply(_setup(material=cloth), {"angle": 25.0})
    energy = []
    for degrees in (25.0, -25.0):
        n = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
        strain = 1e-4
        x = np.column_stack([setup.mesh.material @ (np.eye(2) + strain * np.outer(n, n)), np.zeros(MESH.vertices)])
        system = _weightless(setup.mesh, np.zeros(MESH.vertices, bool))
        energy.append(system.forces(x, x, _parameters(setup), exact=True)[2])
    assert energy[0] == pytest.approx(0.5 * 300 * strain**2 * MESH.areas.sum(), rel=1e-3)
    assert energy[1] == pytest.approx(energy[0] * math.cos(math.radians(50)) ** 4, rel=1e-2)


def test_equal_skews_share_one_mesh():
    one, two = (effect("grain-skew").apply(_setup(), {"angle": 2.0}) for _ in range(2))
    assert one.mesh is two.mesh
    np.testing.assert_array_equal(one.mesh.material, MESH.material)


# --- density and patches ----------------------------------------------------------------------------------------------


def test_a_biased_density_is_another_density():
    heavier = uniform_material(density=0.192 * (1 + 0.2), bending=2e-5)
    biased, expected = drape_setups([effect("density-bias").apply(_setup(), {"bias": 0.2}), _setup(material=heavier)])
    assert biased is not None
    assert expected is not None
    assert torch.equal(biased, expected)


def _integral(mesh: Mesh, values: torch.Tensor) -> float:
    return float(torch.from_numpy(mesh.areas) @ values)


def _at(radius: float, degrees: float) -> torch.Tensor:
    angle = math.radians(degrees)
    return torch.tensor([[radius * math.cos(angle), radius * math.sin(angle)]], dtype=torch.float64)


def test_a_stiff_patch_has_its_factor_at_its_centre_and_its_integral():
    fine = disc_mesh(2699)
    setup = parse("local-stiff-patch:stiffening=1.5,direction=130,radius=0.07,size=0.015").apply(_setup(fine))
    (log,) = setup.log_bending
    assert float(log(_at(0.07, 130.0))) == pytest.approx(1.5, rel=1e-12)
    assert float(log(_at(0.07 + 0.015, 130.0))) == pytest.approx(1.5 * math.exp(-0.5), rel=1e-12)
    integral = _integral(fine, log(torch.from_numpy(face_centres(fine))))
    assert integral == pytest.approx(1.5 * 2 * math.pi * 0.015**2, rel=1e-3)
    assert setup.cloth().stretch.shape == (6, 4)
    ratio = setup.cloth().bending[:, 0, 0] / CLOTH.bending[0, 0]
    assert float(ratio.max()) == pytest.approx(math.exp(1.5), rel=0.05)


@pytest.mark.parametrize("mass", [1.0, -0.5])
def test_a_heavy_patch_adds_its_grams(mass):
    fine = disc_mesh(2699)
    base, setup = _setup(fine), effect("local-mass-patch").apply(
        _setup(fine), {"mass": mass, "direction": -40.0, "radius": 0.08, "size": 0.015}
    )  # fmt: skip
    added = (setup.cloth().vertex_mass(fine).sum() - base.cloth().vertex_mass(fine).sum()) * 1e3
    assert float(added) == pytest.approx(192 * mass * 2 * math.pi * 0.015**2, rel=1e-3)  # 0.192 kg/m2 in g/m2
    assert float(setup.log_mass[0](_at(0.08, -40.0)).exp()) == pytest.approx(1 + mass, rel=1e-12)


def test_what_of_a_patch_lies_beyond_the_rim_is_not_added():
    """At the usual place as much as its description says."""
    fine, patch = disc_mesh(2699), effect("local-mass-patch")
    mass = [float(setup.cloth().vertex_mass(fine).sum()) for setup in (_setup(fine), patch.apply(_setup(fine), {}))]
    lost = 1 - (mass[1] - mass[0]) / (0.192 * 2 * math.pi * 0.02**2)
    assert lost == pytest.approx(0.12, abs=5e-3)
    assert f"{lost:.0%}".replace("%", " %") in patch.physics


@pytest.mark.parametrize("name", ["local-stiff-patch", "local-mass-patch"])
def test_a_patch_beside_a_small_cloth_is_refused(name):
    """The usual place is on the standard's cloth; of one of 24 cm it lies beyond the rim."""
    small = _setup(disc_mesh(150, radius=0.12, plate_radius=0.072), settings=DrapeSettings(plate_radius=0.072))
    for setup in (small, parse("cut-size:error=0.01").apply(small)):
        with pytest.raises(SimulationError, match=r"radius is 0\.12 m, got one centred 0\.125 m.*as radius=0\.096$"):
            parse(name).apply(setup)
        assert parse(f"{name}:radius=0.096").apply(setup) is not setup


def test_the_rim_has_its_factor_and_the_plate_has_none():
    setup = parse("rim-stiffening:stiffening=1.2,width=0.01").apply(_setup())
    (log,) = setup.log_bending
    for degrees in (0.0, 77.0, 200.0):
        assert float(log(_at(CLOTH_RADIUS, degrees))) == pytest.approx(1.2, rel=1e-9)
        assert float(log(_at(CLOTH_RADIUS - 0.01, degrees))) == pytest.approx(1.2 / math.e, rel=1e-9)
        assert abs(float(log(_at(PLATE_RADIUS, degrees)))) < 0.003 * 1.2


@pytest.mark.parametrize("side", ["up", "down"])
@pytest.mark.parametrize("moved", ["off-centre:shift=0.01,direction=30", "plate-slip:slide=0.01"])
def test_a_patch_lies_at_its_place_of_a_cloth_beside_the_axis(moved, side):
    """Added mass lies about the cloth's own middle plus the patch's place, in whichever order effects come."""
    patch = parse("local-mass-patch:mass=2,direction=130,radius=0.12,size=0.01")
    bare = parse(moved).apply(replace(_setup(disc_mesh(2699)), side=side))
    first, last = parse(moved).apply(patch.apply(replace(_setup(disc_mesh(2699)), side=side))), patch.apply(bare)
    assert torch.equal(first.cloth().density, last.cloth().density)
    added = torch.from_numpy(bare.mesh.areas) * (last.cloth().density - bare.cloth().density)
    middle = (added @ torch.from_numpy(face_centres(bare.mesh)) / added.sum()).numpy()
    place = cloth_circle(bare.mesh)[0] + _at(0.12, 130.0).numpy()[0]
    assert np.abs(middle - place).max() < 5e-4


@pytest.mark.parametrize("moved", ["off-centre:shift=0.02,direction=30", "plate-slip:slide=0.02"])
def test_stiffness_and_rest_shape_lie_on_the_cloth_wherever_it_lies(moved):
    """Both faces of a specimen, moved to opposite sides in its own frame, have one field."""
    bump, place, mesh = _at(0.12, 130.0), [], disc_mesh(2699)
    for side in ("up", "down"):
        setup = replace(
            _setup(mesh),
            side=side,
            rest=lambda points: 1e-3 * torch.exp(-((points - bump) ** 2).sum(1) / (2 * 0.01**2)),
        )
        setup = parse(moved).apply(parse("stiffness-field:spread=0.5").apply(setup))
        centre = cloth_circle(setup.mesh)[0]
        assert np.hypot(*centre) == pytest.approx(0.02, abs=1e-9)
        points = torch.from_numpy(hinge_centres(setup.mesh) - centre)
        factor = setup.cloth().bending[:, 0, 0] / CLOTH.bending[0, 0]
        assert torch.allclose(factor, setup.log_bending[0](points).exp(), rtol=1e-9)
        weight = setup.rest_angle().abs()
        place.append((weight @ points / weight.sum()).numpy())
    assert np.abs(place - bump.numpy()).max() < 1e-3


@pytest.mark.parametrize("moved", ["cut-size:error=-0.006", "off-centre:shift=0.01,direction=30"])
def test_a_stiff_rim_lies_at_the_rim_whichever_effect_comes_first(moved):
    rim, cut = parse("rim-stiffening:stiffening=1.2,width=0.005"), parse(moved)
    first, last = cut.apply(rim.apply(_setup())), rim.apply(cut.apply(_setup()))
    assert torch.equal(first.cloth().bending, last.cloth().bending)


# --- stiffness field --------------------------------------------------------------------------------------------------


def test_the_field_has_its_spread_and_its_length_and_is_the_specimens():
    spread, length = 0.3, 0.04
    points = torch.tensor([[0.0, 0.0], [length, 0.0], [0.0, 2 * length], [0.05, -0.1]], dtype=torch.float64)
    draws = {"stretch": [], "bending": []}
    for specimen in range(2000):
        setup = parse(f"stiffness-field:spread={spread},length={length}").apply(_setup(specimen_seed=(7, specimen)))
        draws["stretch"].append(setup.log_stretch[0](points))
        draws["bending"].append(setup.log_bending[0](points))
    values = {name: torch.stack(found).numpy() for name, found in draws.items()}
    for found in values.values():
        assert found.mean(0) == pytest.approx(np.zeros(4), abs=4 * spread / math.sqrt(2000))
        assert found.std(0) == pytest.approx(np.full(4, spread), rel=0.06)
        correlation = np.corrcoef(found.T)
        assert correlation[0, 1] == pytest.approx(math.exp(-0.5), abs=0.06)
        assert correlation[0, 2] == pytest.approx(math.exp(-2.0), abs=0.09)
    assert abs(np.corrcoef(values["stretch"][:, 0], values["bending"][:, 0])[0, 1]) < 0.09


def test_the_field_belongs_to_the_specimen_and_not_to_its_laying():
    field = effect("stiffness-field")
    base = field.apply(_setup(), {}).cloth().bending
    assert torch.equal(field.apply(_setup(laying_seed=(9,)), {}).cloth().bending, base)
    assert not torch.equal(field.apply(_setup(specimen_seed=(9,)), {}).cloth().bending, base)


def test_two_fields_on_one_cloth_are_drawn_each_by_itself():
    one = parse("stiffness-field:spread=0.3,length=0.04")
    points = torch.as_tensor(MESH.material)
    alone, both = one.apply(_setup()), apply_all([one, one], _setup())
    first, second = (field(points) for field in both.log_bending)
    assert torch.equal(first, alone.log_bending[0](points))
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.7
    assert (both.specimen_seed, both.laying_seed) == (alone.specimen_seed, alone.laying_seed)


# --- self-contact -----------------------------------------------------------------------------------------------------


def test_contact_keeps_folds_apart_that_passed_through_each_other():
    """Layers that press on each other rest at about half the thickness, where the barrier carries them."""
    pytest.importorskip("ipctk", reason="self-contact needs ipctk; pip install 'cusick-bench[contact]'")
    thickness, mesh = 1e-3, disc_mesh(300, plate_radius=0.04)
    limp = uniform_material(density=0.25, bending=1e-6)
    height = smooth_field(1e-3, 0.03, np.random.default_rng([0, 0]))
    base = Setup(mesh, DrapeSettings(plate_radius=0.04), limp, laying=lambda p: torch.from_numpy(height(p.numpy())))
    through, apart = drape_setups([base, effect("self-contact").apply(base, {"thickness": thickness})])
    assert through is not None
    assert apart is not None
    assert intersections(mesh, through.numpy()) > 0
    assert intersections(mesh, apart.numpy()) == 0
    assert 0.4 * thickness < smallest_distance(mesh, apart.numpy()) < thickness
