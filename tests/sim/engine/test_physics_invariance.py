"""What must not change a drape: rigid motion, numbering, swapping warp and weft, mirroring, the sign of curvature."""

import numpy as np
import pytest
from cotton_tables import BENDING, STRETCH
from numpy import ndarray
from scipy.spatial.transform import Rotation

from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.constants import PLATE_RADIUS, Law
from cusick_bench.sim.engine.dynamics.drop import drop
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.statics.equilibrium import equilibrium
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.linear.interface import NotPositiveDefinite

pytestmark = pytest.mark.usefixtures("one_thread")

LAWS: list[Law] = ["paper", "published"]


def _system(mesh: Mesh, law: Law, gravity: float = 9.8) -> DrapeSystem:
    held = np.hypot(*mesh.material.T) <= PLATE_RADIUS + 1e-9
    return DrapeSystem(mesh, law, gravity, held, np.zeros(mesh.vertices))


def _parameters(mesh: Mesh, stretch: ndarray = STRETCH, bending: ndarray = BENDING) -> Parameters:
    mass = np.bincount(mesh.faces.ravel(), np.repeat(0.19 * mesh.areas / 3, 3), mesh.vertices)
    return Parameters(stretch.reshape(-1, 6, 4), bending.reshape(-1, 3, 5), mass, np.zeros(len(mesh.hinges)))


def _crumpled(mesh: Mesh) -> ndarray:
    return 1.05 * mesh.flat + np.random.default_rng(0).normal(0, 2e-3, (mesh.vertices, 3))


def _inner(mesh: Mesh, law: Law, x: ndarray, p: Parameters) -> tuple[ndarray, float]:
    """Forces of the cloth alone, and their energy (law `paper`)."""
    force, _, energy = _system(mesh, law, gravity=1e-300).forces(x, x, p, exact=law == "paper")
    return force, energy


def _drape(mesh: Mesh, law: Law, p: Parameters, laid: ndarray) -> ndarray:
    return drop(_system(mesh, law), p, laid, steps=8, step_seconds=0.05).positions[-1]


def _laid(mesh: Mesh) -> ndarray:
    """Lumpy outside the plate, as a function of the place, so that a moved mesh is laid down alike."""
    x, y = mesh.material.T
    laid = mesh.flat.copy()
    outside = np.maximum(np.hypot(x, y) - PLATE_RADIUS, 0)
    laid[:, 2] = outside * 0.05 * (np.sin(40 * x + 1) + np.cos(55 * y + 30 * x))
    return laid


@pytest.mark.parametrize("law", LAWS)
def test_rigid_motion_turns_forces_along_and_keeps_energy(law: Law):
    mesh = disc_mesh(100)
    p, x = _parameters(mesh), _crumpled(mesh)
    turn = Rotation.from_euler("xyz", [0.4, -1.1, 2.5]).as_matrix()
    force, energy = _inner(mesh, law, x, p)
    moved, moved_energy = _inner(mesh, law, x @ turn.T + [0.3, -2.0, 0.7], p)
    scale = np.abs(force).max()
    assert np.abs(moved - force @ turn.T).max() < 1e-10 * scale
    assert moved_energy == pytest.approx(energy, rel=1e-10)


@pytest.mark.parametrize("law", LAWS)
def test_inner_forces_have_no_resultant_and_no_moment(law: Law):
    mesh = disc_mesh(100)
    x = _crumpled(mesh)
    force, _ = _inner(mesh, law, x, _parameters(mesh))
    assert np.abs(force.sum(0)).max() < 1e-11 * np.abs(force).sum()
    assert np.abs(np.cross(x, force).sum(0)).max() < 1e-11 * np.abs(np.cross(x, force)).sum()


@pytest.mark.parametrize("law", LAWS)
def test_flat_undeformed_cloth_is_free_of_force(law: Law):
    mesh = disc_mesh(100)
    force, _ = _inner(mesh, law, mesh.flat, _parameters(mesh))
    assert np.abs(force).max() < 1e-12


@pytest.mark.parametrize("law", LAWS)
def test_renumbering_vertices_and_faces_changes_nothing(law: Law):
    mesh, generator = disc_mesh(150), np.random.default_rng(1)
    new_of_old = generator.permutation(mesh.vertices)
    old_of_new = np.argsort(new_of_old)
    rolled = np.take_along_axis(mesh.faces, (np.arange(3) + generator.integers(0, 3, (len(mesh.faces), 1))) % 3, axis=1)
    other = Mesh(mesh.material[old_of_new], new_of_old[generator.permutation(rolled)])
    expected = _drape(mesh, law, _parameters(mesh), _laid(mesh))
    found = _drape(other, law, _parameters(other), _laid(other))
    assert np.ptp(expected[:, 2]) > 0.01
    assert np.abs(found[new_of_old] - expected).max() < 1e-9


def _swapped(stretch: ndarray, bending: ndarray) -> tuple[ndarray, ndarray]:
    """The same cloth with warp and weft exchanged: c11 <-> c22, directions 0 .. 90 reversed."""
    # contiguous: kernels would be compiled again for arrays with strides
    return np.ascontiguousarray(stretch[[0, 5, 4, 3, 2, 1]][:, [2, 1, 0, 3]]), np.ascontiguousarray(bending[::-1])


@pytest.mark.parametrize("law", LAWS)
def test_quarter_turn_of_the_cloth_swaps_warp_and_weft(law: Law):
    """The published strain grid gives equal stretches without shear to the warp sample (a quirk: the tie is not even),
    so there the swap is exact only for a cloth whose warp and weft samples are alike at that strain."""
    mesh, stretch = disc_mesh(150), STRETCH.copy()
    if law == "published":
        stretch[[1, 5], 0] = stretch[[1, 5], 2] = 190.0
        stretch[5] = stretch[1]
    quarter = np.array([[0.0, 1.0], [-1.0, 0.0]])  # (x, y) -> (-y, x), from the right
    turned = Mesh(mesh.material @ quarter, mesh.faces)
    laid, straight = _laid(mesh), (stretch, BENDING)
    laid_turned = np.column_stack([laid[:, :2] @ quarter, laid[:, 2]])
    expected = _drape(mesh, law, _parameters(mesh, *straight), laid)
    expected = np.column_stack([expected[:, :2] @ quarter, expected[:, 2]])
    swapped = _drape(turned, law, _parameters(turned, *_swapped(*straight)), laid_turned)
    unswapped = _drape(turned, law, _parameters(turned, *straight), laid_turned)
    assert np.abs(swapped - expected).max() < 1e-9
    assert np.abs(unswapped - expected).max() > 1e-4


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("axis", [0, 1])
def test_mirrored_cloth_gives_the_mirrored_drape(law: Law, axis: int):
    """Mirrored at the warp or weft axis, faces turned over so that they stay counter-clockwise: same sides up."""
    mesh, mirror = disc_mesh(150), np.ones(3)
    mirror[axis] = -1
    other = Mesh(mesh.material * mirror[:2], mesh.faces[:, [0, 2, 1]])
    laid = _laid(mesh)
    expected = _drape(mesh, law, _parameters(mesh), laid)
    found = _drape(other, law, _parameters(other), laid * mirror)
    assert np.abs(found - expected * mirror).max() < 1e-9


def test_paper_law_bends_alike_to_both_sides_and_the_published_one_does_not():
    """The published program reads its curvature samples for one sign of the angle; the other takes sample 0."""
    mesh = disc_mesh(150)
    x, y = mesh.material.T
    bowl, flip = np.column_stack([x, y, 10 * (x**2 + y**2)]), np.array([1, 1, -1])

    def asymmetry(law: Law, bending: ndarray) -> float:
        p = _parameters(mesh, np.zeros((6, 4)), bending)
        up, down = (_inner(mesh, law, shape, p)[0] for shape in (bowl, bowl * flip))
        return float(np.abs(down - up * flip).max() / np.abs(up).max())

    constant = np.repeat(BENDING[:, :1], 5, axis=1)
    assert asymmetry("paper", BENDING) < 1e-12
    assert asymmetry("published", constant) < 1e-12
    assert asymmetry("published", BENDING) > 0.5


@pytest.mark.parametrize("seed", range(5))
def test_admissible_tables_store_energy_under_any_strain(seed: int):
    """[[c11, c12], [c12, c22]] positive definite and c33, B positive at every sample: no strain gives energy back."""
    generator, mesh = np.random.default_rng(seed), disc_mesh(100)
    c11, c22 = generator.uniform(1, 300, (2, 6))
    c12 = generator.uniform(-0.99, 0.99, 6) * np.sqrt(c11 * c22)
    stretch = np.column_stack([c11, c12, c22, generator.uniform(1, 100, 6)])
    p = _parameters(mesh, stretch, generator.uniform(1e-6, 1e-4, (3, 5)))
    for size in (1e-3, 3e-2, 0.2):
        x = mesh.flat + generator.normal(0, 0.02 * size, mesh.flat.shape)
        x[:, :2] += mesh.material @ generator.normal(0, size, (2, 2))
        system = _system(mesh, "paper", gravity=1e-300)
        assert system.forces(x, x, p, exact=True)[2] > 0
        elements = system.evaluate(x[None], x[None], p.batch(), exact=True, everywhere=True).work
        assert elements.face_energy.min() >= 0
        assert elements.hinge_energy.min() >= 0


def test_stiffness_of_the_implicit_step_has_no_negative_direction():
    """Holds for c12 >= 0; with c12 < 0 the published geometric term (k0 G00+ + k1 G11+) D_uu can turn negative."""
    mesh, x = disc_mesh(100), 1.1 * _crumpled(disc_mesh(100))
    for law in LAWS:
        system = _system(mesh, law)
        _, blocks, _ = system.forces(x, x, _parameters(mesh), exact=False)
        largest = np.abs(blocks).max()
        system.add_diagonal(blocks, np.full(mesh.vertices, 1e-9 * largest))
        factor = system.linear.factorise(blocks)  # raises where a pivot is not positive
        direction = np.random.default_rng(0).normal(size=(len(system.free), 3))
        assert (factor.solve(direction) * direction).sum() > 0
        system.add_diagonal(blocks, np.full(mesh.vertices, -0.1 * largest))
        with pytest.raises(NotPositiveDefinite):  # the factorisation above could have failed
            system.linear.factorise(blocks)


def test_orientation_of_the_plate_does_not_matter_to_an_isotropic_cloth():
    """Turned by 20 degrees with mesh and laying, an isotropic cloth at rest is turned by 20 degrees."""
    mesh = disc_mesh(150)
    isotropic = np.array([100.0, 0.0, 100.0, 100.0])  # G:G is the only invariant: c12 = 0, c33 = c11
    bending = np.full((3, 5), 3e-4)
    turn = Rotation.from_euler("z", 20, degrees=True).as_matrix()
    turned = Mesh(mesh.material @ turn[:2, :2].T, mesh.faces)
    shapes = []
    for each, laid in ((mesh, _laid(mesh)), (turned, _laid(mesh) @ turn.T)):
        p = _parameters(each, np.tile(isotropic, (6, 1)), bending)
        rest = equilibrium(_system(each, "paper"), p, laid, laid)
        assert rest.converged
        shapes.append(rest.positions)
    assert np.ptp(shapes[0][:, 2]) > 0.01
    assert np.abs(shapes[1] - shapes[0] @ turn.T).max() < 1e-6
