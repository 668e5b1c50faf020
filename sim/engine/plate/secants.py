"""Plates of constant stiffness that have the moments of law `plate` at given curvatures.

B(q), the stiffness of a cylinder of the curvature q, is read from every row of the table. The plate with these
constants has the moments D_s (kappa - rest) = M for a rest of its own; where the law is linear, or the cloth a cylinder
along warp or weft, that rest is the elastic one.
"""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.laws.plate import curvature_shares, plate_bending, plate_stiffness, squared_curvature
from cusick_bench.sim.laws.vectors import kernel


@kernel()
def _secants(curvature, rest, bending, poisson, tables, eased):
    parts, d = np.empty((3, 5)), np.empty((3, 4))
    for p in range(len(curvature)):
        own = bending[p if len(bending) > 1 else 0]
        k = (
            curvature[p, 0] - rest[p, 0], curvature[p, 1] - rest[p, 1], curvature[p, 2] - rest[p, 2],
        )  # fmt: skip
        size2 = squared_curvature(k)
        curvature_shares(size2, parts)
        plate_stiffness(own, poisson, parts, d)
        _, moment = plate_bending(k, d)
        for row in range(3):
            stiffness = 0.0
            for sample in range(5):  # B = d(S Bm) / dS
                stiffness += (parts[0, sample] + size2 * parts[1, sample]) * own[row, sample]
            tables[p, row] = stiffness
        plate_stiffness(tables[p], poisson, parts, d)
        d11, d22, d12, d33 = d[0, 0], d[0, 1], d[0, 2], d[0, 3]
        per = 1.0 / (d11 * d22 - d12 * d12)
        eased[p, 0] = curvature[p, 0] - per * (d22 * moment[0] - d12 * moment[1])
        eased[p, 1] = curvature[p, 1] - per * (d11 * moment[1] - d12 * moment[0])
        eased[p, 2] = curvature[p, 2] - moment[2] / d33


def secant_plates(
    curvature: Float[ndarray, "edges 3"],
    rest: Float[ndarray, "edges 3"],
    bending: Float[ndarray, "tables 3 5"],
    poisson: float,
) -> tuple[Float[ndarray, "edges 3 5"], Float[ndarray, "edges 3"]]:
    """Plates of constant stiffness with the moments of one cloth.

    Args:
        curvature: (k11, k22, 2 k12) at the edge points [1/m].
        rest: Those at rest [1/m].
        bending: B, one table or one of every edge point [N m].
        poisson: nu.

    Returns:
        Their tables [N m], equal in all columns, and curvatures at rest [1/m].
    """
    tables, eased = np.empty((len(curvature), 3, 5)), np.empty_like(curvature)
    _secants(curvature, rest, bending, poisson, tables, eased)
    return tables, eased
