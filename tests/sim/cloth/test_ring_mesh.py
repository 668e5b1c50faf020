import numpy as np
import pytest

from cusick_bench.sim.cloth.conform import conformed
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.ring_mesh import ring_mesh
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS
from cusick_bench.sim.errors import SimulationError


def radii(mesh):
    return np.hypot(*mesh.material.T)


def valence(mesh):
    return np.bincount(mesh.edges.ravel(), minlength=mesh.vertices)


@pytest.mark.parametrize("vertices", [60, 61, 97, 150, 480, 1205, 2699])
def test_ring_mesh_has_the_number_of_vertices_asked_for_and_rings_on_rim_and_plate(vertices):
    mesh = ring_mesh(vertices)
    assert mesh.vertices == vertices
    rim = len(mesh.boundary)
    np.testing.assert_array_equal(np.sort(mesh.boundary), np.arange(rim))
    np.testing.assert_allclose(radii(mesh)[:rim], CLOTH_RADIUS, rtol=1e-12)
    np.testing.assert_allclose(radii(mesh)[rim : 2 * rim], PLATE_RADIUS, rtol=1e-12)
    assert (np.abs(radii(mesh) - PLATE_RADIUS) < 1e-9).sum() == rim
    between = (radii(mesh) > PLATE_RADIUS * 1.001) & (radii(mesh) < CLOTH_RADIUS * 0.999)
    assert (valence(mesh)[between] == 6).all()
    assert len(mesh.faces) == 2 * vertices - 2 - rim  # Euler: every vertex meshed, no hole


def test_rings_stand_closer_at_the_clamp():
    levels = np.unique(radii(ring_mesh(1205))[np.flatnonzero(radii(ring_mesh(1205)) > 0.0899)].round(9))
    assert len(levels) == 10
    gaps = np.diff(levels)
    assert (np.diff(gaps) > 0).all()
    assert gaps[-1] / gaps[0] == pytest.approx(1.12 / 0.88, rel=0.1)


def test_seed_turns_the_rings_and_jitter_moves_only_what_lies_between():
    plain, turned = ring_mesh(297), ring_mesh(297, seed=1)
    assert not np.allclose(plain.material, turned.material)
    np.testing.assert_allclose(np.sort(radii(plain)), np.sort(radii(turned)), atol=1e-12)
    moved = ring_mesh(297, jitter=0.3)
    np.testing.assert_array_equal(moved.faces, plain.faces)
    offset = np.hypot(*(moved.material - plain.material).T)
    between = (radii(plain) > PLATE_RADIUS * 1.001) & (radii(plain) < CLOTH_RADIUS * 0.999)
    assert not offset[~between].any()
    assert offset[between].min() > 0
    assert offset.max() < 0.3 * np.sqrt(2) * 0.06 / 4 * 1.2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"vertices": 59}, "at least 60"),
        ({"radius": 0.08}, "0 < plate < cloth"),
        ({"vertices": 60, "plate_radius": 0.147}, "plate of 0.147 m .* take more vertices or a smaller plate"),
        ({"plate_radius": 1e-7}, "plate of 1e-07 m .* take a larger plate"),
        ({"seed": 9, "jitter": 0.4}, "jitter of 0.4 turns triangles .* take less of it, or another seed"),
        ({"vertices": 60, "plate_radius": 0.147, "jitter": 0.2}, "take more vertices or a smaller plate"),
        ({"jitter": 0.5}, "jitter must lie from 0 to 0.4"),
        ({"jitter": float("nan")}, "jitter must lie from 0 to 0.4"),
    ],
)
def test_ring_mesh_says_what_it_cannot_make(options, message):
    with pytest.raises(SimulationError, match=message):
        ring_mesh(**options)


@pytest.mark.parametrize("made_for", [0.06, 0.07, 0.08, 0.1])
def test_conformed_mesh_has_a_closed_ring_on_the_plate(made_for):
    mesh = disc_mesh(297, plate_radius=made_for)
    result = conformed(mesh, PLATE_RADIUS)
    np.testing.assert_array_equal(result.faces, mesh.faces)
    np.testing.assert_array_equal(result.material[mesh.boundary], mesh.material[mesh.boundary])
    side = np.sign((radii(result) - PLATE_RADIUS).round(12))
    assert not (side[result.edges].prod(1) < 0).any()
    on_ring = np.flatnonzero(side == 0)
    along = np.isin(result.edges, on_ring).all(1)
    assert along.sum() == len(on_ring) > 15
    assert (result.areas > 0.1 * mesh.areas).all()


def test_mesh_with_a_ring_stays():
    mesh = disc_mesh(150)
    np.testing.assert_allclose(conformed(mesh, PLATE_RADIUS).material, mesh.material, atol=1e-15)


def test_mesh_that_cannot_be_conformed_is_refused():
    with pytest.raises(SimulationError, match="of its area"):
        conformed(disc_mesh(97), 0.149)
    mesh = disc_mesh(97)
    with pytest.raises(SimulationError, match="seams"):
        conformed(Mesh(mesh.material, mesh.faces, mesh.corners), PLATE_RADIUS)
    corners = np.array([[0.0, 0.0], [0.15, 0.0], [0.0, 0.15], [-0.15, 0.0], [0.0, -0.15]])
    coarse = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]]))
    with pytest.raises(SimulationError, match="no closed path of edges"):
        conformed(coarse, PLATE_RADIUS)


def test_ring_that_lies_near_the_plate_is_moved_as_a_whole():
    mesh = disc_mesh(586, plate_radius=0.0946)
    result = conformed(mesh, PLATE_RADIUS)
    moved = np.flatnonzero(np.abs(radii(result) - PLATE_RADIUS) < 1e-12)
    np.testing.assert_array_equal(moved, np.flatnonzero(np.abs(radii(mesh) - 0.0946) < 1e-9))


@pytest.mark.parametrize("share", [0.15, 0.5, 0.9])
def test_ring_mesh_suits_other_plates(share):
    mesh = ring_mesh(300, radius=0.2, plate_radius=share * 0.2)
    assert mesh.vertices == 300
    assert (np.abs(radii(mesh) - share * 0.2) < 1e-9).sum() == len(mesh.boundary)


def test_disc_too_coarse_for_its_plate_is_refused():
    with pytest.raises(SimulationError, match="78 vertices are too few"):
        disc_mesh(78, radius=0.129, plate_radius=0.102)
