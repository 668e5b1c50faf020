"""Nodal forces as a linear function of the stiffness tables, at a known shape.

At fixed positions both laws read their tables linearly, f(x; C, B) = sum_k theta_k f_k(x) with theta = (C, B) in one
row of 24 + 15 numbers: law `paper` blends them with weights that depend on strain and curvature alone, and so does
`published` where the blend is not cut off at zero, which entries >= 0 make sure of. So the forces of the 39 unit
tables hold those of every homogeneous cloth of this shape.
"""

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.triangles.system import DrapeSystem

STRETCH_TABLE, BENDING_TABLE = (6, 4), (3, 5)
STRETCH_NUMBERS, TABLE_NUMBERS = 24, 39


def tables_of(theta: Float[ndarray, " 39"]) -> tuple[Float[ndarray, "6 4"], Float[ndarray, "3 5"]]:
    """C [N/m] and B [N m] of one row of numbers.

    Args:
        theta: C row by row, then B row by row.

    Returns:
        C and B.
    """
    return theta[:STRETCH_NUMBERS].reshape(STRETCH_TABLE), theta[STRETCH_NUMBERS:].reshape(BENDING_TABLE)


def _parameters(system: DrapeSystem, theta: ndarray, rest_angle: ndarray) -> Parameters:
    """A cloth without weight."""
    stretch, bending = tables_of(theta)
    return Parameters(stretch[None], bending[None], np.zeros(system.mesh.vertices), rest_angle)


def unit_forces(
    system: DrapeSystem, x: Float[ndarray, "vertices 3"], rest_angle: Float[ndarray, " hinges"]
) -> Float[ndarray, "coordinates 39"]:
    """Elastic forces on the free vertices for a table entry of 1, one column an entry.

    Args:
        system: Cloth and support; its springs take no part.
        x: Positions [m].
        rest_angle: Stress-free dihedral angles [rad].

    Returns:
        Forces [N] per [N/m] in the columns of C, per [N m] in those of B.
    """
    columns = np.empty((3 * len(system.free), TABLE_NUMBERS))
    for entry in range(TABLE_NUMBERS):
        p = _parameters(system, np.eye(TABLE_NUMBERS)[entry], rest_angle).batch()
        columns[:, entry] = system.evaluate(x[None], x[None], p, exact=False).force()[0, system.free].ravel()
    return columns


def stiffness(
    system: DrapeSystem,
    x: Float[ndarray, "vertices 3"],
    theta: Float[ndarray, " 39"],
    rest_angle: Float[ndarray, " hinges"],
) -> sparse.csr_array:
    """Minus the derivative of the elastic forces on the free vertices to their positions [N/m].

    Args:
        system: Cloth and support. Law `paper` has the exact derivative, `published` its Gauss-Newton part.
        x: Positions [m].
        theta: C and B in one row.
        rest_angle: Stress-free dihedral angles [rad].

    Returns:
        Symmetric sparse matrix over the coordinates of the free vertices.
    """
    p = _parameters(system, theta, rest_angle).batch()
    state = system.evaluate(x[None], x[None], p, exact=system.law == "paper")
    blocks = state.matrix(diagonal=np.zeros((1, system.mesh.vertices)))[0]
    layout, rows = system.layout, len(system.free)
    row = np.repeat(np.arange(rows), np.diff(layout.indptr))
    keys = row * rows + layout.indices
    # The solver reads a triangle or more; every block is taken from the filled one of its two places.
    filled = np.zeros(len(keys), bool)
    filled[system.linear.needed_slots] = True
    mirror = np.searchsorted(keys, layout.indices * rows + row)
    whole = np.where(filled[:, None, None], blocks, blocks[mirror].transpose(0, 2, 1))
    return sparse.csr_array(sparse.bsr_array((whole, layout.indices, layout.indptr), shape=(3 * rows, 3 * rows)))
