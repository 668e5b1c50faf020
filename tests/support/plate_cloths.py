"""Random cloths under law `plate` and configurations that reach every regime of its tables."""

import numpy as np
from cotton_tables import BENDING, STRETCH
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.plate.system import ShellSystem
from cusick_bench.sim.engine.plate.unknowns import ShellUnknowns
from cusick_bench.sim.engine.settings import DrapeSettings

VERTICES = 97

STATES = {
    "almost flat": (1.0, 1e-9, 1e-9),
    "gentle": (1.01, 1e-4, 1e-3),
    "compressed": (0.8, 5e-4, 5e-3),
    "beyond the tables": (1.5, 1e-3, 2e-2),
}
"""Stretch, in-plane noise [m], out-of-plane noise [m]."""


def plate_unknowns(seed: int = 1) -> ShellUnknowns:
    """A small shell, and the maps between its cloth and its control points."""
    unknowns = DrapeSimulator(disc_mesh(VERTICES, seed=seed), DrapeSettings(law="plate")).unknowns
    assert isinstance(unknowns, ShellUnknowns)
    return unknowns


def random_cloths(system: ShellSystem, members: int, *, elementwise: bool, seed: int = 3) -> Parameters:
    """Cloths by faces, hinges and vertices; half of the tables have a bias row too soft for a plate."""
    generator, mesh = np.random.default_rng(seed), system.mesh
    faces, hinges = (len(mesh.faces), len(mesh.hinges)) if elementwise else (1, 1)
    mass = np.bincount(mesh.faces.ravel(), np.repeat(0.19 * mesh.areas / 3, 3), mesh.vertices)
    soft = np.where(generator.random((members, hinges, 1)) < 0.5, 0.3, 2.0)
    bending = BENDING * np.exp(generator.normal(0, 0.1, (members, hinges, 3, 5)))
    bending[:, :, 1] *= soft
    return Parameters(
        STRETCH * np.exp(generator.normal(0, 0.1, (members, faces, 6, 4))), bending,
        mass * np.exp(generator.normal(0, 0.1, (members, mesh.vertices))),
        generator.normal(0, 0.02, (members, len(mesh.hinges))), generator.uniform(-0.3, 0.4, members),
    )  # fmt: skip


def random_state(system: ShellSystem, name: str, members: int = 1, seed: int = 5) -> ndarray:
    """Control points off the undeformed cloth on a plate that slopes (members, vertices, 3) [m]."""
    stretch, noise, height = STATES[name]
    generator, flat = np.random.default_rng(seed), system.mesh.flat.copy()
    flat[system.free, :2] = system.stencils.control_material
    x = np.repeat(flat[None], members, axis=0)
    x[:, system.free] *= [stretch, 1 + 0.5 * (stretch - 1), 1]
    x[:, system.free] += generator.normal(0, 1, (members, len(system.free), 3)) * [noise, noise, height]
    x[..., 2] += 0.02 * x[..., 0]
    return x


def taut_laid(system: ShellSystem, members: int, seed: int = 4) -> ndarray:
    """Cloths laid down uneven, flat on the plate, and 0.1 % taut (members, vertices, 3) [m].

    At zero strain max(G, 0) of the step's stiffness has a kink, where slopes differ.
    """
    height = np.random.default_rng(seed).normal(0, 1e-3, (members, system.mesh.vertices))
    height[:, system.fixed] = 0
    laid = np.repeat(system.mesh.flat[None], members, axis=0)
    laid[:, system.free] *= 1.001
    laid[..., 2] += height
    return laid


def dense_matrix(system: ShellSystem, blocks: ndarray) -> ndarray:
    """The symmetric matrix of which the linear solver reads the needed slots, by the free control points."""
    layout, rows = system.layout, len(system.free)
    row = np.repeat(np.arange(rows), np.diff(layout.indptr))
    matrix = np.zeros((rows, 3, rows, 3))
    for slot in system.linear.needed_slots:
        matrix[row[slot], :, layout.indices[slot]] = blocks[slot]
        matrix[layout.indices[slot], :, row[slot]] = blocks[slot].T
    return matrix.reshape(3 * rows, 3 * rows)
