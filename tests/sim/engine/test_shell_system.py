"""A shell's forces, stiffness and adjoint against differences, and the maps between vertices and control points."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array

from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.plate.system import ShellSystem
from cusick_bench.sim.engine.plate.unknowns import ShellUnknowns
from cusick_bench.sim.errors import SimulationError

MESH = disc_mesh(97)
FIXED = np.hypot(*MESH.material.T) <= 0.09 + 1e-9
STEP = 1e-7


@pytest.fixture(scope="module")
def system():
    return ShellSystem(MESH, 9.8, FIXED, 0.09)


def cloth(tables=True):
    """A cloth with everything that a parameter can be, one table per element or one for all."""
    generator = np.random.default_rng(2)
    faces, hinges = (len(MESH.faces), len(MESH.hinges)) if tables else (1, 1)
    stretch = 200 * np.array([1.0, 0.1, 1.0, 0.4]) * generator.uniform(0.8, 1.2, (1, faces, 6, 4))
    bending = 1e-5 * generator.uniform(0.5, 2.0, (1, hinges, 3, 5))
    mass = 1e-4 * generator.uniform(0.5, 1.0, (1, MESH.vertices))
    return Parameters(stretch, bending, mass, generator.normal(0, 0.1, (1, len(MESH.hinges))), np.array([0.2]))


@pytest.fixture(scope="module", params=[True, False], ids=["tables per element", "one table"])
def parameters(request, system):
    return ShellUnknowns(system).parameters(cloth(request.param))


@pytest.fixture(scope="module")
def bent(system):
    """A crumpled configuration, and two directions."""
    generator = np.random.default_rng(0)
    x = MESH.flat[None].copy()
    directions = np.zeros((2, *x.shape))
    x[:, system.free] += generator.normal(0, 2e-3, x[:, system.free].shape)
    directions[:, :, system.free] = generator.normal(size=directions[:, :, system.free].shape)
    return x, *directions


def dense(system, blocks):
    """The symmetric matrix of which the solver reads one triangle."""
    layout, rows = system.layout, len(system.free)
    row = np.repeat(np.arange(rows), np.diff(layout.indptr))
    needed = system.linear.needed_slots
    found = np.zeros((rows, rows, 3, 3))
    found[row[needed], layout.indices[needed]] = blocks[needed]
    found[layout.indices[needed], row[needed]] = blocks[needed].transpose(0, 2, 1)
    return found.transpose(0, 2, 1, 3).reshape(3 * rows, 3 * rows)


def stiffness(system, x, p, exact):
    state = system.evaluate(x, x, p, exact=exact)
    return dense(system, state.matrix(diagonal=np.zeros((1, MESH.vertices)))[0])


def test_forces_are_the_energys_gradient_and_the_matrix_its_hessian(system, parameters, bent):
    x, v, _ = bent

    def at(step):
        state = system.evaluate(x + step * v, x, parameters, exact=True)
        return float(state.energy()[0]), state.force()

    (up, force_up), (down, force_down) = at(STEP), at(-STEP)
    assert (up - down) / (2 * STEP) == pytest.approx(-float((at(0.0)[1] * v).sum()), rel=1e-6)
    change = -(force_up - force_down)[0, system.free].ravel() / (2 * STEP)
    hessian = stiffness(system, x, parameters, True) @ v[0, system.free].ravel()
    np.testing.assert_allclose(hessian, change, atol=1e-7 * np.abs(change).max())


def test_the_gauss_newton_stiffness_is_positive_definite(system, parameters, bent):
    values = np.linalg.eigvalsh(stiffness(system, bent[0], parameters, False))
    assert values.min() > 1e-9 * values.max()


def test_adjoint_by_unknowns_and_parameters(system, parameters, bent):
    x, v, multiplier = bent
    force, secant = 0.7, 0.3

    def scalar(at, p):
        state = system.evaluate(at, at, p, exact=False)
        pushed = float((multiplier * state.force()).sum())
        product = stiffness(system, at, p, False) @ v[0, system.free].ravel()
        return force * pushed - secant * float(multiplier[0, system.free].ravel() @ product)

    gradient = system.zero_gradient(1)
    by_x, _ = system.adjoint(
        x, multiplier, v, parameters, gradient, force_factor=force, stiffness_factor=secant
    )  # fmt: skip
    generator = np.random.default_rng(5)
    w = generator.normal(size=x.shape)  # moves the plate too
    change = (scalar(x + STEP * w, parameters) - scalar(x - STEP * w, parameters)) / (2 * STEP)
    assert float((by_x * w).sum()) == pytest.approx(change, rel=1e-6)
    rounding = 1e-15 * abs(scalar(x, parameters)) / 1e-5
    for name in ("stretch", "bending", "mass", "rest_angle", "poisson"):
        value = getattr(parameters, name)
        w = generator.normal(size=value.shape) * np.abs(value).mean()
        up, down = (replace(parameters, **{name: value + sign * 1e-5 * w}) for sign in (1, -1))
        change = (scalar(x, up) - scalar(x, down)) / 2e-5
        found = getattr(gradient, name)
        found = found.sum(1, keepdims=True) if found.shape != value.shape else found
        assert float((found * w).sum()) == pytest.approx(change, rel=1e-4, abs=rounding), name


def test_moved_as_a_whole_the_shell_feels_nothing(system):
    p = ShellUnknowns(system).parameters(cloth(False))
    p = replace(p, rest_angle=np.zeros_like(p.rest_angle), mass=np.zeros_like(p.mass))
    generator = np.random.default_rng(7)
    turn, _ = np.linalg.qr(generator.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    x = ShellUnknowns(system).configuration((MESH.flat @ turn.T)[None] + 0.1)
    state = system.evaluate(x, x, p, exact=True)
    assert np.abs(state.force()).max() < 1e-10
    assert abs(float(state.energy()[0])) < 1e-15


def test_control_points_of_given_positions_give_these_positions(system):
    unknowns = ShellUnknowns(system)
    generator = np.random.default_rng(4)
    turn, _ = np.linalg.qr(generator.normal(size=(3, 3)))
    positions = np.stack([MESH.flat, MESH.flat @ turn.T])
    positions[:, system.free] += generator.normal(0, 1e-3, (2, len(system.free), 3))
    np.testing.assert_allclose(unknowns.positions(unknowns.configuration(positions)), positions, atol=1e-15)


def test_maps_of_unknowns_and_their_transposes(system):
    """<J v, g> = <v, J^T g> for positions, starting configurations and parameters."""
    unknowns = ShellUnknowns(system)
    generator = np.random.default_rng(6)
    x, v, g = (
        MESH.flat[None] + generator.normal(0, 1e-3, (1, MESH.vertices, 3)),
        *generator.normal(size=(2, 1, MESH.vertices, 3)),
    )
    x[:, FIXED] = MESH.flat[FIXED]
    step = 1e-6
    moved = (unknowns.positions(x + step * v) - unknowns.positions(x - step * v)) / (2 * step)
    assert float((moved * g).sum()) == pytest.approx(float((unknowns.by_configuration(g) * v).sum()), rel=1e-7)
    p, zero = cloth(), np.zeros((1, MESH.vertices, 3))
    found = system.zero_gradient(1)
    for array in vars(found).values():
        array[...] = generator.normal(size=array.shape)
    found.mass[:, FIXED] = 0.0  # gravity takes no work from what never moves
    back, _ = unknowns.gradient(found, zero)
    for name in ("stretch", "bending", "mass", "rest_angle"):
        value = getattr(p, name)
        w = generator.normal(size=value.shape)
        there = getattr(unknowns.parameters(replace(p, **{name: value + w})), name) - getattr(
            unknowns.parameters(p), name
        )
        expected = float((there * getattr(found, name)).sum())
        assert float((w * getattr(back, name)).sum()) == pytest.approx(expected, rel=1e-8), name


def test_start_gradient_is_the_transposed_of_the_control_points(system):
    unknowns = ShellUnknowns(system)
    generator = np.random.default_rng(8)
    x = MESH.flat[None].copy()
    v, g = generator.normal(size=(2, 1, MESH.vertices, 3))
    # the plate moves as a plane
    v[:, FIXED] = (np.column_stack([MESH.material, np.ones(MESH.vertices)]) @ generator.normal(size=(3, 3)))[FIXED]
    step = 1e-6
    moved = (unknowns.configuration(x + step * v) - unknowns.configuration(x - step * v)) / (2 * step)
    _, back = unknowns.gradient(system.zero_gradient(1), g)
    assert float((back * v).sum()) == pytest.approx(float((moved * g).sum()), rel=1e-6)


def test_a_cloth_that_is_not_flat_on_the_plate_is_refused(system):
    positions = MESH.flat[None].copy()
    positions[0, np.flatnonzero(FIXED)[3], 2] = 1e-3
    with pytest.raises(SimulationError, match="law 'plate' holds the cloth flat"):
        ShellUnknowns(system).configuration(positions)


def test_an_analysis_is_shared_with_a_warped_mesh(system):
    _ = system.linear
    warped = replace(MESH, material=MESH.material * np.where(FIXED, 1.0, 1.001)[:, None])
    other = system.with_mesh(warped)
    assert other.linear is system.linear
    fresh = ShellSystem(warped, 9.8, FIXED, 0.09)
    p = ShellUnknowns(other).parameters(cloth(False))
    first = other.evaluate(warped.flat[None], warped.flat[None], p, exact=True).force()
    np.testing.assert_array_equal(first, fresh.evaluate(warped.flat[None], warped.flat[None], p, exact=True).force())


def test_layout_lists_every_coupling_once(system):
    layout, rows = system.layout, len(system.free)
    pattern = csr_array((np.ones(len(layout.indices)), layout.indices, layout.indptr), shape=(rows, rows))
    assert (abs(pattern - pattern.T)).nnz == 0
    assert np.array_equal(layout.indices[layout.diagonal], np.arange(rows))
