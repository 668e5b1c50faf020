"""Effects with internal variables: closed loops of the stated width, relaxation by its share, and how they mix."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
import pytest
import torch
from numpy import ndarray

from cusick_bench.sim.cloth.material import Material, uniform_material
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.shape import smooth_field
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.effects import apply_all, effect, parse
from cusick_bench.sim.effects.history.bending_friction import YIELD_CURVATURE, MomentFriction
from cusick_bench.sim.effects.history.shear_friction import YIELD_SHEAR
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.engine.strains import HINGE_SHARE
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.errors import DrapeDiverged, SimulationError
from cusick_bench.sim.history import Rank, State, StateLaw, drop_with_history
from cusick_bench.sim.reference.tables import weights_bending_paper
from cusick_bench.sim.setup import Setup, drape_setups

pytestmark = pytest.mark.usefixtures("one_thread", "one_torch_thread")

MESH = disc_mesh(150)
CLOTH = uniform_material(density=0.192, bending=2e-5)
STATEFUL = ("face-asymmetry", "creep", "bending-friction", "shear-friction")


def _setup(mesh: Mesh = MESH, **changes) -> Setup:
    height = smooth_field(1e-3, 0.03, np.random.default_rng(3))
    cloth = changes.pop("material", CLOTH)
    settings = changes.pop("settings", DrapeSettings(steps=20))
    return Setup(mesh, settings, cloth, laying=lambda p: torch.from_numpy(height(p.numpy())), later=True, **changes)


def _hexagon(cells: int, side: float) -> Mesh:
    """Equilateral triangles in a hexagon: an isotropic plate, whose hinges hold exactly its bending stiffness."""
    points, at = [], {}
    for i, j in itertools.product(range(-cells, cells + 1), repeat=2):
        if abs(i + j) <= cells:
            at[i, j] = len(points)
            points.append((side * (i + j / 2), side * math.sqrt(3) / 2 * j))
    up = [(at[i, j], at.get((i + 1, j)), at.get((i, j + 1))) for i, j in at]
    down = [(at[i, j], at.get((i, j + 1)), at.get((i - 1, j + 1))) for i, j in at]
    return Mesh(np.array(points), np.array([face for face in up + down if None not in face]))


def _loose(mesh: Mesh) -> DrapeSystem:
    return DrapeSystem(mesh, "paper", 1e-300, np.zeros(mesh.vertices, bool), np.zeros(mesh.vertices))


def _parameters(mesh: Mesh, material: Material, *, bends_only: bool) -> Parameters:
    stretch = material.stretch.numpy().reshape(1, 6, 4) * (0.0 if bends_only else 1.0)
    bending = material.bending.numpy().reshape(1, 3, 5)
    return Parameters(stretch, bending, material.vertex_mass(mesh).numpy(), np.zeros(len(mesh.hinges)))


def _rolled(mesh: Mesh, curvature: float, degrees: float = 90.0) -> ndarray:
    """The sheet rolled up along a direction: convex seen from its face where the curvature is positive."""
    n = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    s, t = mesh.material @ n, mesh.material @ [-n[1], n[0]]
    along, height = (
        s * np.sinc(curvature * s / np.pi),
        -0.5 * curvature * s**2 * np.sinc(curvature * s / (2 * np.pi)) ** 2,
    )
    return np.column_stack([np.outer(along, n) + np.outer(t, [-n[1], n[0]]), height])


def _sheared(mesh: Mesh, angle: float) -> ndarray:
    """A trellis: threads keep their length, and the angle between them opens or closes."""
    half = angle / 2
    return np.column_stack(
        [mesh.material @ [math.cos(half), math.sin(half)], mesh.material @ [math.sin(half), math.cos(half)],
         np.zeros(mesh.vertices)]
    )  # fmt: skip


def _path(shape, mesh: Mesh, law: StateLaw, parameters: Parameters, path: Sequence[float]) -> ndarray:
    """Generalised force per area along a path of one deformation parameter."""
    system, area, found = _loose(mesh), mesh.areas.sum(), []
    state, step = law.start(system, parameters), 1e-6
    for value in path:
        x = shape(mesh, value)
        now, p = state.advance(system, parameters, x, 0.0)
        velocity = (shape(mesh, value + step) - shape(mesh, value - step)) / (2 * step)
        found.append(-(now.forces(x, x, p, exact=False)[0] * velocity).sum() / area)
    return np.array(found)


def _loop(at: float, most: float, first: float) -> list[float]:
    """To `first`, to the end, back past `at`, to the other end, again past `at`, and to the end.

    The elements are rate-independent, so steps of any size along a straight path are exact.
    """
    return [first, most, at, -most, at, most]


# --- bending ----------------------------------------------------------------------------------------------------------


def _hinge_area(mesh: Mesh, side: float) -> float:
    """Share of a lattice that its hinges stand for: those of the rim are missing."""
    return len(mesh.hinges) * math.sqrt(3) / 2 * side**2 / 3 / mesh.areas.sum()


@pytest.mark.parametrize(("degrees", "magnitudes"), [(90.0, 1.0), (0.0, 5 / 3)])
@pytest.mark.parametrize("ratio", [20.0, 120.0])
def test_bending_is_a_closed_loop_on_a_lattice(ratio, degrees, magnitudes):
    """Across edges only one family of hinges bends; along them two by 2/3, and one by -1/3, of the curvature."""
    side, b, early, most = 0.005, 2e-5, 0.2 * YIELD_CURVATURE, 15.0
    mesh = _hexagon(6, side)
    law = effect("bending-friction").apply(_setup(), {"ratio": ratio}).states[0]
    p, rolled = _parameters(mesh, CLOTH, bends_only=True), partial(_rolled, degrees=degrees)
    start, first, fall, _, rise, again = _path(rolled, mesh, law, p, _loop(1e-4, most, early)) / _hinge_area(mesh, side)
    assert rise - fall == pytest.approx(2 * ratio * b * magnitudes * HINGE_SHARE, rel=2e-3)
    assert again == pytest.approx(first, rel=1e-9)  # closed
    assert first == pytest.approx(b * (most + ratio * magnitudes * HINGE_SHARE), rel=2e-3)
    assert start == pytest.approx(b * early * (1 + HINGE_SHARE * ratio / YIELD_CURVATURE), rel=2e-3)  # nothing slides


def test_the_loop_of_a_cloth_is_twice_the_friction_couple_wide():
    """On the mesh of a drape, which has no preferred direction."""
    mesh, ratio, most = disc_mesh(400), 20.0, 25.0
    law = effect("bending-friction").apply(_setup(), {"ratio": ratio}).states[0]
    p, widths, stiffness = _parameters(mesh, CLOTH, bends_only=True), [], []
    for degrees in (0.0, 30.0, 60.0, 90.0, 120.0, 150.0):
        rolled = partial(_rolled, degrees=degrees)
        _, _, fall, _, rise, _ = _path(rolled, mesh, law, p, _loop(1e-4, most, 1.0))
        widths.append(rise - fall)
        stiffness.append(_path(rolled, mesh, MomentFriction(0.0), p, [1.0])[0])
    assert np.mean(widths) == pytest.approx(2 * ratio * np.mean(stiffness), rel=0.05)
    assert np.ptp(widths) < 0.1 * np.mean(widths)


def test_friction_takes_the_stiffness_of_the_elastic_curvature():
    """Where B depends on curvature, the middle of the loop is the elastic law, and HB its ratio at each curvature."""
    side, ratio, at, most = 0.002, 20.0, 15.0, 25.0
    mesh = _hexagon(4, side)
    table = torch.tensor([1.0, 3.0, 7.0, 2.0, 5.0], dtype=torch.float64).repeat(3, 1) * 1e-5
    p = _parameters(mesh, replace(CLOTH, bending=table), bends_only=True)
    law = effect("bending-friction").apply(_setup(), {"ratio": ratio}).states[0]
    (elastic,) = _path(_rolled, mesh, MomentFriction(0.0), p, [at])
    _, _, fall, _, rise, _ = _path(_rolled, mesh, law, p, _loop(at, most, 1.0))
    assert elastic == pytest.approx(5e-5 * at * _hinge_area(mesh, side), rel=2e-3)  # midway between 3 and 7
    assert (rise + fall) / 2 == pytest.approx(elastic, rel=1e-3)
    assert (rise - fall) / 2 == pytest.approx(elastic * HINGE_SHARE * ratio / at, rel=1e-3)


@pytest.mark.parametrize(("degrees", "shown"), [(90.0, 1.0), (0.0, 7 / 9)])
def test_asymmetry_on_a_lattice(degrees, shown):
    """Squares of the hinges' curvatures, each with its own sign: 1, or (4 + 4 - 1) / 9."""
    mesh, a = _hexagon(4, 0.005), 0.4
    law = effect("face-asymmetry").apply(_setup(), {"asymmetry": a}).states[0]
    p, rolled = _parameters(mesh, CLOTH, bends_only=True), partial(_rolled, degrees=degrees)
    convex, concave = _path(rolled, mesh, law, p, [5.0, -5.0])
    assert convex / -concave == pytest.approx((1 + shown * a) / (1 - shown * a), rel=1e-3)


def test_both_start_from_the_rest_shape():
    """At its rest shape the cloth holds no moment; flat, one that is convex at rest is bent the concave way."""
    mesh, a = _hexagon(3, 0.005), 0.4
    system, p = _loose(mesh), _parameters(mesh, CLOTH, bends_only=True)
    x, flat = _rolled(mesh, 10.0), mesh.flat
    p = replace(p, rest_angle=system.bent(x))
    rubbing = effect("bending-friction").apply(_setup(), {}).states[0].start(system, p)
    two_sided = effect("face-asymmetry").apply(_setup(), {"asymmetry": a}).states[0].start(system, p)
    elastic = system.forces(flat, flat, p, exact=False)[0]
    largest = np.abs(elastic).max()
    at_rest = system.forces(x, x, rubbing.advance(system, p, x, 0.0)[1], exact=False)[0]
    assert np.abs(at_rest).max() < 1e-12 * largest
    flattened = system.forces(flat, flat, two_sided.advance(system, p, flat, 0.0)[1], exact=False)[0]
    np.testing.assert_allclose(flattened, (1 - a) * elastic, atol=1e-6 * largest)


# --- shear ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [0.6, 4.0])
def test_shear_is_a_closed_loop_twice_the_friction_stress_wide(degrees):
    mesh, shear, most = disc_mesh(80), 60.0, math.radians(6.0)
    law = effect("shear-friction").apply(_setup(), {"ratio": degrees}).states[0]
    cloth = uniform_material(density=0.2, bending=1e-9, stretch=300.0, shear=shear)
    p, early, slid = _parameters(mesh, cloth, bends_only=False), 0.5 * YIELD_SHEAR, math.radians(degrees)
    start, first, fall, _, rise, again = _path(_sheared, mesh, law, p, _loop(0.0, most, early))
    assert rise - fall == pytest.approx(2 * slid * shear, rel=0.01)
    assert again == pytest.approx(first, rel=1e-9)
    assert first == pytest.approx(shear * (most + slid), rel=0.01)
    assert start == pytest.approx(shear * early * (1 + slid / YIELD_SHEAR), rel=0.01)


def test_slid_shear_leaves_threads_unstretched():
    """Sheared and let go in shear, a face of the joint element has no stress along its threads."""
    mesh = disc_mesh(80)
    law = effect("shear-friction").apply(_setup(), {"ratio": 4.0}).states[0]
    cloth = uniform_material(density=0.2, bending=1e-9, stretch=300.0, shear=60.0)
    p, system = _parameters(mesh, cloth, bends_only=False), _loose(mesh)
    x = _sheared(mesh, math.radians(6.0))
    now, q = law.start(system, p).advance(system, p, x, 0.0)
    only_threads = replace(q, stretch=q.stretch * np.array([1.0, 1.0, 1.0, 0.0]))
    assert now.forces(x, x, only_threads, exact=True)[2] < 1e-12 * now.forces(x, x, q, exact=True)[2]


# --- creep ------------------------------------------------------------------------------------------------------------


def test_the_moment_left_at_the_shape_reached_is_one_minus_the_loss():
    mesh, loss = _hexagon(5, 0.004), 0.35
    state = effect("creep").apply(_setup(), {"loss": loss}).states[0]
    system, p = _loose(mesh), _parameters(mesh, CLOTH, bends_only=True)
    p = replace(p, rest_angle=np.full(len(mesh.hinges), 0.01))
    x = _rolled(mesh, 15.0)
    relaxing = state.start(system, p)
    laws = [relaxing.advance(system, p, x, share)[1] for share in (0.0, 0.49, 0.5, 0.75, 0.99)]
    forces = [system.forces(x, x, now, exact=False)[0] for now in laws]
    assert np.abs(forces[0]).max() > 0
    np.testing.assert_array_equal(forces[0], forces[1])
    np.testing.assert_allclose(forces[2], forces[0], atol=1e-12 * np.abs(forces[0]).max())
    for relaxed in forces[3:]:
        np.testing.assert_allclose(relaxed, (1 - loss) * forces[0], atol=1e-9 * np.abs(forces[0]).max())


def test_the_moment_left_is_that_of_the_bending_left_where_stiffness_depends_on_curvature():
    mesh, loss, at = _hexagon(5, 0.002), 0.35, 15.0
    row = torch.tensor([1.0, 3.0, 7.0, 2.0, 5.0], dtype=torch.float64) * 1e-5
    state, system = effect("creep").apply(_setup(), {"loss": loss}).states[0], _loose(mesh)
    p, x = _parameters(mesh, replace(CLOTH, bending=row.repeat(3, 1)), bends_only=True), _rolled(mesh, at)
    relaxing = state.start(system, p)
    elastic, _, left = (
        system.forces(x, x, relaxing.advance(system, p, x, share)[1], exact=False)[0] for share in (0.0, 0.5, 0.99)
    )
    before, after = weights_bending_paper(torch.tensor([at, (1 - loss) * at], dtype=torch.float64)) @ row
    expected = float((1 - loss) * after / before)
    assert expected == pytest.approx(0.413, abs=1e-3)  # not .65
    assert (left * elastic).sum() / (elastic**2).sum() == pytest.approx(expected, rel=1e-3)


def _coefficient(vertices: torch.Tensor) -> float:
    x, y = vertices[MESH.boundary, :2].T.numpy()
    return 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def test_a_crept_drape_is_lower_and_only_in_a_later_picture():
    settings = DrapeSettings(steps=100)
    base = _setup(settings=settings)
    crept = [effect("creep").apply(base, {"loss": loss}) for loss in (0.15, 0.4)]
    areas = [_coefficient(found) for found in drape_setups([base, *crept]) if found is not None]
    assert areas[0] > 1.01 * areas[1] > 1.01**2 * areas[2]
    first = replace(base, later=False)
    assert effect("creep").apply(first, {"loss": 0.4}) is first


# --- how they mix -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Nothing(StateLaw, State):
    """A law that changes nothing, or breaks the cloth."""

    rank: ClassVar[Rank] = Rank.REST
    rest_angle: float = 0.0

    def start(self, system: DrapeSystem, parameters: Parameters) -> State:
        return self

    def advance(self, system, parameters, x, share):
        return system, replace(parameters, rest_angle=parameters.rest_angle + self.rest_angle)


def test_a_law_that_changes_nothing_leaves_every_bit_of_the_drop():
    plain, watched = drape_setups([_setup(), _setup().with_added(states=_Nothing())])
    assert plain is not None
    assert watched is not None
    assert torch.equal(plain, watched)


def test_laws_mix_in_any_order():
    causes = [parse(name) for name in STATEFUL]
    orders = [causes, causes[::-1], [causes[i] for i in (2, 0, 3, 1)]]
    found = drape_setups([apply_all(order, _setup()) for order in orders])
    single = drape_setups([cause.apply(_setup()) for cause in causes])
    for other in found[1:]:
        assert torch.equal(found[0], other)  # pyright: ignore[reportArgumentType]
    for other in single:
        assert not torch.allclose(found[0], other, atol=1e-5)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("name", ["bending-friction", "shear-friction"])
def test_friction_that_is_given_twice_is_refused(name):
    """A second element would stiffen the first one, too: ratios would multiply where they should add."""
    causes = [parse(f"{name}:ratio=2"), parse("plate-tilt"), parse(f"{name}:ratio=3")]
    with pytest.raises(SimulationError, match=f"effect {name} must be given once, got it 2 times.*the ratio of all"):
        apply_all(causes, _setup())
    assert len(apply_all(causes[:2], _setup()).states) == 1


def test_contact_that_is_given_twice_is_refused():
    """The last thickness stood, and the first was dropped without a word."""
    for thicknesses in ((0.001, 0.002), (0.002, 0.001)):
        with pytest.raises(SimulationError, match="effect self-contact must be given once, got it 2 times"):
            apply_all([parse(f"self-contact:thickness={thickness}") for thickness in thicknesses], _setup())


def test_creep_and_asymmetry_may_act_twice():
    for name in ("creep", "face-asymmetry"):
        assert len(apply_all([parse(name), parse(name)], _setup()).states) == 2


def test_changed_elements_share_the_analysis():
    system = DrapeSimulator(MESH).system
    sheared = replace(system.elements, face_v=2 * system.elements.face_v)
    other = system.with_elements(sheared)
    assert other.linear is system.linear
    assert other.layout is system.layout
    assert other.elements is sheared
    assert system.elements is not sheared


@pytest.mark.parametrize("name", STATEFUL)
def test_history_is_refused_where_it_cannot_be_simulated(name):
    touching = apply_all([parse("self-contact"), parse(name)], _setup())
    with pytest.raises(SimulationError, match="mode 'drop' without self-contact, got self-contact"):
        drape_setups([touching])
    resting = parse(name).apply(_setup(settings=DrapeSettings(mode="equilibrium")))
    with pytest.raises(SimulationError, match="got mode 'equilibrium'"):
        drape_setups([resting])


def test_a_cloth_that_flies_apart_is_reported_and_spoils_no_other():
    broken = _setup().with_added(states=_Nothing(rest_angle=math.nan))
    simulator = DrapeSimulator(MESH, broken.settings)
    with pytest.raises(DrapeDiverged, match="step 1 of 20: forces are no longer finite"):
        drop_with_history(simulator, CLOTH, broken.initial(), broken.rest_angle(), broken.states)
    whole = parse("bending-friction").apply(_setup())
    (alone,), (none, beside) = drape_setups([whole]), drape_setups([broken, whole])
    assert none is None
    assert alone is not None
    assert beside is not None
    assert torch.equal(alone, beside)
