import numpy as np
import pytest
from shells import edge_matrices, jittered, lumped_area, on_plate, row_matrix, stencils_of

from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.cloth.ring_mesh import ring_mesh
from cusick_bench.sim.constants import PLATE_RADIUS
from cusick_bench.sim.shell.coefficients import outside_edges
from cusick_bench.sim.shell.control_mesh import control_mesh

MESHES = {
    "disc": disc_mesh(600),
    "jittered": jittered(disc_mesh(600), 0.15),
    "rings": ring_mesh(700),
    "rings, jittered": ring_mesh(700, jitter=0.4),
}


@pytest.fixture(scope="module", params=list(MESHES))
def mesh(request):
    return MESHES[request.param]


@pytest.fixture(scope="module")
def stencils(mesh):
    return stencils_of(mesh)


@pytest.fixture(scope="module")
def control(mesh):
    return control_mesh(mesh, on_plate(mesh), PLATE_RADIUS)


@pytest.fixture(scope="module")
def edges(mesh, control):
    return outside_edges(mesh, control.outside)


def away_from(vertices, mesh, control):
    """Whether the vertices' neighbours all differ from the given ones."""
    marked = np.zeros(control.controls)
    marked[vertices] = 1
    return (control.neighbours @ marked)[: mesh.vertices] + marked[: mesh.vertices] == 0


def two_rings_away(vertices, mesh, control):
    """Whether the vertices outside are no neighbours' neighbours of the given ones."""
    near = np.flatnonzero(~away_from(vertices, mesh, control))
    return away_from(near, mesh, control)[control.vertices_outside]


def slope_matrix(stencils, row):
    weights = stencils.vertex_weights[:, row]
    return row_matrix(stencils.vertex_nodes, stencils.vertex_counts, weights, len(stencils.free))


def test_linear_displacements_are_differentiated_exactly(mesh, stencils, control, edges):
    displacement = stencils.control_material @ [0.3, -0.7] + 0.1
    away = away_from(control.clamp, mesh, control)
    at = away[edges.ends].all(1)
    assert at.sum() > 100
    found = np.column_stack([row @ displacement for row in edge_matrices(stencils)])[at]
    np.testing.assert_allclose(found[:, :2], np.tile([0.3, -0.7], (at.sum(), 1)), atol=1e-9)
    np.testing.assert_allclose(found[:, 2:], 0, atol=1e-6)  # 1/m2 times an edge of 1 cm: 1e-8
    at = two_rings_away(control.clamp, mesh, control)
    assert at.sum() > 50
    for row, wanted in enumerate((0.3, -0.7)):
        np.testing.assert_allclose((slope_matrix(stencils, row) @ displacement)[at], wanted, atol=1e-9)


def test_quadratic_displacements_are_differentiated_exactly(mesh, stencils, control, edges):
    displacement = control.quadratics[stencils.free] @ [1.5, -0.4, 0.8]  # of xx, xy, yy
    rim = np.isin(np.arange(mesh.vertices), mesh.boundary)
    at = (away_from(control.clamp, mesh, control) & ~rim)[edges.ends].all(1)
    assert at.sum() > 50
    x, y = stencils.edge_points[at].T
    found = np.column_stack([row @ displacement for row in edge_matrices(stencils)])[at]
    np.testing.assert_allclose(found[:, 0], 3.0 * x - 0.4 * y, atol=1e-10)
    np.testing.assert_allclose(found[:, 1], -0.4 * x + 1.6 * y, atol=1e-10)
    np.testing.assert_allclose(found[:, 2:], np.tile([3.0, 1.6, -0.8], (at.sum(), 1)), atol=1e-7)


def test_slopes_at_vertices_are_exact_for_quadratics(mesh, stencils, control):
    displacement = control.quadratics[stencils.free] @ [1.5, -0.4, 0.8]
    inner = away_from(mesh.boundary, mesh, control)[control.vertices_outside]  # nothing beyond the rim in two rings
    at = two_rings_away(control.clamp, mesh, control) & inner
    assert at.sum() > 30
    x, y = mesh.material[control.vertices_outside[at]].T
    for row, wanted in enumerate((3.0 * x - 0.4 * y, -0.4 * x + 1.6 * y)):
        np.testing.assert_allclose((slope_matrix(stencils, row) @ displacement)[at], wanted, atol=1e-10)


def test_surface_interpolates_material_points_away_from_the_clamp(mesh, stencils, control):
    away = np.flatnonzero(away_from(control.clamp, mesh, control) & ~on_plate(mesh))
    np.testing.assert_allclose((stencils.surface @ stencils.control_material)[away], mesh.material[away], atol=1e-12)


def test_areas_are_those_of_the_cloth_outside_the_plate(mesh, stencils):
    outside = mesh.areas[~on_plate(mesh)[mesh.faces].all(1)].sum()
    assert stencils.edge_area.sum() == pytest.approx(outside, rel=1e-12)
    assert stencils.vertex_area.sum() == pytest.approx(outside, rel=1e-12)


def test_masses_are_those_of_the_cloth_outside_less_what_the_clamp_carries(mesh, stencils, control):
    mass = stencils.load @ lumped_area(mesh)
    at_clamp = mesh.areas[np.isin(mesh.faces, control.clamp).any(1) & ~on_plate(mesh)[mesh.faces].all(1)].sum()
    assert stencils.edge_area.sum() - at_clamp < mass.sum() < stencils.edge_area.sum()
    assert (mass > 0).all()


def test_potential_of_gravity_is_exact_for_its_midpoint_rule(mesh, stencils, control, edges):
    """Density and height at the midpoints, summed with the edges' areas; heavy only where the clamp has no part."""
    generator = np.random.default_rng(5)
    near = np.flatnonzero(~away_from(control.clamp, mesh, control) | on_plate(mesh))
    density = generator.uniform(1, 2, mesh.vertices) * away_from(near, mesh, control)
    assert (density > 0).sum() > 30
    height = stencils.control_material @ [0.3, -0.7]
    midpoints = stencils.edge_points @ [0.3, -0.7]
    wanted = (stencils.edge_area * density[edges.ends].mean(1) * midpoints).sum()
    size = (stencils.edge_area * density[edges.ends].mean(1) * np.abs(midpoints)).sum()
    assert stencils.load @ (density * lumped_area(mesh)) @ height == pytest.approx(wanted, abs=1e-12 * size)


def test_tables_entries_are_means(mesh, stencils, edges):
    for means in (stencils.bending_of_edge, stencils.stretch_of_edge, stencils.stretch_of_vertex):
        np.testing.assert_allclose(means.sum(1), 1)
        assert means.data.min() > 0
    inner = np.flatnonzero(np.diff(stencils.bending_of_edge.indptr) == 1)
    own = mesh.hinges[stencils.bending_of_edge[inner].indices]
    np.testing.assert_array_equal(np.sort(own[:, :2], axis=1), edges.ends[inner])
    assert len(edges.ends) - len(inner) == len(mesh.boundary)


def test_arrays_are_contiguous_and_padded_with_zeros(stencils):
    for name in ("edge", "vertex"):
        nodes, counts, weights = (getattr(stencils, f"{name}_{field}") for field in ("nodes", "counts", "weights"))
        padding = np.arange(nodes.shape[1]) >= counts[:, None]
        assert not nodes[padding].any()
        assert not weights.transpose(0, 2, 1)[padding].any()
        assert nodes.dtype == counts.dtype == np.int64
        assert weights.dtype == np.float64
        assert all(array.flags.c_contiguous for array in (nodes, counts, weights))


def test_stencils_near_a_conic_do_not_stiffen_the_membrane(stencils):
    """Without neighbours' neighbours there the largest norm is 20 and more on the jittered meshes."""
    norm = np.sqrt((stencils.vertex_weights**2).sum((1, 2)) * stencils.vertex_area)
    assert norm.max() < 4
