"""A cloth's mesh in the directions of its warp and weft, where they are turned from the mesh's axes."""

import numpy as np

from cusick_bench.sim.cloth.mesh import Mesh

_TOLERANCE = 1e-9  # [m] by which the pattern may lie off the turned mesh


def along_grain(mesh: Mesh) -> Mesh:
    """The mesh in the coordinates of its pattern, where that is the whole cloth turned about the plate's axis.

    Args:
        mesh: The cloth.

    Returns:
        A mesh of the same faces without a pattern of its own; the given one where it has none, or is sewn of panels.
    """
    if mesh.pattern is None:
        return mesh
    u, v = mesh.material.T
    corners = np.zeros((mesh.vertices, 2))
    corners[mesh.faces] = mesh.pattern
    angle = np.arctan2((u * corners[:, 1] - v * corners[:, 0]).sum(), (u * corners[:, 0] + v * corners[:, 1]).sum())
    turned = np.column_stack([np.cos(angle) * u - np.sin(angle) * v, np.sin(angle) * u + np.cos(angle) * v])
    if np.abs(mesh.pattern - turned[mesh.faces]).max() > _TOLERANCE:
        return mesh
    return Mesh(turned, mesh.faces)
