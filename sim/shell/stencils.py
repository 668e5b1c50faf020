"""What law `plate` integrates over: derivatives of the displacement, areas, masses and tables' entries of one mesh.

Bending is summed over the midpoints of edges, each with one third of the area of its faces (exact for quadratics on a
triangle), the membrane over vertices. All rows are by the displacements of the free vertices' control points.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.shell.coefficients import OutsideEdges, area_means, bending_of_edge, outside_edges
from cusick_bench.sim.shell.control_mesh import ControlMesh, control_mesh
from cusick_bench.sim.shell.loop_rows import corrected, midpoint_rows
from cusick_bench.sim.shell.padded import Padded
from cusick_bench.sim.shell.rest_curvature import rest_curvature
from cusick_bench.sim.shell.vertex_rows import vertex_rows

_SIZE = 1.5  # of an edge's stencil, in square roots of its area; for scaling only


@dataclass(frozen=True, eq=False)
class ShellStencils:
    """The shell's discrete operators; the unknowns ("rows") are displacements of the free vertices' control points.

    Stencils index the unknowns and are padded with node 0 and weight 0. The edges are those of the faces outside the
    plate in ascending order of their ends, the rim and the clamp included; the vertices outside are the free ones and
    those on the clamp, ascending.

    Attributes:
        free: Mesh vertices that carry unknowns, ascending.
        control_material: Material coordinates of their control points [m].
        edge_nodes: Nodes of the stencils at the midpoints of edges.
        edge_counts: Their numbers.
        edge_weights: Rows u_,1 u_,2 [1/m] and u_,11 u_,22 2 u_,12 [1/m2] of the displacement u.
        edge_area: One third of the area of the edge's faces outside [m2].
        edge_points: Material coordinates of the midpoints [m].
        vertex_nodes: Nodes of the stencils at the vertices outside.
        vertex_counts: Their numbers.
        vertex_weights: Rows u_,1 u_,2 [1/m].
        vertex_area: One third of the area of the vertex's faces outside [m2].
        surface: Displacement of the mesh's vertices on the limit surface; shape (vertices, rows), zero where fixed.
        load: Masses of the control points by masses of the mesh's vertices; shape (rows, vertices).
        bending_of_edge: Mean over hinges for every edge; shape (edges, hinges).
        stretch_of_edge: Mean over faces for every edge; shape (edges, faces).
        stretch_of_vertex: Mean over faces for every vertex outside; shape (vertices_outside, faces).
        rest_curvature: Curvatures k11, k22, 2 k12 [1/m] at every edge by stress-free dihedral angles [rad]; shape
            (3 edges, hinges).
    """

    free: Int[ndarray, "rows"]
    control_material: Float[ndarray, "rows 2"]
    edge_nodes: Int[ndarray, "edges edge_width"]
    edge_counts: Int[ndarray, "edges"]
    edge_weights: Float[ndarray, "edges 5 edge_width"]
    edge_area: Float[ndarray, "edges"]
    edge_points: Float[ndarray, "edges 2"]
    vertex_nodes: Int[ndarray, "vertices_outside vertex_width"]
    vertex_counts: Int[ndarray, "vertices_outside"]
    vertex_weights: Float[ndarray, "vertices_outside 2 vertex_width"]
    vertex_area: Float[ndarray, "vertices_outside"]
    surface: sparse.csr_array
    load: sparse.csr_array
    bending_of_edge: sparse.csr_array
    stretch_of_edge: sparse.csr_array
    stretch_of_vertex: sparse.csr_array
    rest_curvature: sparse.csr_array


def shell_stencils(mesh: Mesh, fixed: Bool[ndarray, "vertices"], plate_radius: float) -> ShellStencils:
    """Builds the shell's operators on a mesh.

    Args:
        mesh: The cloth about the plate's axis, with a ring of vertices on the plate's edge.
        fixed: Vertices that lie on the plate or its edge.
        plate_radius: Radius of the plate [m].

    Returns:
        The operators.

    Raises:
        SimulationError: The mesh has seams, no free vertex, no ring of vertices on the plate's edge, or triangles there
            or at the rim from which no surface can be made.
    """
    control = control_mesh(mesh, fixed, plate_radius)
    edges = outside_edges(mesh, control.outside)
    value, rows, points = midpoint_rows(control, edges.ends)
    rows = corrected(control, rows, points, _SIZE * np.sqrt(edges.area)).extended(control.extension)
    at_vertices = _faces_of_vertices(control)
    vertex_area = at_vertices @ mesh.areas / 3
    slopes = vertex_rows(control, float(np.sqrt(vertex_area.mean()))).extended(control.extension)
    surface = control.limit @ control.extension
    return ShellStencils(
        free=control.free,
        control_material=np.ascontiguousarray(control.material[control.free]),
        edge_nodes=rows.nodes,
        edge_counts=rows.counts,
        edge_weights=rows.weights,
        edge_area=edges.area,
        edge_points=points,
        vertex_nodes=slopes.nodes,
        vertex_counts=slopes.counts,
        vertex_weights=slopes.weights,
        vertex_area=vertex_area,
        surface=sparse.csr_array(sparse.diags_array((~fixed).astype(float)) @ surface),
        load=_load(mesh, control, edges, value),
        bending_of_edge=bending_of_edge(edges),
        stretch_of_edge=area_means(edges.faces, mesh.areas),
        stretch_of_vertex=area_means(at_vertices, mesh.areas),
        rest_curvature=rest_curvature(mesh, edges),
    )


def _faces_of_vertices(control: ControlMesh) -> sparse.csr_array:
    """Faces outside at every vertex outside; ones in a matrix of shape (vertices_outside, faces)."""
    mesh = control.mesh
    corners = mesh.faces[control.outside].ravel()
    face = np.repeat(control.outside, 3)
    row = np.searchsorted(control.vertices_outside, corners)
    shape = (len(control.vertices_outside), len(mesh.faces))
    return sparse.csr_array((np.ones(len(row)), (row, face)), shape=shape)


def _load(mesh: Mesh, control: ControlMesh, edges: OutsideEdges, value: Padded) -> sparse.csr_array:
    """Masses of control points: density, the mean of the edge's ends, times area times the surface's weights."""
    edge = np.repeat(np.arange(len(edges.ends)), 2)
    vertex = edges.ends.ravel()
    mass = sparse.csr_array(
        (0.5 * edges.area[edge] / mesh.vertex_areas[vertex], (edge, vertex)), shape=(len(edges.ends), mesh.vertices)
    )
    return sparse.csr_array(value.extended(control.extension).matrix(len(control.free)).T @ mass)
