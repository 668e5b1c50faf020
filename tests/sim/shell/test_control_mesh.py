import numpy as np
import pytest
from shells import jittered, on_plate, stencils_of

from cusick_bench.sim.cloth.conform import conformed
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.cloth.ring_mesh import ring_mesh
from cusick_bench.sim.constants import PLATE_RADIUS
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.shell.control_mesh import control_mesh, limit_weight, loop_beta
from cusick_bench.sim.shell.stencils import shell_stencils

MESHES = {
    "disc": lambda: disc_mesh(150),
    "jittered": lambda: jittered(disc_mesh(150), 0.15),
    "rings": lambda: ring_mesh(150),
    "conformed": lambda: conformed(disc_mesh(150, plate_radius=0.07), PLATE_RADIUS),
}


def controls_of(mesh):
    return control_mesh(mesh, on_plate(mesh), PLATE_RADIUS)


def test_masks_of_a_regular_vertex():
    assert loop_beta(np.array([6])) == pytest.approx(1 / 16)
    assert limit_weight(np.array([6])) == pytest.approx(1 / 12)


@pytest.mark.parametrize("name", MESHES)
def test_limit_surface_carries_every_vertex_at_its_material_point(name):
    mesh = MESHES[name]()
    control = controls_of(mesh)
    outside = control.vertices_outside
    np.testing.assert_allclose((control.limit @ control.material)[outside], mesh.material[outside], atol=1e-12)
    x, y = mesh.material[outside].T
    quadratics = (control.limit @ control.quadratics)[outside]
    np.testing.assert_allclose(quadratics, np.column_stack([x * x, x * y, y * y]), atol=1e-13)


@pytest.mark.parametrize("name", MESHES)
def test_every_control_point_but_those_of_the_mesh_lies_beyond_clamp_or_rim(name):
    mesh = MESHES[name]()
    control = controls_of(mesh)
    ghosts = np.hypot(*control.material[mesh.vertices :].T)
    assert len(ghosts) > 0
    assert ((ghosts < PLATE_RADIUS) | (ghosts > 0.14)).all()
    assert (ghosts > 0.14).sum() == len(mesh.boundary)


def test_displacement_that_is_alike_along_the_clamp_keeps_position_and_slope_there():
    mesh = ring_mesh(297)
    control = controls_of(mesh)
    distance = np.hypot(*mesh.material[control.free].T) - PLATE_RADIUS
    moved = control.extension @ np.sin(40 * distance)
    np.testing.assert_allclose((control.limit @ moved)[control.clamp], 0, atol=1e-15)
    images = slice(mesh.vertices, control.controls - len(mesh.boundary))
    mirrored = 2 * PLATE_RADIUS - np.hypot(*control.material[images].T)
    originals = np.hypot(*control.material[control.free].T)
    nearest = np.abs(mirrored[:, None] - originals).argmin(1)
    np.testing.assert_allclose(moved[images], moved[control.free][nearest], atol=1e-12)


def test_clamp_holds_position_and_slope_in_the_limit():
    """A displacement with folds, on finer and finer meshes: what is left at the clamp falls with the edges."""
    left = []
    for vertices in (297, 1205):
        mesh = disc_mesh(vertices)
        control, stencils = controls_of(mesh), stencils_of(mesh)
        distance = np.hypot(*stencils.control_material.T) - PLATE_RADIUS
        angle = np.arctan2(*stencils.control_material.T)
        moved = (distance / 0.06) ** 2 * np.cos(5 * angle)
        at_clamp = np.isin(control.vertices_outside, control.clamp)
        used = stencils.vertex_weights[at_clamp]
        slope = np.einsum("prn,pn->pr", used, moved[stencils.vertex_nodes[at_clamp]])
        position = (control.limit @ control.extension @ moved)[control.clamp]
        left.append((np.abs(position).max(), np.abs(slope).max()))
    assert left[1][0] < left[0][0] / 3
    assert left[1][0] < 1e-3
    assert left[1][1] < left[0][1] / 1.5


def test_mesh_without_a_ring_on_the_plate_is_refused():
    mesh = disc_mesh(150, plate_radius=0.07)
    fixed = np.hypot(*mesh.material.T) < PLATE_RADIUS
    with pytest.raises(SimulationError, match=r"ring of vertices on the plate's edge of radius 0\.09 m, but vertex"):
        shell_stencils(mesh, fixed, PLATE_RADIUS)


def test_clamp_that_is_no_closed_ring_is_refused():
    mesh = disc_mesh(150)
    fixed = on_plate(mesh)
    fixed[np.flatnonzero(np.abs(np.hypot(*mesh.material.T) - PLATE_RADIUS) < 1e-6)[3]] = False
    with pytest.raises(SimulationError, match="law plate needs a closed ring of vertices"):
        shell_stencils(mesh, fixed, PLATE_RADIUS)


@pytest.mark.parametrize(("value", "message"), [(True, "all vertices"), (False, "no fixed vertex")])
def test_cloth_that_is_held_everywhere_or_nowhere_is_refused(value, message):
    mesh = disc_mesh(97)
    with pytest.raises(SimulationError, match=message):
        shell_stencils(mesh, np.full(mesh.vertices, value), PLATE_RADIUS)


def test_seams_are_refused():
    mesh = disc_mesh(97)
    sewn = Mesh(mesh.material, mesh.faces, mesh.corners)
    with pytest.raises(SimulationError, match="pattern"):
        stencils_of(sewn)


def test_rim_on_the_plate_is_refused():
    mesh = disc_mesh(97)
    fixed = on_plate(mesh)
    fixed[mesh.boundary[:3]] = True
    with pytest.raises(SimulationError, match="law plate needs a closed ring"):
        shell_stencils(mesh, fixed, PLATE_RADIUS)


def test_rim_face_with_two_rim_edges_is_allowed():
    mesh = disc_mesh(150)
    first, second = mesh.boundary[:2]
    ear = 1.12 * (mesh.material[first] + mesh.material[second]) / 2
    eared = Mesh(np.vstack([mesh.material, ear]), np.vstack([mesh.faces, [[second, first, mesh.vertices]]]))
    stencils = stencils_of(eared)
    assert np.isfinite(stencils.edge_weights).all()
    np.testing.assert_allclose(stencils.bending_of_edge.sum(1), 1)
