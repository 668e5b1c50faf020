import numpy as np
import pytest
from shells import jittered, stencils_of

from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.engine.triangles.hinge_kernels import hinge_angles

MESHES = {"disc": disc_mesh(120), "jittered": jittered(disc_mesh(120), 0.15)}


def dihedral_angles(mesh, height):
    """Angles of the surface z = height(x, y) as the bending energy of law `paper` measures them."""
    x = np.column_stack([mesh.material, height])
    angle = np.empty(len(mesh.hinges))
    hinge_angles(np.ascontiguousarray(mesh.hinges), x, angle)
    return angle


@pytest.mark.parametrize("name", MESHES)
def test_curvature_of_quadratic_rest_shape_is_exact(name):
    mesh = MESHES[name]
    x, y = mesh.material.T
    wanted = np.array([-1.3, 0.4, 2 * 0.7]) * 1e-4  # small, since angles are linear in curvature only there [1/m]
    angle = dihedral_angles(mesh, (wanted[0] * x * x + wanted[1] * y * y + wanted[2] * x * y) / 2)
    found = (stencils_of(mesh).rest_curvature @ angle).reshape(-1, 3)
    np.testing.assert_allclose(found, np.tile(wanted, (len(found), 1)), atol=1e-9 * np.abs(wanted).max() + 1e-12)


def test_cap_convex_seen_from_its_face_has_positive_angles_and_negative_curvature():
    mesh = MESHES["disc"]
    angle = dihedral_angles(mesh, -0.5 * 0.01 * (mesh.material**2).sum(1))
    assert (angle > 0).all()
    found = (stencils_of(mesh).rest_curvature @ angle).reshape(-1, 3)
    np.testing.assert_allclose(found, np.tile([-0.01, -0.01, 0.0], (len(found), 1)), atol=1e-6)
