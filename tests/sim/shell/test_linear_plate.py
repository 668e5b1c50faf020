"""The clamped annulus under its own weight, against the exact solution of plate theory."""

import numpy as np
import pytest
from shells import deflection, jittered, on_plate, relative_tip_deflection

from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.ring_mesh import ring_mesh

MESHES = {
    "disc": lambda: disc_mesh(480),
    "disc, jittered": lambda: jittered(disc_mesh(480), 0.1),
    "rings": lambda: ring_mesh(640),
    "rings, jittered": lambda: ring_mesh(640, jitter=0.1),
}


@pytest.mark.parametrize("poisson", [-1 / 3, 0.0, 0.3])
@pytest.mark.parametrize("name", MESHES)
def test_deflection_is_that_of_plate_theory(name, poisson):
    assert relative_tip_deflection(MESHES[name](), poisson) == pytest.approx(1, abs=0.01)


@pytest.mark.parametrize("poisson", [-1 / 3, 0.0, 0.3])
def test_error_falls_with_the_square_of_the_edges(poisson):
    vertices = np.array([297, 480, 800, 1205])
    errors = [abs(relative_tip_deflection(ring_mesh(int(number)), poisson) - 1) for number in vertices]
    slope = np.polyfit(-0.5 * np.log(vertices), np.log(errors), 1)[0]
    assert slope > 1.8


@pytest.mark.parametrize("jitter", [0.3, 0.4])
def test_distorted_triangles_give_no_wild_deflection(jitter):
    assert relative_tip_deflection(ring_mesh(480, jitter=jitter), 0.0) == pytest.approx(1, abs=0.05)


def test_numbers_of_vertices_and_faces_do_not_matter():
    mesh, generator = jittered(disc_mesh(150), 0.1), np.random.default_rng(3)
    order, turn = generator.permutation(mesh.vertices), generator.integers(0, 3, len(mesh.faces))
    faces = np.argsort(order)[mesh.faces[generator.permutation(len(mesh.faces))]]
    faces = np.take_along_axis(faces, (turn[:, None] + np.arange(3)) % 3, axis=1)
    again = deflection(Mesh(mesh.material[order], faces), 0.2)
    first = deflection(mesh, 0.2)
    np.testing.assert_allclose(again, first[order], atol=1e-9 * first.max())


def test_turned_cloth_deflects_alike():
    mesh = jittered(disc_mesh(150), 0.1)
    turned = Mesh(np.column_stack([-mesh.material[:, 1], mesh.material[:, 0]]), mesh.faces)
    first = deflection(mesh, 0.2)
    np.testing.assert_allclose(deflection(turned, 0.2), first, atol=1e-9 * first.max())


def test_only_free_vertices_deflect():
    mesh = disc_mesh(150)
    moved = deflection(mesh, 0.2)
    assert not moved[on_plate(mesh)].any()
    assert (moved[~on_plate(mesh)] > 0).all()
