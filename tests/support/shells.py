"""Meshes, matrices and the exact deflection that the tests of the shell share."""

import numpy as np
import scipy.sparse as sparse
from numpy import ndarray
from scipy.sparse.linalg import spsolve

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS
from cusick_bench.sim.shell.stencils import ShellStencils, shell_stencils


def on_plate(mesh: Mesh) -> ndarray:
    """Vertices on the nominal plate or its edge."""
    return np.hypot(*mesh.material.T) < PLATE_RADIUS * (1 + 1e-7)


def stencils_of(mesh: Mesh) -> ShellStencils:
    """The shell's operators on the nominal plate."""
    return shell_stencils(mesh, on_plate(mesh), PLATE_RADIUS)


def jittered(mesh: Mesh, share: float, seed: int = 0) -> Mesh:
    """Vertices neither on the plate nor on the rim moved at random by up to a share of the mean edge."""
    edge = np.linalg.norm(np.diff(mesh.material[mesh.edges], axis=1), axis=2).mean()
    moved = ~on_plate(mesh)
    moved[mesh.boundary] = False
    offset = np.random.default_rng(seed).uniform(-share * edge, share * edge, (mesh.vertices, 2))
    return Mesh(mesh.material + moved[:, None] * offset, mesh.faces)


def row_matrix(nodes: ndarray, counts: ndarray, weights: ndarray, columns: int) -> sparse.csr_array:
    """One row of every padded stencil as a sparse matrix."""
    used = np.arange(nodes.shape[1]) < counts[:, None]
    starts = np.append(0, np.cumsum(counts))
    return sparse.csr_array((weights[used], nodes[used], starts), shape=(len(counts), columns))


def edge_matrices(stencils: ShellStencils) -> list[sparse.csr_array]:
    """The five derivatives at the midpoints of edges."""
    columns = len(stencils.free)
    return [
        row_matrix(stencils.edge_nodes, stencils.edge_counts, stencils.edge_weights[:, row], columns)
        for row in range(5)
    ]


def deflection(mesh: Mesh, poisson: float) -> ndarray:
    """Deflections of the mesh's vertices under unit load, clamped at the plate, with unit bending stiffness."""
    stencils = stencils_of(mesh)
    second = edge_matrices(stencils)[2:]
    area = sparse.diags_array(stencils.edge_area)
    plane = np.array([[1, poisson, 0], [poisson, 1, 0], [0, 0, (1 - poisson) / 2]])
    stiffness = sum(plane[i, j] * second[i].T @ area @ second[j] for i in range(3) for j in range(3))
    return stencils.surface @ spsolve(sparse.csc_array(stiffness), stencils.load @ lumped_area(mesh))


def lumped_area(mesh: Mesh) -> ndarray:
    """One third of the area of every vertex's faces [m2]: its mass at unit density."""
    return np.bincount(mesh.faces.ravel(), np.repeat(mesh.areas / 3, 3), mesh.vertices)


def relative_tip_deflection(mesh: Mesh, poisson: float) -> float:
    """Mean deflection of the rim over the exact one."""
    return float(deflection(mesh, poisson)[mesh.boundary].mean() / annulus_deflection(poisson))


def annulus_deflection(poisson: float, inner: float = PLATE_RADIUS, outer: float = CLOTH_RADIUS) -> float:
    """Deflection of the free rim of an annulus clamped at its inner edge, unit load and unit bending stiffness.

    w = A + B ln r + C r^2 + E r^2 ln r + r^4 / 64 (Timoshenko, Theory of Plates and Shells, Section 15) with w = w' = 0
    at the clamp, no moment and no shear at the rim.
    """
    log = np.log(outer)
    deflection = [1, log, outer**2, outer**2 * log]
    slope = [0, 1 / outer, 2 * outer, 2 * outer * log + outer]
    second = [0, -1 / outer**2, 2, 2 * log + 3]
    moment = [b + poisson * a / outer for a, b in zip(slope, second, strict=True)]
    rows = [
        [1, np.log(inner), inner**2, inner**2 * np.log(inner)],
        [0, 1 / inner, 2 * inner, 2 * inner * np.log(inner) + inner],
        moment,
        [0, 0, 0, 4 / outer],
    ]
    load = [inner**4 / 64, inner**3 / 16, (12 + 4 * poisson) * outer**2 / 64, outer / 2]
    return float(np.dot(deflection, np.linalg.solve(rows, -np.array(load))) + outer**4 / 64)
