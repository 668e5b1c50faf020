"""Self-contact: exact derivatives, no intersections, gradients through contacts, no change where nothing touches."""

import json
import pickle
import sys
from functools import lru_cache

import numpy as np
import pytest
import torch
from numpy import ndarray
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.shape import laid_down, smooth_field
from cusick_bench.sim.contact.barrier import SelfContact, smallest_distance
from cusick_bench.sim.contact.drop import contact_drop
from cusick_bench.sim.contact.equilibrium import ContactRest, contact_equilibrium, contact_equilibrium_adjoint
from cusick_bench.sim.contact.intersections import intersections
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.effects.directions import leaned
from cusick_bench.sim.engine.dynamics.drop import drop
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.engine.statics.equilibrium import equilibrium, equilibrium_adjoint
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.errors import DrapeDiverged, SimulationError

pytest.importorskip("ipctk", reason="self-contact needs ipctk; pip install 'cusick-bench[contact]'")

GRAVITY = 9.8  # [m/s2]
STEP = 0.05  # [s]
THICKNESS = 1e-3  # [m]
ROUNDING = 1e-13  # share of the energy


def _parameters(mesh: Mesh, *, density: float = 0.25, bending: float = 1e-6) -> Parameters:
    mass = np.bincount(mesh.faces.ravel(), np.repeat(density * mesh.areas / 3, 3), mesh.vertices)
    stretch = np.tile([150.0, 0.0, 150.0, 60.0], (1, 6, 1))
    return Parameters(stretch, np.full((1, 3, 5), bending), mass, np.zeros(len(mesh.hinges)))


# --- Derivatives of the barrier -------------------------------------------------------------------------------------


def _folded_disc(vertices: int = 150) -> tuple[SelfContact, ndarray]:
    """A disc folded about the y axis, its layers about half a thickness apart: every kind of pair is in contact."""
    mesh = disc_mesh(vertices, seed=1)
    generator = np.random.default_rng(0)
    x = mesh.flat.copy()
    upper = x[:, 0] > 0
    x[upper, 0] *= -0.97
    x[upper, 1] += 0.7e-3
    x[upper, 2] += 0.55e-3
    x[:, 2] += generator.uniform(-1e-4, 1e-4, len(x))
    return SelfContact(mesh), x


def test_contact_forces_are_the_gradient_of_the_energy():
    contact, x = _folded_disc()
    found, step = contact.forces(x), 1e-9
    assert found.count > 100
    for direction in np.random.default_rng(1).normal(size=(5, *x.shape)):
        up, down = contact.forces(x + step * direction), contact.forces(x - step * direction)
        slope = (up.energy - down.energy) / (2 * step)
        assert -(found.force * direction).sum() == pytest.approx(slope, rel=1e-6)


def test_contact_travels_to_other_processes():
    contact, x = _folded_disc()
    assert pickle.loads(pickle.dumps(contact)).forces(x).energy == contact.forces(x).energy > 0


def test_contact_hessian_is_the_derivative_of_the_forces():
    contact, x = _folded_disc()
    hessian, step = contact.forces(x).hessian(), 1e-10
    for direction in np.random.default_rng(2).normal(size=(5, *x.shape)):
        up, down = contact.forces(x + step * direction).force, contact.forces(x - step * direction).force
        slope = (down - up).ravel() / (2 * step)
        error = np.abs(hessian @ direction.ravel() - slope).max()
        assert error <= 1e-5 * np.abs(slope).max()


def test_projected_hessian_is_positive_semidefinite_and_the_exact_one_is_not():
    contact, x = _folded_disc()
    found = contact.forces(x)
    exact = np.linalg.eigvalsh(found.hessian().toarray())
    projected = np.linalg.eigvalsh(found.hessian(project=True).toarray())
    assert exact[0] < -1e-3 * exact[-1]
    assert projected[0] > -1e-10 * projected[-1]


def test_contact_forces_hold_linear_and_angular_momentum():
    contact, x = _folded_disc()
    force = contact.forces(x).force
    largest = np.abs(force).max()
    assert np.abs(force.sum(0)).max() < 1e-10 * largest
    assert np.abs(np.cross(x, force).sum(0)).max() < 1e-10 * largest


def test_energy_is_the_pressure_law_of_two_layers():
    """Layers at d^ / 2 repel each other by about 2 * 4.33 kappa per area."""
    mesh = disc_mesh(400, seed=1)
    contact = SelfContact(mesh, stiffness=7.0)
    x = mesh.flat.copy()
    upper = x[:, 0] > 0
    x[upper] = x[upper] * [-1, 1, 1] + [0, 1e-4, 0.5 * THICKNESS]
    # Pairs across the fold itself are not parallel layers: judge the part that is well away from it.
    force = contact.forces(x).force[upper & (mesh.material[:, 0] > 0.03)]
    area = np.bincount(mesh.faces.ravel(), np.repeat(mesh.areas / 3, 3))[upper & (mesh.material[:, 0] > 0.03)]
    assert force[:, 2].sum() / area.sum() == pytest.approx(2 * 4.33 * 7.0, rel=0.15)


# --- Intersections --------------------------------------------------------------------------------------------------


def _intersections_by_solving(mesh: Mesh, x: ndarray) -> int:
    """p + t (q - p) = a + u (b - a) + v (c - a) for every edge and face without a common vertex."""
    count = 0
    for p, q in mesh.edges:
        for a, b, c in mesh.faces:
            if {p, q} & {a, b, c}:
                continue
            t, u, v = np.linalg.solve(np.stack([x[p] - x[q], x[b] - x[a], x[c] - x[a]], axis=1), x[p] - x[a])
            count += 0 < t < 1 and u > 0 and v > 0 and u + v < 1
    return count


def test_intersections_are_counted_as_by_solving_for_every_pair():
    mesh = disc_mesh(60)
    crumpled = mesh.flat + np.random.default_rng(3).normal(0, 0.03, (60, 3))
    assert intersections(mesh, crumpled) == _intersections_by_solving(mesh, crumpled) > 20
    assert intersections(mesh, mesh.flat) == 0


@pytest.mark.parametrize("degrees", [0.3, 1.0, 2.0, 7.0, 20.0])
def test_flat_cloth_on_a_sloping_plate_does_not_pass_through_itself(degrees: float):
    """Roundings lift corners off their common plane by some 1e-17 m, to either side."""
    flat = torch.from_numpy(disc_mesh(200).flat)
    for direction in range(0, 360, 20):
        assert intersections(disc_mesh(200), leaned(flat, degrees, float(direction)).numpy()) == 0


def test_smallest_distance_is_the_gap_between_layers():
    mesh = disc_mesh(150, seed=1)
    x = mesh.flat.copy()
    upper = x[:, 0] > 0
    x[upper] = x[upper] * [-1, 1, 1] + [0, 0, 2e-3]
    inner = np.where(np.hypot(*mesh.material.T) < 0.13, mesh.material[:, 0], 0)
    x[upper & (inner < inner.max())] += [0, 0, 3e-3]  # only one vertex comes as near as 2 mm
    assert smallest_distance(mesh, x) == pytest.approx(2e-3, rel=1e-9)


def test_no_step_crosses():
    contact, x = _folded_disc()
    upper = contact.mesh.material[:, 0] > 0
    step = np.where(upper[:, None] & (x[:, 1:2] > 0), [0, 0, -5e-3], 0.0)  # half of a layer through the other one
    share = contact.free_share(x, step)
    assert intersections(contact.mesh, x + step) > 0
    assert 0 < share < 0.2
    assert intersections(contact.mesh, x + share * step) == 0
    assert contact.free_share(x, np.abs(step)) == 1.0


# --- A strip folded onto itself -------------------------------------------------------------------------------------


def _strip(rows: int = 24, across: int = 4, spacing: float = 5e-3) -> Mesh:
    """A strip along x, its cells cut by alternating diagonals.

    Irregular: layers of a regular grid rest corner on corner, where the nearest feature of a pair changes and the
    gradient is one-sided.
    """
    grid = np.stack(np.meshgrid(np.arange(rows + 1), np.arange(across + 1), indexing="ij"), axis=-1).reshape(-1, 2)
    points = spacing * (grid + np.random.default_rng(7).uniform(-0.15, 0.15, grid.shape))
    faces = []
    for i in range(rows):
        for j in range(across):
            a = i * (across + 1) + j
            b, c, d = a + across + 1, a + across + 2, a + 1
            faces += [(a, b, c), (a, c, d)] if (i + j) % 2 else [(a, b, d), (b, c, d)]
    return Mesh(points, np.array(faces))


@lru_cache
def _folded_strip() -> tuple[DrapeSystem, Parameters, ndarray, SelfContact]:
    """Lower half held flat, upper half folded back over it, its end held 12 mm higher: it sags onto the lower half."""
    mesh = _strip()
    along = mesh.material[:, 0] - 0.06
    radius = 0.006
    turn = np.clip(along / radius, 0, np.pi)
    straight = np.maximum(along - np.pi * radius, 0)
    x = mesh.flat.copy()
    x[:, 0] = 0.06 + np.where(along > 0, radius * np.sin(turn) - straight, along)
    x[:, 2] = np.where(along > 0, radius * (1 - np.cos(turn)), 0)
    system = DrapeSystem(mesh, "paper", GRAVITY, (along <= 1e-3) | (along >= 0.059), np.zeros(mesh.vertices))
    return system, _parameters(mesh, bending=2e-7), x, SelfContact(mesh, stiffness=10.0)


@lru_cache
def _strip_rest() -> ContactRest:
    system, parameters, laid, contact = _folded_strip()
    return contact_equilibrium(system, parameters, laid, contact, tolerance=1e-11)


def test_folded_strip_rests_on_itself():
    system, parameters, laid, _ = _folded_strip()
    rest = _strip_rest()
    assert rest.converged
    assert rest.residual <= 1e-11
    assert rest.contacts.count > 10
    assert 0 < rest.smallest_distance <= THICKNESS
    assert intersections(system.mesh, rest.positions) == 0
    carried = rest.contacts.force[system.free, 2].sum() / (GRAVITY * parameters.mass[system.free].sum())
    assert 0.2 < carried < 1.0  # the held half carries the upper one, but for what hangs on the bend
    through = equilibrium(system, parameters, laid, laid)
    assert through.positions[:, 2].min() < -2 * THICKNESS  # without contact it falls through


def test_energy_never_rises():
    energies = np.array(_strip_rest().energies)
    assert len(energies) > 5
    assert np.diff(energies).max() <= ROUNDING * np.abs(energies).max()
    assert energies[0] - energies[-1] > 1e-5


def test_rest_is_the_same_bits_again():
    system, parameters, laid, contact = _folded_strip()
    again = contact_equilibrium(system, parameters, laid, contact, tolerance=1e-11)
    assert np.array_equal(again.positions, _strip_rest().positions)


# --- Drapes ---------------------------------------------------------------------------------------------------------


@lru_cache
def _disc(
    vertices: int, plate: float, bending: float, amplitude: float = 1e-3, seed: int = 0
) -> tuple[DrapeSystem, Parameters, ndarray, SelfContact]:
    mesh = disc_mesh(vertices, plate_radius=plate)
    fixed = np.hypot(*mesh.material.T) <= plate + 1e-9
    system = DrapeSystem(mesh, "paper", GRAVITY, fixed, np.zeros(mesh.vertices))
    laid = laid_down(mesh, smooth_field(amplitude, 0.03, np.random.default_rng([seed, 0])), plate)
    return system, _parameters(mesh, bending=bending), laid, SelfContact(mesh)


@lru_cache
def _limp_rest() -> ContactRest:
    """A limp cloth on a narrow plate: its folds touch."""
    system, parameters, laid, contact = _disc(300, 0.04, 1e-6)
    fallen = contact_drop(system, parameters, laid, contact, steps=100, step_seconds=STEP)
    return contact_equilibrium(system, parameters, laid, contact, start=fallen, tolerance=1e-11)


def _rest_without_contact(system: DrapeSystem, parameters: Parameters, laid: ndarray) -> ndarray:
    fallen = drop(system, parameters, laid, steps=100, step_seconds=STEP).positions[-1]
    rest = equilibrium(system, parameters, fallen, laid)
    assert rest.converged
    return rest.positions


def test_limp_drape_has_no_intersections_with_contact_and_some_without():
    system, parameters, laid, _ = _disc(300, 0.04, 1e-6)
    rest = _limp_rest()
    assert rest.converged
    assert intersections(system.mesh, rest.positions) == 0
    assert rest.contacts.count > 0
    assert 0 < rest.smallest_distance < THICKNESS
    assert intersections(system.mesh, _rest_without_contact(system, parameters, laid)) > 0


@pytest.mark.slow
def test_limp_drape_of_paper_size_has_no_intersections_with_contact_and_some_without():
    system, parameters, laid, contact = _disc(1205, 0.09, 1e-7, amplitude=5e-3, seed=2)
    fallen = contact_drop(system, parameters, laid, contact, steps=100, step_seconds=STEP)
    rest = contact_equilibrium(system, parameters, laid, contact, start=fallen)
    assert rest.converged
    assert intersections(system.mesh, rest.positions) == 0
    assert rest.smallest_distance > 0
    assert intersections(system.mesh, _rest_without_contact(system, parameters, laid)) > 0


def test_cold_start_comes_to_rest_without_intersections_and_never_upwards():
    system, parameters, laid, contact = _disc(200, 0.03, 1e-7)
    rest = contact_equilibrium(system, parameters, laid, contact)
    assert rest.converged
    assert intersections(system.mesh, rest.positions) == 0
    assert np.diff(rest.energies).max() <= ROUNDING * np.abs(rest.energies).max()


def test_without_touch_the_drape_is_that_without_contact():
    system, parameters, laid, contact = _disc(200, 0.09, 1e-5)
    fallen = drop(system, parameters, laid, steps=60, step_seconds=STEP).positions[-1]
    with_contact = contact_drop(system, parameters, laid, contact, steps=60, step_seconds=STEP)
    np.testing.assert_allclose(with_contact, fallen, atol=1e-8)
    plain = equilibrium(system, parameters, fallen, laid, mu=0.0)
    rest = contact_equilibrium(system, parameters, laid, contact, start=fallen)
    assert rest.contacts.count == 0
    assert rest.iterations == plain.iterations
    np.testing.assert_allclose(rest.positions, plain.positions, atol=1e-12)
    g_x = np.random.default_rng(4).normal(size=laid.shape)
    gradient, g_held = contact_equilibrium_adjoint(system, parameters, rest, g_x)
    expected, held_expected = equilibrium_adjoint(system, parameters, plain, g_x)
    for found, known in ((gradient.bending, expected.bending), (gradient.mass, expected.mass), (g_held, held_expected)):
        np.testing.assert_allclose(found, known, atol=1e-8 * np.abs(known).max())


# --- Gradients through contacts -------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", ["strip", "disc"])
@pytest.mark.parametrize("name", ["stretch", "bending", "mass", "rest_angle", "held"])
def test_gradient_through_contacts(case: str, name: str):
    system, parameters, laid, contact = _folded_strip() if case == "strip" else _disc(300, 0.04, 1e-6)
    rest = _strip_rest() if case == "strip" else _limp_rest()
    assert rest.contacts.count > 0
    g_x = np.random.default_rng(5).normal(size=laid.shape)
    gradient, g_held = contact_equilibrium_adjoint(system, parameters, rest, g_x)
    generator = np.random.default_rng(6)
    if name == "held":
        direction = np.where(system.fixed[:, None], generator.normal(size=laid.shape), 0.0)
        slope, step = (g_held * direction).sum(), 1e-9
    elif name == "rest_angle":
        direction = generator.normal(size=parameters.rest_angle.shape)
        slope, step = (gradient.rest_angle * direction).sum(), 1e-6
    elif name == "mass":
        direction = parameters.mass
        slope, step = (gradient.mass * direction).sum(), 1e-6
    else:
        direction = getattr(parameters, name)
        slope, step = (getattr(gradient, name).sum(0) * direction[0]).sum(), 1e-5

    def value(amount: float) -> float:
        numbers = {key: getattr(parameters, key) for key in ("stretch", "bending", "mass", "rest_angle")}
        moved = laid + amount * direction if name == "held" else laid
        if name != "held":
            numbers[name] = numbers[name] + amount * direction
        found = contact_equilibrium(
            system, Parameters(**numbers), moved, contact, start=rest.positions, tolerance=5e-12
        )
        assert found.converged
        return float((g_x * found.positions).sum())

    difference = (value(step) - value(-step)) / (2 * step)
    assert slope == pytest.approx(difference, rel=1e-5)


# --- Bad input ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["thickness", "stiffness"])
@pytest.mark.parametrize("value", [0.0, -1e-3, float("nan"), float("inf")])
def test_contact_refuses_numbers_out_of_range(name: str, value: float):
    with pytest.raises(SimulationError, match=f"contact {name} must be > 0"):
        SelfContact(disc_mesh(60), **{name: value})


def test_contact_refuses_a_thickness_that_the_mesh_cannot_resolve():
    finest = smallest_distance(disc_mesh(150), disc_mesh(150).flat)
    SelfContact(disc_mesh(150), thickness=0.99 * finest)
    with pytest.raises(SimulationError, match="coarser mesh"):
        SelfContact(disc_mesh(150), thickness=1.01 * finest)


def test_start_with_intersections_is_refused():
    system, parameters, laid, contact = _folded_strip()
    crossed = laid.copy()
    crossed[system.free, 2] -= 0.014
    with pytest.raises(SimulationError, match="without intersections"):
        contact_equilibrium(system, parameters, laid, contact, start=crossed)
    with pytest.raises(SimulationError, match="must be finite"):
        contact_equilibrium(system, parameters, np.full_like(laid, np.nan), contact)
    with pytest.raises(SimulationError, match="shape"):
        contact_drop(system, parameters, laid[1:], contact, steps=1, step_seconds=STEP)


def test_contact_needs_its_own_mesh_and_a_law_with_energy():
    system, parameters, laid, contact = _folded_strip()
    with pytest.raises(SimulationError, match="another mesh"):
        contact_equilibrium(system, parameters, laid, SelfContact(_strip()))
    published = DrapeSystem(system.mesh, "published", GRAVITY, system.fixed, system.spring)
    with pytest.raises(SimulationError, match="law 'paper'"):
        contact_drop(published, parameters, laid, contact, steps=1, step_seconds=STEP)


def test_gradient_of_an_unfinished_rest_is_refused():
    system, parameters, laid, contact = _folded_strip()
    rest = contact_equilibrium(system, parameters, laid, contact, iterations=2)
    assert not rest.converged
    assert rest.iterations == 2
    with pytest.raises(DrapeDiverged, match="has not converged"):
        contact_equilibrium_adjoint(system, parameters, rest, laid)


def test_who_asks_for_contact_is_not_sent_to_a_drop_which_has_none():
    settings = DrapeSettings(mode="equilibrium", steps=1, iterations=2, self_contact=THICKNESS)
    with pytest.raises(DrapeDiverged, match=r"raise `iterations`$"):
        DrapeSimulator(disc_mesh(100), settings).drape(uniform_material(density=0.2, bending=1e-4))


@pytest.mark.parametrize(
    "asked",
    [["--self-contact", "0.001"], ["--self-contact", "0.001", "--mode", "drop"], ["--with-effect", "self-contact"]],
)
def test_who_asks_for_contact_by_a_law_without_energy_is_told_to_take_another_law(asked: list[str]):
    """Messages sent to mode drop, where others said that contact needs mode equilibrium."""
    words = ["simulate", "--density", "0.19", "--bending", "1e-5", "--vertices", "97", "--law", "published"]
    refused = CliRunner().invoke(app, [*words, *asked])
    assert refused.exit_code == 2
    assert "self-contact needs a law that derives from an energy" in " ".join(refused.output.split())


def test_missing_package_names_the_remedy(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "ipctk", None)
    with pytest.raises(SimulationError, match=r"pip install 'cusick-bench\[contact\]'"):
        SelfContact(disc_mesh(60))


def test_the_command_takes_the_mode_that_self_contact_needs():
    words = ["simulate", "--density", "0.19", "--bending", "1e-5", "--vertices", "97", "--self-contact", "0.001"]
    result = CliRunner().invoke(app, [*words, "--json"])
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["converged"]
    refused = CliRunner().invoke(app, [*words, "--mode", "drop"])
    assert refused.exit_code == 2
    assert "equilibrium" in refused.output
