"""Compiled kernels of the polar plate: strains, curvatures, forces and stiffness at the points of integration.

With x_a and x_ab the derivatives of position by material coordinates, n the unit normal and x^c the duals of x_a,

    E_ab = (x_a . x_b - d_ab) / 2,    k_ab = n . x_ab,    delta k_ab = n . (delta x_ab - (x^c . x_ab) delta x_c),

in the order 11, 22, 2 x 12. Energy per area 1/2 (E - E0)^T C (E - E0) + 1/2 (k - k0)^T D (k - k0). The stiffness is
that of Gauss and Newton, with the part of the membrane's tension that pulls.

References:
    Kiendl, Bletzinger, Linhard, Wüchner. Isogeometric shell analysis with Kirchhoff-Love elements. Computer Methods in
    Applied Mechanics and Engineering 198, 2009.
"""

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.kernel_cache import numba

_NODES = 16


@numba.njit(cache=True, inline="always")
def _cross(a: ndarray, b: ndarray, out: ndarray) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True, inline="always")
def _dot(a: ndarray, b: ndarray) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True)
def _frame(unknowns: ndarray, u: ndarray, slopes: ndarray, x: ndarray, n: ndarray) -> float:
    """Derivatives of position x (5, 3) and unit normal n of a point; returns current over material area."""
    x[:] = 0
    x[0, 0] = x[1, 1] = 1
    for k in range(_NODES):
        node = unknowns[k]
        if node >= 0:
            for derivative in range(5):
                for c in range(3):
                    x[derivative, c] += slopes[k, derivative] * u[node, c]
    _cross(x[0], x[1], n)
    area = np.sqrt(_dot(n, n))
    n /= area
    return area


@numba.njit(cache=True)
def strains(
    unknowns: Int[ndarray, "intervals 16"], u: Float[ndarray, "unknowns 3"],
    value: Float[ndarray, "intervals points 16"], slopes: Float[ndarray, "intervals points 16 5"],
    moved: Float[ndarray, "intervals points 3"],
    area: Float[ndarray, "intervals points 3"], strain: Float[ndarray, "intervals points 3"],
    curvature: Float[ndarray, "intervals points 3"],
) -> None:  # fmt: skip
    """Positions, strains and curvatures at the points.

    Args:
        unknowns: Numbers of the displacements of each interval.
        u: Displacements [m].
        value, slopes: Splines and their derivatives at the points.
        moved: Set to the displacements of the points [m].
        area: Set to normals as long as the current over the material area.
        strain: Set to E.
        curvature: Set to k [1/m].
    """
    x, n = np.empty((5, 3)), np.empty(3)
    for e in range(value.shape[0]):
        for p in range(value.shape[1]):
            stretched = _frame(unknowns[e], u, slopes[e, p], x, n)
            for c in range(3):
                area[e, p, c] = stretched * n[c]
                moved[e, p, c] = 0.0
                for k in range(_NODES):
                    if unknowns[e, k] >= 0:
                        moved[e, p, c] += value[e, p, k] * u[unknowns[e, k], c]
            strain[e, p, 0] = 0.5 * (_dot(x[0], x[0]) - 1)
            strain[e, p, 1] = 0.5 * (_dot(x[1], x[1]) - 1)
            strain[e, p, 2] = _dot(x[0], x[1])
            curvature[e, p, 0] = _dot(n, x[2])
            curvature[e, p, 1] = _dot(n, x[3])
            curvature[e, p, 2] = 2 * _dot(n, x[4])


@numba.njit(cache=True)
def spread(
    unknowns: Int[ndarray, "intervals 16"], value: Float[ndarray, "intervals points 16"],
    load: Float[ndarray, "intervals points 3"], force: Float[ndarray, "unknowns 3"],
) -> None:  # fmt: skip
    """Adds forces at points to the forces on the splines.

    Args:
        unknowns: Numbers of the displacements of each interval.
        value: Splines at the points.
        load: Forces at the points [N].
        force: Forces on the splines [N]; changed.
    """
    for e in range(value.shape[0]):
        for p in range(value.shape[1]):
            for k in range(_NODES):
                if unknowns[e, k] >= 0:
                    for c in range(3):
                        force[unknowns[e, k], c] += value[e, p, k] * load[e, p, c]


@numba.njit(cache=True)
def add_mass(
    unknowns: Int[ndarray, "intervals 16"], value: Float[ndarray, "intervals points 16"],
    mass: Float[ndarray, "intervals points"], band: Float[ndarray, "size width"],
) -> None:  # fmt: skip
    """Adds the mass matrix to a band matrix.

    Args:
        unknowns: Numbers of the displacements of each interval.
        value: Splines at the points.
        mass: Masses of the points [kg].
        band: The matrix [kg]; changed.
    """
    for e in range(value.shape[0]):
        for k in range(_NODES):
            for l in range(_NODES):
                row, column = unknowns[e, k], unknowns[e, l]
                if column >= 0 and row >= column:
                    total = 0.0
                    for p in range(value.shape[1]):
                        total += mass[e, p] * value[e, p, k] * value[e, p, l]
                    for c in range(3):
                        band[3 * column + c, 3 * (row - column)] += total


@numba.njit(cache=True)
def times(band: Float[ndarray, "size width"], x: Float[ndarray, "size"]) -> Float[ndarray, "size"]:
    """Product of a symmetric band matrix and a vector.

    Args:
        band: A[j + d, j] at [j, d].
        x: The vector.

    Returns:
        A x.
    """
    size, width = band.shape
    out = np.zeros(size)
    for j in range(size):
        out[j] += band[j, 0] * x[j]
        for d in range(1, min(width, size - j)):
            out[j + d] += band[j, d] * x[j]
            out[j] += band[j, d] * x[j + d]
    return out


@numba.njit(cache=True, inline="always")
def _symmetric(table: ndarray, a: ndarray, out: ndarray) -> None:
    """Product of a symmetric 3 x 3 table (11, 12, 13, 22, 23, 33) and a vector."""
    out[0] = table[0] * a[0] + table[1] * a[1] + table[2] * a[2]
    out[1] = table[1] * a[0] + table[3] * a[1] + table[4] * a[2]
    out[2] = table[2] * a[0] + table[4] * a[1] + table[5] * a[2]


@numba.njit(cache=True)
def _pull(s: ndarray, out: ndarray) -> None:
    """Part of a plane stress (11, 22, 12) that pulls: its positive eigenvalues."""
    middle, half = 0.5 * (s[0] + s[1]), 0.5 * (s[0] - s[1])
    radius = np.sqrt(half * half + s[2] * s[2])
    high, low = max(middle + radius, 0.0), max(middle - radius, 0.0)
    mean, apart = 0.5 * (high + low), 0.5 * (high - low)
    share = apart / radius if radius > 0 else 0.0
    out[0], out[1], out[2] = mean + share * half, mean - share * half, share * s[2]


@numba.njit(cache=True)
def elasticity(
    unknowns: Int[ndarray, "intervals 16"], u: Float[ndarray, "unknowns 3"],
    stretch_weight: Float[ndarray, "intervals points"], bending_weight: Float[ndarray, "intervals points"],
    slopes: Float[ndarray, "intervals points 16 5"], stretch: Float[ndarray, "intervals points 6"],
    rest_strain: Float[ndarray, "intervals points 3"], bending: Float[ndarray, "intervals points 6"],
    rest_curvature: Float[ndarray, "intervals points 3"], growth: float, bend: float, factor: float,
    force: Float[ndarray, "unknowns 3"], band: Float[ndarray, "size width"],
) -> float:  # fmt: skip
    """Adds elastic forces, and their stiffness times a factor; returns the energy.

    Bending stiffness changes with curvature by the factor f = 1 + growth (1 - exp(-|k - k0| / bend)).

    Args:
        unknowns: Numbers of the displacements of each interval.
        u: Displacements [m].
        stretch_weight, bending_weight: Areas for which the points stand in stretching and in bending [m2].
        slopes: Derivatives of the splines at the points.
        stretch: C as 11, 12, 13, 22, 23, 33 [N/m].
        rest_strain: E0.
        bending: D in the same order, at rest [N m].
        rest_curvature: k0 [1/m].
        growth: What D has more at high curvature, over D.
        bend: Curvature at which most of that is reached [1/m].
        factor: Factor of the stiffness; 0 leaves the matrix as it is.
        force: Forces on the splines [N]; changed.
        band: The matrix; changed.

    Returns:
        The energy [J], at stiffness as it is at this curvature.
    """
    x, n, dual = np.empty((5, 3)), np.empty(3), np.empty((2, 3))
    e_, k_, s, m, pull = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    d, turn = np.empty(6), np.empty((3, 2))
    bent, moment = np.empty((_NODES, 3)), np.empty((_NODES, 3))
    h11, h22, h12 = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    block = np.zeros((_NODES, _NODES, 3, 3))
    energy = 0.0
    for e in range(stretch_weight.shape[0]):
        block[:] = 0
        for p in range(stretch_weight.shape[1]):
            b, ws, wb = slopes[e, p], stretch_weight[e, p], bending_weight[e, p]
            _frame(unknowns[e], u, b, x, n)
            g11, g22, g12 = _dot(x[0], x[0]), _dot(x[1], x[1]), _dot(x[0], x[1])
            e_[0] = 0.5 * (g11 - 1) - rest_strain[e, p, 0]
            e_[1] = 0.5 * (g22 - 1) - rest_strain[e, p, 1]
            e_[2] = g12 - rest_strain[e, p, 2]
            c = stretch[e, p]
            _symmetric(c, e_, s)
            determinant = g11 * g22 - g12 * g12
            for i in range(3):
                dual[0, i] = (g22 * x[0, i] - g12 * x[1, i]) / determinant
                dual[1, i] = (g11 * x[1, i] - g12 * x[0, i]) / determinant
            for i in range(3):
                twice = 2.0 if i == 2 else 1.0
                k_[i] = twice * _dot(n, x[2 + i]) - rest_curvature[e, p, i]
                for a in range(2):
                    turn[i, a] = twice * _dot(dual[a], x[2 + i])
            size = np.sqrt(k_[0] ** 2 + k_[1] ** 2 + 0.5 * k_[2] ** 2)
            stiffer = 1 + growth * (1 - np.exp(-size / bend))
            for i in range(6):
                d[i] = stiffer * bending[e, p, i]
            _symmetric(d, k_, m)
            energy += 0.5 * (ws * _dot(s, e_) + wb * _dot(m, k_))
            s *= ws
            m *= wb
            d *= wb
            for k in range(_NODES):
                for i in range(3):
                    twice = 2.0 if i == 2 else 1.0
                    bent[k, i] = twice * b[k, 2 + i] - turn[i, 0] * b[k, 0] - turn[i, 1] * b[k, 1]
                node = unknowns[e, k]
                if node >= 0:
                    along_1, along_2 = s[0] * b[k, 0] + s[2] * b[k, 1], s[2] * b[k, 0] + s[1] * b[k, 1]
                    along_n = _dot(m, bent[k])
                    for i in range(3):
                        force[node, i] -= along_1 * x[0, i] + along_2 * x[1, i] + along_n * n[i]
            if factor == 0:
                continue
            ws *= factor
            _pull(s, pull)
            pull *= factor
            for k in range(_NODES):
                _symmetric(d, bent[k], moment[k])
                moment[k] *= factor
            for i in range(3):
                for j in range(3):
                    a, z = x[0, i] * x[0, j], x[1, i] * x[1, j]
                    az, za = x[0, i] * x[1, j], x[1, i] * x[0, j]
                    h11[i, j] = ws * (c[0] * a + c[2] * (az + za) + c[5] * z)
                    h22[i, j] = ws * (c[3] * z + c[4] * (az + za) + c[5] * a)
                    h12[i, j] = ws * (c[1] * az + c[2] * a + c[4] * z + c[5] * za)
            for k in range(_NODES):
                if unknowns[e, k] < 0:
                    continue
                b1, b2 = b[k, 0], b[k, 1]
                for l in range(_NODES):
                    if unknowns[e, l] < 0 or unknowns[e, k] < unknowns[e, l]:
                        continue
                    c1, c2 = b[l, 0], b[l, 1]
                    p11, p12, p21, p22 = b1 * c1, b1 * c2, b2 * c1, b2 * c2
                    across = _dot(bent[k], moment[l])
                    tension = pull[0] * p11 + pull[1] * p22 + pull[2] * (p12 + p21)
                    target = block[k, l]
                    for i in range(3):
                        for j in range(3):
                            target[i, j] += (
                                p11 * h11[i, j] + p22 * h22[i, j] + p12 * h12[i, j] + p21 * h12[j, i]
                                + across * n[i] * n[j]
                            )  # fmt: skip
                        target[i, i] += tension
        if factor != 0:
            _add_blocks(unknowns[e], block, band)
    return energy


@numba.njit(cache=True)
def _add_blocks(unknowns: ndarray, block: ndarray, band: ndarray) -> None:
    """Adds the lower half of an interval's matrix to the band."""
    for k in range(_NODES):
        row = unknowns[k]
        if row < 0:
            continue
        for l in range(_NODES):
            column = unknowns[l]
            if column < 0 or row < column:
                continue
            for i in range(3):
                for j in range(3):
                    below = 3 * (row - column) + i - j
                    if below >= 0:
                        band[3 * column + j, below] += block[k, l, i, j]
