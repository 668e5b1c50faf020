"""Patterns of skirts: sewn meshes, and how a circular and an A-line skirt are cut."""

import tracemalloc

import numpy as np
import pytest
from numpy import ndarray
from worn_skirts import SIZE

from cusick_bench.garment import GarmentError, a_line_skirt, circular_skirt
from cusick_bench.garment.skirt import SkirtSize
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.triangles.elements import elements_of
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.errors import SimulationError


def _halves_apart(mesh: Mesh, turn: bool) -> tuple[Mesh, ndarray]:
    """A disc cut in two along its middle: the right half lies elsewhere in the pattern, turned by 90 degrees or not."""
    right = mesh.corners.mean(1)[:, 0] > 0
    pattern = mesh.corners.copy()
    moved = np.stack([-pattern[..., 1], pattern[..., 0]], -1) if turn else pattern
    pattern[right] = moved[right] + [0.7, -0.2]
    return Mesh(mesh.material, mesh.faces, pattern), right


def _forces(mesh: Mesh, stretch: ndarray, bending: ndarray) -> ndarray:
    system = DrapeSystem(mesh, "paper", 9.8, np.hypot(*mesh.material.T) < 0.05, np.zeros(mesh.vertices))
    mass = np.bincount(mesh.faces.ravel(), np.repeat(0.2 * mesh.areas / 3, 3), mesh.vertices)
    x = 1.03 * mesh.flat + np.random.default_rng(0).normal(0, 2e-3, (mesh.vertices, 3))
    return system.forces(x, x, Parameters(stretch, bending, mass, np.zeros(len(mesh.hinges))), exact=True)[0]


def test_a_seam_that_joins_what_was_one_piece_changes_nothing():
    mesh, bending = disc_mesh(150), np.array([2e-5, 1e-5, 3e-5])[None, :, None].repeat(5, 2)
    stretch = np.tile([150.0, 3.0, 90.0, 40.0], (1, 6, 1))
    expected, found = (_forces(m, stretch, bending) for m in (mesh, _halves_apart(mesh, turn=False)[0]))
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


def test_a_panel_cut_across_the_grain_has_warp_and_weft_swapped():
    mesh, bending = disc_mesh(150), np.full((1, 3, 5), 1e-5)
    sewn, right = _halves_apart(mesh, turn=True)
    table = np.column_stack([np.full(6, 150.0), np.full(6, 3.0), np.linspace(50, 100, 6), np.full(6, 40.0)])
    swapped = table[[0, 5, 4, 3, 2, 1]][:, [2, 1, 0, 3]]
    expected = _forces(mesh, np.where(right[:, None, None], swapped, table), bending)
    found = _forces(sewn, table[None], bending)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()
    assert np.abs(_forces(mesh, table[None], bending) - expected).max() > 0.01 * np.abs(expected).max()


def test_a_hinge_on_a_seam_bends_in_the_mean_direction_of_both_panels():
    mesh = disc_mesh(150)
    sewn, right = _halves_apart(mesh, turn=True)
    whole, e = elements_of(mesh), elements_of(sewn)
    direction, before = (el.direction_low + el.direction_fraction for el in (e, whole))
    sides = right[_hinge_faces(sewn)]
    seam = sides[:, 0] != sides[:, 1]
    assert seam.any()
    np.testing.assert_allclose(direction[seam], 1.0)  # d on one side, 2 - d on the other
    np.testing.assert_allclose(direction[sides.all(1)], 2 - before[sides.all(1)], atol=1e-12)
    np.testing.assert_allclose(e.hinge_weight, whole.hinge_weight, rtol=1e-9)


def _hinge_faces(mesh: Mesh) -> ndarray:
    """The two faces of every hinge, by looking for them."""
    sets = {frozenset(face): number for number, face in enumerate(mesh.faces.tolist())}
    return np.array([[sets[frozenset((a, b, c))], sets[frozenset((a, b, d))]] for a, b, c, d in mesh.hinges.tolist()])


def test_a_pattern_must_fit_the_faces():
    mesh = disc_mesh(150)
    with pytest.raises(SimulationError, match="pattern must be finite with shape"):
        Mesh(mesh.material, mesh.faces, np.full_like(mesh.corners, np.nan))
    with pytest.raises(SimulationError, match="counter-clockwise"):
        Mesh(mesh.material, mesh.faces, mesh.corners[:, ::-1])


@pytest.mark.parametrize("make", [circular_skirt, a_line_skirt])
def test_skirts_are_tubes_of_the_asked_size(make):
    skirt = make(SIZE, 300)
    mesh = skirt.mesh
    assert abs(mesh.vertices - 300) < 45
    assert mesh.vertices - len(mesh.edges) + len(mesh.faces) == 0  # Euler: a sheet with one hole
    rim = len(mesh.edges) - len(mesh.hinges)
    assert rim == len(skirt.hem) + skirt.waist.sum()
    waist, hem = skirt.start[skirt.waist], skirt.start[skirt.hem]
    np.testing.assert_allclose(np.hypot(*waist[:, :2].T), 0.11, atol=1e-12)
    np.testing.assert_allclose(waist[:, 2], 0, atol=1e-12)
    outer = 0.51 if make is circular_skirt else 0.25
    np.testing.assert_allclose(np.hypot(*hem[:, :2].T), outer, atol=1e-12)
    area = np.pi * (0.11 + outer) * 0.4  # mantle of a truncated cone, flat or not
    assert mesh.areas.sum() == pytest.approx(area, rel=0.02)


def test_only_an_a_line_skirt_needs_a_hem_between_waist_and_length():
    for size in (SkirtSize(waist=0.25, length=0.6), SkirtSize(waist=0.11, length=0.1)):
        assert circular_skirt(size, 300).size is size
        with pytest.raises(GarmentError, match="must be wider than its waist and narrower than waist"):
            a_line_skirt(size, 300)


@pytest.mark.parametrize("hem", [0.13, 0.12, 0.1105, 0.1101])
def test_an_a_line_skirt_may_be_hardly_wider_at_its_hem_than_at_its_waist(hem):
    """Its panels' apex is up to 385 m away, and from above its cone is a ring narrower than a chord's sagitta."""
    tracemalloc.start()
    skirt = a_line_skirt(SkirtSize(waist=0.11, length=0.35, hem=hem), 200)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6  # [bytes]
    mesh = skirt.mesh
    assert mesh.vertices - len(mesh.edges) + len(mesh.faces) == 0
    assert mesh.areas.sum() == pytest.approx(np.pi * (0.11 + hem) * 0.35, rel=0.01)
    np.testing.assert_allclose(np.hypot(*skirt.start[skirt.hem, :2].T), hem, atol=1e-12)
    space, flat = skirt.start[mesh.faces], mesh.corners
    lengths = [np.linalg.norm(x - np.roll(x, 1, axis=1), axis=-1) for x in (space, flat)]
    assert np.abs(lengths[0] / lengths[1] - 1).max() < 0.02


def test_a_hem_as_wide_as_the_waist_is_refused_within_a_ten_thousandth_of_the_length():
    for hem in (0.11, 0.11 + 3e-5, 0.46 - 3e-5):
        with pytest.raises(GarmentError, match=r"by 3\.5e-05 m at least"):
            a_line_skirt(SkirtSize(waist=0.11, length=0.35, hem=hem), 200)


def test_the_a_line_cone_is_free_of_strain_up_to_its_chords():
    """A cone is developable, so edges are as long in space as in the pattern, but for arcs replaced by chords."""
    errors = []
    for vertices in (200, 800):
        skirt = a_line_skirt(SIZE, vertices)
        space, flat = skirt.start[skirt.mesh.faces], skirt.mesh.corners
        lengths = [np.linalg.norm(x - np.roll(x, 1, axis=1), axis=-1) for x in (space, flat)]
        errors.append(np.abs(lengths[0] / lengths[1] - 1).max())
    assert errors[0] < 0.02
    assert errors[1] < 0.4 * errors[0]


def test_a_line_panels_have_their_warp_down_the_middle_of_front_and_back():
    skirt = a_line_skirt(SIZE, 400)
    corner = skirt.mesh.corners
    matrices = np.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]], 2)
    place = skirt.start[skirt.mesh.faces]
    edges = np.stack([place[:, 1] - place[:, 0], place[:, 2] - place[:, 0]], 2)
    warp = (edges @ np.linalg.inv(matrices))[:, :, 0]
    centre = place.mean(1)
    middle = np.abs(centre[:, 0]) < 0.02
    assert (centre[middle, 1] > 0).any()
    assert (centre[middle, 1] < 0).any()
    assert (np.abs(warp[middle, 0]) < 0.12).all()
    assert (warp[middle, 2] < -0.8).all()
