"""The simulator against mechanics that is known exactly: patch test, plate stiffness, elastica, catenary, scaling.

The hinge energy is that of a plate with bending stiffness B and an effective Poisson's ratio of -1/3: a lattice of
equilateral triangles has energy density B / 2 (4/3 K:K - 1/3 (tr K)^2) for a curvature tensor K. That is
B kappa^2 / 2 for a cylinder in any direction, and 8/9 of it where a strip's free edges may curl along. Stiff membranes,
wide strips or stiff transverse hinges suppress that curl below.
"""

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from numpy import ndarray
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.spatial import Delaunay

from cusick_bench.sim.cloth.material import uniform_material
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.constants import PLATE_RADIUS, Law
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.dynamics.drop import drop
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.engine.statics.equilibrium import Equilibrium, equilibrium
from cusick_bench.sim.engine.triangles.system import DrapeSystem

GRAVITY = 9.8  # [m/s2]
STRAIN_SAMPLE = ((7 / 6) ** 2 - 1) / 2  # Green strain at a stretch of 1 + 1/6


def _parameters(mesh: Mesh, *, stretch: ndarray, bending: ndarray, density: float = 0.2) -> Parameters:
    mass = np.bincount(mesh.faces.ravel(), np.repeat(density * mesh.areas / 3, 3), mesh.vertices)
    return Parameters(stretch.reshape(1, 6, 4), bending.reshape(1, 3, 5), mass, np.zeros(len(mesh.hinges)))


def _membrane(stretch: float) -> ndarray:
    """Table of a membrane with the same stiffness at every strain; shear is half as stiff [N/m]."""
    return np.tile([stretch / 2, 0.0, stretch / 2, stretch / 2], (6, 1))


def _rows(warp: float, bias: float, weft: float) -> ndarray:
    """Bending table that does not depend on curvature [N m]."""
    return np.repeat([[float(warp)], [bias], [weft]], 5, axis=1)


def _system(mesh: Mesh, fixed: ndarray, law: Law = "paper", gravity: float = GRAVITY) -> DrapeSystem:
    return DrapeSystem(mesh, law, gravity, fixed, np.zeros(mesh.vertices))


def _strip(length: float, rows: int, across: int) -> Mesh:
    """Near-equilateral strip along x from -h to `length` = rows h, with edges along y, so that it rolls up exactly."""
    h = length / rows
    lines, points = [], []
    for row in range(-1, rows + 1):
        middle = np.arange(across) + 0.5
        y = np.arange(across + 1.0) if row % 2 == 0 else np.concatenate([[0], middle, [across]])
        lines.append(len(points) + np.arange(len(y)))
        points += [(row * h, 2 * h / np.sqrt(3) * value) for value in y]
    faces = []
    for left, right in itertools.pairwise(lines):
        i = j = 0
        while i + 1 < len(left) or j + 1 < len(right):
            next_left = points[left[i + 1]][1] if i + 1 < len(left) else np.inf
            next_right = points[right[j + 1]][1] if j + 1 < len(right) else np.inf
            if next_left < next_right:
                faces.append((left[i], right[j], left[i + 1]))
                i += 1
            else:
                faces.append((left[i], right[j], right[j + 1]))
                j += 1
    return Mesh(np.array(points), np.array(faces))


def _rotated(mesh: Mesh, degrees: float) -> Mesh:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return Mesh(mesh.material @ np.array([[c, s], [-s, c]]), mesh.faces)


def _irregular_rectangle() -> tuple[Mesh, ndarray]:
    """Unit-free patch 0.1 x 0.08 m with displaced inner vertices, and which of them are inner."""
    grid = np.stack(np.meshgrid(np.linspace(0, 0.1, 6), np.linspace(0, 0.08, 5), indexing="ij"), axis=-1)
    inner = np.zeros((6, 5), bool)
    inner[1:-1, 1:-1] = True
    points, inner = grid.reshape(-1, 2), inner.ravel()
    points[inner] += np.random.default_rng(0).uniform(-0.006, 0.006, (inner.sum(), 2))
    corner = np.add.outer(5 * np.arange(5), np.arange(4)).ravel()
    lower, upper = [corner, corner + 5, corner + 6], [corner, corner + 6, corner + 1]
    return Mesh(points, np.concatenate([np.column_stack(lower), np.column_stack(upper)])), inner


# --- patch test -------------------------------------------------------------------------------------------------------


def _patch_forces(deformation: ndarray, table: ndarray, law: Law) -> tuple[Mesh, ndarray, ndarray]:
    mesh, inner = _irregular_rectangle()
    system = _system(mesh, np.zeros(mesh.vertices, bool), law, gravity=1e-300)
    x = np.column_stack([mesh.material @ deformation.T, np.zeros(mesh.vertices)])
    force, _, _ = system.forces(x, x, _parameters(mesh, stretch=table, bending=_rows(1e-5, 1e-5, 1e-5)), exact=False)
    return mesh, inner, force


def _traction(mesh: Mesh, force: ndarray, axis: int) -> ndarray:
    """Force per width that the cloth exerts against what holds its far edge, to be pulled apart along an axis [N/m]."""
    far = mesh.material[:, axis] > mesh.material[:, axis].max() - 1e-9
    return -force[far].sum(0) / np.ptp(mesh.material[:, 1 - axis])


@pytest.mark.parametrize("law", ["paper", "published"])
@pytest.mark.parametrize(
    "deformation", [[[1.1, 0], [0, 1]], [[1, 0], [0, 1.1]], [[1, 0.2], [0, 1]], [[1.05, 0.1], [0.05, 0.97]]],
    ids=["warp", "weft", "shear", "general"],
)  # fmt: skip
def test_patch_under_uniform_strain_has_no_inner_forces_and_the_tabulated_stress(law: Law, deformation: list):
    """First Piola-Kirchhoff stress P = F S with S00 = c11' G00 + c12' G11 ..., c' = twice the table (constant here)."""
    c11, c12, c22, c33 = 80.0, 7.0, 50.0, 20.0
    f = np.array(deformation)
    g = (f.T @ f - np.eye(2)) / 2
    s = 2 * np.array([
        [c11 * g[0, 0] + c12 * g[1, 1], c33 * g[0, 1]],
        [c33 * g[0, 1], c22 * g[1, 1] + c12 * g[0, 0]],
    ])  # fmt: skip
    mesh, inner, force = _patch_forces(f, np.tile([c11, c12, c22, c33], (6, 1)), law)
    assert np.abs(force[inner]).max() < 1e-12 * np.abs(force).max()
    for axis in (0, 1):
        assert _traction(mesh, force, axis)[:2] == pytest.approx((f @ s)[:, axis], rel=1e-10, abs=1e-12)


@pytest.mark.parametrize(("axis", "sample", "column"), [(0, 1, 0), (1, 5, 2)], ids=["warp", "weft"])
def test_stretch_samples_are_read_at_their_strain_and_direction(axis: int, sample: int, column: int):
    """Pulled by a sixth along warp (weft), the stress is lambda 2 c G with c of sample 1 (5); at rest c of sample 0."""
    table = np.random.default_rng(1).uniform(10, 100, (6, 4))
    for stretch, row, tolerance in ((1 + 1 / 6, sample, 1e-9), (1 + 1e-7, 0, 1e-5)):
        f = np.eye(2)
        f[axis, axis] = stretch
        mesh, _, force = _patch_forces(f, table, "paper")
        strain = (stretch**2 - 1) / 2
        assert _traction(mesh, force, axis)[axis] == pytest.approx(
            stretch * 2 * table[row, column] * strain, rel=tolerance
        )


def test_half_the_sampled_strain_blends_rest_and_sample():
    """E = half of the sample's Green strain along warp: q = 1/4, s = 1 - (3/4)^3, k0 = 2 [(1 - s) C0 + s C1]."""
    table, g = np.random.default_rng(3).uniform(10, 100, (6, 4)), STRAIN_SAMPLE / 2
    mesh, _ = _irregular_rectangle()
    system = _system(mesh, np.zeros(mesh.vertices, bool), gravity=1e-300)
    x = mesh.flat * [np.sqrt(1 + 2 * g), 1, 1]
    energy = system.forces(x, x, _parameters(mesh, stretch=table, bending=_rows(1, 1, 1)), exact=True)[2]
    k0 = 2 * (0.75**3 * table[0, 0] + (1 - 0.75**3) * table[1, 0])
    assert energy == pytest.approx(k0 * g**2 / 2 * 0.1 * 0.08, rel=1e-10, abs=0)


def test_bias_strain_blends_all_directions_binomially():
    """A uniaxial Green strain E at 45 degrees: k = 2 (C1 + 4 C2 + 6 C3 + 4 C4 + C5) / 16, energy density psi(E)."""
    table = np.random.default_rng(2).uniform(10, 100, (6, 4))
    g = STRAIN_SAMPLE / 2  # every entry of G
    values, vectors = np.linalg.eigh(np.eye(2) + 2 * g * np.ones((2, 2)))
    f = vectors @ np.diag(np.sqrt(values)) @ vectors.T
    mesh, _ = _irregular_rectangle()
    system = _system(mesh, np.zeros(mesh.vertices, bool), gravity=1e-300)
    x = np.column_stack([mesh.material @ f.T, np.zeros(mesh.vertices)])
    energy = system.forces(x, x, _parameters(mesh, stretch=table, bending=_rows(1, 1, 1)), exact=True)[2]
    k = 2 * np.array([1, 4, 6, 4, 1]) / 16 @ table[1:]
    psi = k[0] * g**2 / 2 + k[1] * g**2 + k[2] * g**2 / 2 + k[3] * g**2
    assert energy == pytest.approx(psi * 0.1 * 0.08, rel=1e-10)


def test_uniform_material_has_the_stiffness_it_was_asked_for():
    material = uniform_material(density=0.2, bending=1e-5, stretch=300, shear=60)
    table, strain = material.stretch.numpy(), 1e-6
    mesh, _, force = _patch_forces(np.diag([1 + strain, 1]), table, "paper")
    assert _traction(mesh, force, 0)[0] == pytest.approx(300 * strain, rel=1e-4)
    mesh, _, force = _patch_forces(np.array([[1, strain], [0, 1]]), table, "paper")
    assert _traction(mesh, force, 1)[0] == pytest.approx(60 * strain, rel=1e-4)


# --- plate stiffness --------------------------------------------------------------------------------------------------


def _cylinder(mesh: Mesh, curvature: float, degrees: float = 0.0) -> ndarray:
    """The sheet rolled up along the material direction at an angle to x: convex seen from its face."""
    along = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    s, t = mesh.material @ along, mesh.material @ [-along[1], along[0]]
    roll = np.column_stack([np.sin(curvature * s), (np.cos(curvature * s) - 1)]) / curvature
    return np.column_stack([np.outer(roll[:, 0], along) + np.outer(t, [-along[1], along[0]]), roll[:, 1]])


def _work(mesh: Mesh, law: Law, table: ndarray, shape: Callable[[float], ndarray], curvature: float) -> float:
    """Work of bending alone from flat to a curvature, integrated along the way: law `published` has no energy."""
    system = _system(mesh, np.zeros(mesh.vertices, bool), law, gravity=1e-300)
    p = _parameters(mesh, stretch=np.zeros((6, 4)), bending=table)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    work, half, step = 0.0, curvature / 2, 1e-5 * curvature
    for node, weight in zip(half * (1 + nodes), half * weights, strict=True):
        velocity = (shape(node + step) - shape(node - step)) / (2 * step)
        work -= weight * (system.forces(shape(node), mesh.flat, p, exact=False)[0] * velocity).sum()
    return work


def _hexagon(cells: int, side: float) -> Mesh:
    """A hexagon of equilateral triangles: as many hinges in each of the three directions."""
    i, j = (grid.ravel() for grid in np.meshgrid(*[np.arange(-cells, cells + 1)] * 2, indexing="ij"))
    inside = np.abs(i + j) <= cells
    points = side * np.column_stack([i + j / 2, np.sqrt(3) / 2 * j])[inside]
    faces = Delaunay(points).simplices
    edges = points[faces[:, 1:]] - points[faces[:, :1]]
    area = np.linalg.det(edges) / 2
    faces[area < 0] = faces[area < 0][:, ::-1]
    return Mesh(points, faces[np.abs(area) > 0.1 * side**2])


@pytest.mark.parametrize("degrees", [0, 17, 30, 77, 90])
def test_lattice_is_an_isotropic_plate_and_published_a_quarter_of_it(degrees: float):
    """Rolled up in any direction, every pair of faces stores B kappa^2 / 2 times a third of its area a hinge."""
    side, b, curvature = 0.005, 2e-5, -4.0  # bent so that the published law, too, leaves sample 0
    mesh = _hexagon(8, side)
    paper, published = (
        _work(mesh, law, _rows(b, b, b), lambda k: _cylinder(mesh, k, degrees), curvature)
        for law in ("paper", "published")
    )
    area = len(mesh.hinges) * np.sqrt(3) / 2 * side**2 / 3
    assert paper == pytest.approx(0.5 * b * curvature**2 * area, rel=1e-3)
    assert published == pytest.approx(paper / 4, rel=1e-9, abs=0)


@pytest.mark.parametrize("degrees", [0, 45, 77])
def test_disc_mesh_is_nearly_that_plate(degrees: float):
    """Hinges are only exact on equilateral triangles: on the irregular disc the plate comes out 2 to 4 % stiff."""
    mesh, b, curvature = disc_mesh(1205), 2e-5, 4.0
    work = _work(mesh, "paper", _rows(b, b, b), lambda k: _cylinder(mesh, k, degrees), curvature)
    assert work == pytest.approx(0.5 * b * curvature**2 * mesh.areas.sum(), rel=0.04)


@pytest.mark.parametrize(("degrees", "low", "high"), [(0, 24.5e-6, 26.5e-6), (90, 14.5e-6, 16e-6)])
@pytest.mark.parametrize("vertices", [600, 2400])
def test_hinges_of_a_disc_bring_stiff_and_soft_direction_closer(vertices: int, degrees: float, low: float, high: float):
    """As docs/physics.md says: rows of 10 to 30 uN m act like 15 along the soft and 25 to 26 along the stiff one."""
    mesh, curvature = disc_mesh(vertices), 4.0
    work = _work(mesh, "paper", _rows(1e-5, 2e-5, 3e-5), lambda k: _cylinder(mesh, k, degrees), curvature)
    assert low < 2 * work / (curvature**2 * mesh.areas.sum()) < high


@pytest.mark.parametrize(("degrees", "row"), [(90, 0), (-45, 1), (45, 1), (0, 2)])
def test_bending_takes_the_row_of_the_direction_in_which_hinges_run(degrees: float, row: int):
    """A strip at an angle to the warp, rolled up along itself, folds at hinges across it (0 degrees: the weft)."""
    mesh, curvature = _rotated(_strip(0.1, 10, 4), degrees), 3.0
    table = np.full((3, 5), 1.0)
    table[row] = 1e-5
    others = _rows(1e-9, 1e-9, 1e-9)
    others[row] = 1e-5
    stiff, soft = (_work(mesh, "paper", t, lambda k: _cylinder(mesh, k, degrees), curvature) for t in (table, others))
    row_spacing = 0.01
    rows_with_hinges, width = 10, 4 * 2 * row_spacing / np.sqrt(3)
    expected = 0.5 * 1e-5 * curvature**2 * rows_with_hinges * row_spacing * width
    assert soft == pytest.approx(expected, rel=1e-3)
    assert stiff == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    ("curvature", "weights"),
    [
        (0.0, [3 / 4, 1 / 4, 0, 0, 0]),
        (10.0, [1 / 8, 3 / 4, 1 / 8, 0, 0]),
        (25.0, [0, 0, 1 / 2, 1 / 2, 0]),
        (40.0, [0, 0, 0, 1 / 8, 7 / 8]),
        (70.0, [0, 0, 0, 0, 1]),
    ],
)
@pytest.mark.parametrize("side", [1, -1])
def test_moment_of_a_cylinder_follows_the_curvature_samples(curvature: float, weights: list, side: int):
    """dE/dkappa = B(kappa) kappa A, B the quadratic B-spline of the samples at 0, 10, 20, 30, 40 per metre."""
    mesh = _strip(0.01, 10, 4)  # rows 1 mm apart: facets are as good as the cylinder
    system = _system(mesh, np.zeros(mesh.vertices, bool), gravity=1e-300)
    table = np.tile([1.0, 3.0, 7.0, 2.0, 5.0], (3, 1)) * 1e-5
    p = _parameters(mesh, stretch=np.zeros((6, 4)), bending=table)
    curvature, step = side * max(curvature, 1e-3), 1e-4
    force = system.forces(_cylinder(mesh, curvature), mesh.flat, p, exact=False)[0]
    velocity = (_cylinder(mesh, curvature + step) - _cylinder(mesh, curvature - step)) / (2 * step)
    area = 10 * 0.001 * 4 * 2 * 0.001 / np.sqrt(3)
    assert -(force * velocity).sum() == pytest.approx(table[0] @ weights * curvature * area, rel=2e-3, abs=0)


# --- heavy strips -----------------------------------------------------------------------------------------------------


def _elastica(load: float, stiffness: float, length: float) -> ndarray:
    """Tip (x, z) of a heavy rod clamped level: B theta'' = q (L - s) cos theta, theta(0) = 0, theta'(L) = 0."""
    s = np.linspace(0, length, 100)

    def slope(s: ndarray, y: ndarray) -> ndarray:
        return np.stack([y[1], load * (length - s) * np.cos(y[0]) / stiffness, np.cos(y[0]), np.sin(y[0])])

    guess = np.stack([-1.2 * s / length, 0 * s, s, -s / 2])
    found = solve_bvp(slope, lambda a, b: np.array([a[0], b[1], a[2], a[3]]), s, guess, tol=1e-8, max_nodes=10000)
    assert found.success
    return found.y[2:, -1]


def _cantilever(mesh: Mesh, p: Parameters, tolerance: float = 1e-9) -> Equilibrium:
    """Rest of a strip whose first two lines of vertices are held level."""
    system = _system(mesh, mesh.material[:, 0] < 1e-9)
    return equilibrium(system, p, mesh.flat, mesh.flat, tolerance=tolerance)


def _tip(mesh: Mesh, x: ndarray) -> ndarray:
    return x[mesh.material[:, 0] > mesh.material[:, 0].max() - 1e-9].mean(0)


def test_elastica_agrees_with_small_deflections_and_differs_from_peirce():
    """w = q L^4 / 8 B in the small. Peirce's B = q L^3 cos(theta / 2) / (8 tan theta) is 5.7 % high at 41.5 degrees."""
    assert -_elastica(1e-3, 1.0, 1.0)[1] == pytest.approx(1e-3 / 8, rel=1e-5)
    angle = np.radians(41.5)

    def beyond(load: float) -> float:
        x, z = _elastica(load, 1.0, 1.0)
        return float(np.arctan2(-z, x) - angle)

    exact = 1 / brentq(beyond, 4.0, 14.0)
    assert np.cos(angle / 2) / (8 * np.tan(angle)) / exact == pytest.approx(1.057, abs=0.001)


@pytest.mark.parametrize("held_straight", [True, False], ids=["stiff across", "isotropic"])
def test_heavy_clamped_strip_is_the_elastica(held_straight: bool):
    """Tip within 1 % of the length, at q L^3 / B = 20: the strip hangs down by 86 % of its length.

    The last held facet is level at its middle, so the clamp of the equivalent rod lies half a facet behind x = 0.
    Stiff transverse hinges forbid the curl across; the isotropic strip is wide enough for its membrane to forbid it.
    """
    length, rows, b, density = 0.1, 16, 1e-4, 0.2
    mesh, h = _strip(length, rows, 8), length / rows
    bending = _rows(0.1, 0.1, b) if held_straight else _rows(b, b, b)
    p = _parameters(mesh, stretch=_membrane(300.0), bending=bending, density=density)
    rest = _cantilever(mesh, p)
    assert rest.converged
    expected = _elastica(density * GRAVITY, b, length + h / 2) - [h / 2, 0]
    assert expected[1] < -0.8 * length
    assert np.linalg.norm(_tip(mesh, rest.positions)[[0, 2]] - expected) < 0.01 * length


def test_small_deflection_converges_with_second_order():
    """w = q (L + h/2)^4 / 8 B + O(h^2), the clamp being half a facet behind x = 0; measured from x = 0 the order is 1.

    Lumped masses give every hinge its exact moment q s^2 / 2, and on n facets the hinges' turns add up to a tip
    deflection of exactly (1 + 1/n)^2 q L^4 / 8 B.
    """
    length, b, density = 0.1, 1e-4, 4e-4
    load = density * GRAVITY
    sizes, errors, nominal = [5, 8, 12, 18], [], []
    for rows in sizes:
        mesh, h = _strip(length, rows, 2), length / rows
        p = _parameters(mesh, stretch=_membrane(300.0), bending=_rows(0.1, 0.1, b), density=density)
        rest = _cantilever(mesh, p, tolerance=1e-6)
        assert rest.converged
        sag = -_tip(mesh, rest.positions)[2]
        assert sag == pytest.approx((1 + 1 / rows) ** 2 * load * length**4 / (8 * b), rel=2e-4)
        errors.append(abs(sag / (load * (length + h / 2) ** 4 / (8 * b)) - 1))
        nominal.append(sag / (load * length**4 / (8 * b)) - 1)
    for measured, order in ((errors, 2), (nominal, 1)):
        assert -np.polyfit(np.log(sizes), np.log(measured), 1)[0] == pytest.approx(order, abs=0.2)


def test_limp_strip_hangs_in_a_catenary():
    """z = a cosh(x / a) between level ends, all along the strip within 1 % of its length."""
    length, span, rows = 0.2, 0.12, 24
    a = brentq(lambda a: 2 * a * np.sinh(span / (2 * a)) - length, 0.01, 1.0)
    mesh = _strip(length, rows, 3)
    s = mesh.material[:, 0]
    held = (s < 1e-9) | (s > length - 1e-9)
    arc = s - length / 2
    chain = np.column_stack([
        a * np.arcsinh(arc / a) + span / 2,
        mesh.material[:, 1],
        np.sqrt(a**2 + arc**2) - np.sqrt(a**2 + length**2 / 4),
    ])  # fmt: skip
    start = chain.copy()
    start[:, 0] = span * s / length
    start[:, 2] = -0.7 * (length / 2 - np.abs(arc))
    start[s < 0] = mesh.flat[s < 0]
    p = _parameters(mesh, stretch=_membrane(300.0), bending=_rows(1e-10, 1e-10, 1e-10))
    rest = equilibrium(_system(mesh, held), p, start, start)
    assert rest.converged
    assert chain[:, 2].min() < -0.35 * length
    assert np.abs(rest.positions - chain)[~held].max() < 0.01 * length


# --- drapes -----------------------------------------------------------------------------------------------------------


def test_energy_never_rises_on_the_way_to_equilibrium():
    simulator = DrapeSimulator(disc_mesh(150), DrapeSettings())
    mesh, laid = simulator.mesh, simulator.laid_down()
    p = _parameters(mesh, stretch=_membrane(300.0), bending=_rows(1e-4, 1e-4, 1e-4))
    rest = equilibrium(simulator.system, p, laid, laid)
    energies = np.array(rest.energies)
    assert rest.converged
    assert len(energies) > 5
    assert energies[-1] < energies[0] - 1e-4 * abs(energies[0])
    assert (np.diff(energies) <= 1e-12 * np.abs(energies[:-1])).all()


def _stiff_disc(radius: float = 0.15) -> tuple[DrapeSystem, ndarray]:
    mesh = disc_mesh(150)
    scaled = Mesh(mesh.material * (radius / 0.15), mesh.faces)
    held = np.hypot(*scaled.material.T) <= PLATE_RADIUS * radius / 0.15 + 1e-9
    laid = DrapeSimulator(mesh, DrapeSettings()).laid_down() * (radius / 0.15)
    return _system(scaled, held), laid


def test_a_drop_that_came_to_rest_is_an_equilibrium_whatever_its_time_step():
    """A stiff cloth has one rest; implicit Euler's damping, which depends on the step, must not move it."""
    system, laid = _stiff_disc()
    p = _parameters(system.mesh, stretch=_membrane(300.0), bending=_rows(3e-4, 3e-4, 3e-4))
    fallen = {h: drop(system, p, laid, steps=n, step_seconds=h).positions[-1] for h, n in ((0.05, 250), (0.1, 150))}
    rest = equilibrium(system, p, fallen[0.05], laid, mu=0.0)
    assert rest.converged
    assert rest.positions[:, 2].min() < -0.01  # it drapes
    for x in fallen.values():
        assert np.abs(x - rest.positions).max() < 1e-4


def test_cloths_of_equal_bending_and_membrane_numbers_drop_alike():
    """Shapes depend on B / (rho g R^3) and C / (rho g R) only, and time on h sqrt(g / R)."""
    scale, heavier = 2.5, 3.0
    small, laid = _stiff_disc()
    large, laid_large = _stiff_disc(0.15 * scale)
    shapes = []
    for system, start, length, density in ((small, laid, 1.0, 0.2), (large, laid_large, scale, 0.2 * heavier)):
        b, c = 5e-5 * (density / 0.2) * length**3, 300 * (density / 0.2) * length
        p = _parameters(system.mesh, stretch=_membrane(c), bending=_rows(b, b, b), density=density)
        h = 0.05 * np.sqrt(length)
        shapes.append(drop(system, p, start, steps=12, step_seconds=h).positions[-1] / length)
    assert shapes[0][:, 2].min() < -0.02
    assert np.abs(shapes[0] - shapes[1]).max() < 1e-9
