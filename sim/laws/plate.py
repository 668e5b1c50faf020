"""Law `plate`: bending of an orthotropic Kirchhoff-Love plate, from the same tables as law `paper`.

Energy per area psi = 1/2 kappa^T D kappa with kappa = (k11, k22, 2 k12) [1/m] (1 = warp) and

    D = [[D11, D12, 0], [D12, D22, 0], [0, 0, D33]]   [N m].

The table's rows hold the stiffness B of a cylinder by its curvature (10 k 1/m, k = 0..4), bent about the warp (row 0),
the bias (row 1) and the weft (row 2), as the moment per curvature; beside its samples B is read as law `paper` reads
it (a quadratic B-spline, constant beyond the last). So that a cylinder's moment is B(k) k whatever its curvature, D
holds the means

    Bm(q) = 2 / q^2 int_0^q B(t) t dt,   q^2 = k11^2 + k22^2 + 2 k12^2,

of the rows: D11 from row 2, D22 from row 0, D12 = nu sqrt(D11 D22) with Poisson's ratio nu of its own, and D33 from row
1, since 4 D(45 deg) = D11 + D22 + 2 D12 + 4 D33. A table whose bias row is too soft for a plate would give D33 <= 0;
below a tenth of sqrt(D11 D22) D33 is therefore bent smoothly, to a twentieth where it would be 0, and from there back
towards a tenth for still softer rows, which keeps D positive definite. So D33 is not monotonic in row 1.

All derivatives are by S = (q / 10 m^-1)^2, in which everything is smooth. Quantities of D come as (11, 22, 12, 33).

References:
    Timoshenko, Woinowsky-Krieger. Theory of Plates and Shells, 2nd edition, 1959, Sections 85 and 86 (orthotropy).
    Reddy. Mechanics of Laminated Composite Plates and Shells, 2nd edition, 2004, Section 2.4 (turning stiffness).
"""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.laws.tables import CURVATURE_STEP
from cusick_bench.sim.laws.vectors import kernel

NUMERICS_VERSION = 1  # raised when this law's numbers change: see runner/numerics.py

_LEAST = 0.05  # least D33 over sqrt(D11 D22)
_TINY = 1e-300
_PER_STEP2 = 1.0 / CURVATURE_STEP**2


@kernel()
def _primitives(i, f):
    """Integrals over f of (i + f) times the weights of samples i - 1, i and i + 1, with f the distance from i."""
    ff = f * f
    before = 0.5 * (0.25 * i * f + 0.5 * (0.25 - i) * ff + (i - 1.0) * ff * f / 3.0 + 0.25 * ff * ff)
    here = 0.75 * i * f + 0.375 * ff - i * ff * f / 3.0 - 0.25 * ff * ff
    after = 0.5 * (0.25 * i * f + 0.5 * (0.25 + i) * ff + (1.0 + i) * ff * f / 3.0 + 0.25 * ff * ff)
    return before, here, after


def _at_knots() -> np.ndarray:
    """Integral of t w_s(t) from 0 to the knots 0.5, 1.5 .. 4.5 for every sample s."""
    found = np.zeros((5, 5))
    for i in range(5):
        if i > 0:
            found[i] = found[i - 1]
        start = -0.5 if i > 0 else 0.0
        for sample, end, begin in zip(
            (abs(i - 1), i, min(i + 1, 4)), _primitives.py_func(i, 0.5), _primitives.py_func(i, start), strict=True
        ):
            found[i, sample] += end - begin
    return found


_KNOTS = _at_knots()


@kernel()
def curvature_shares(size2, out):
    """Weights of the five samples in the mean stiffness.

    Args:
        size2: S, the squared curvature in squares of 10 1/m.
        out: Receives weights and their first two derivatives by S (3, 5); each column of weights sums to 1.
    """
    out[:] = 0.0
    if size2 <= 0.25:
        out[0, 0], out[0, 1] = 0.75 - 0.5 * size2, 0.25 + 0.5 * size2
        out[1, 0], out[1, 1] = -0.5, 0.5
        return
    p = np.sqrt(size2)
    if p >= 4.5:
        for sample in range(5):
            out[0, sample] = _KNOTS[4, sample]
        out[0, 4] += 0.5 * (size2 - 20.25)
        for sample in range(5):
            weight = 1.0 if sample == 4 else 0.0
            out[0, sample] *= 2.0 / size2
            out[1, sample] = (weight - out[0, sample]) / size2
            out[2, sample] = -2.0 * out[1, sample] / size2
        return
    i = int(p + 0.5)
    f = p - i
    low = _primitives(i, -0.5)
    high = _primitives(i, f)
    for sample in range(5):
        out[0, sample] = _KNOTS[i - 1, sample]
    before, after = i - 1, min(i + 1, 4)
    out[0, before] += high[0] - low[0]
    out[0, i] += high[1] - low[1]
    out[0, after] += high[2] - low[2]
    # w and dw/dS go into rows 1 and 2 first
    out[1, before] += 0.5 * (0.5 - f) * (0.5 - f)
    out[1, i] += 0.75 - f * f
    out[1, after] += 0.5 * (0.5 + f) * (0.5 + f)
    half = 0.5 / p
    out[2, before] += (f - 0.5) * half
    out[2, i] -= 2.0 * f * half
    out[2, after] += (f + 0.5) * half
    for sample in range(5):
        out[0, sample] *= 2.0 / size2
        out[1, sample] = (out[1, sample] - out[0, sample]) / size2
        out[2, sample] = (out[2, sample] - 2.0 * out[1, sample]) / size2


@kernel()
def _read(row, shares):
    return (
        shares[0] * row[0] + shares[1] * row[1] + shares[2] * row[2] + shares[3] * row[3] + shares[4] * row[4]
    )  # fmt: skip


@kernel()
def _floor(t):
    """phi(t) = t from 2 on; below smooth, 1 at t = 0 and towards 2 again beyond; with its first two derivatives."""
    if t >= 2.0:
        return t, 1.0, 0.0
    y = 2.0 - t
    per = 1.0 / (4.0 + y * y)
    return 2.0 - 4.0 * y * per, 4.0 * (4.0 - y * y) * per * per, 8.0 * y * (12.0 - y * y) * per * per * per


@kernel()
def plate_stiffness(table, poisson, shares, out):
    """D at a squared curvature, and its first two derivatives by S.

    Args:
        table: B of the point (3, 5) [N m].
        poisson: nu.
        shares: From `curvature_shares` (3, 5).
        out: Receives D, dD/dS and d2D/dS2 (3, 4) [N m], as (11, 22, 12, 33).
    """
    for order in range(3):
        out[order, 0] = _read(table[2], shares[order])
        out[order, 1] = _read(table[0], shares[order])
        out[order, 3] = _read(table[1], shares[order])
    a, b = out[0, 0], out[0, 1]
    mean = np.sqrt(max(a * b, _TINY))
    rise = 0.5 * (out[1, 0] * b + a * out[1, 1]) / mean
    bend = (0.5 * (out[2, 0] * b + 2.0 * out[1, 0] * out[1, 1] + a * out[2, 1]) - rise * rise) / mean
    out[0, 2], out[1, 2], out[2, 2] = poisson * mean, poisson * rise, poisson * bend
    x = out[0, 3] - 0.25 * (a + b) - 0.5 * out[0, 2]
    x1 = out[1, 3] - 0.25 * (out[1, 0] + out[1, 1]) - 0.5 * out[1, 2]
    x2 = out[2, 3] - 0.25 * (out[2, 0] + out[2, 1]) - 0.5 * out[2, 2]
    m, m1, m2 = _LEAST * mean, _LEAST * rise, _LEAST * bend
    t = x / m
    phi, slope, curve = _floor(t)
    turn = x1 - t * m1
    out[0, 3] = m * phi
    out[1, 3] = m1 * phi + slope * turn
    out[2, 3] = m2 * (phi - t * slope) + slope * x2 + curve * turn * turn / m


@kernel()
def squared_curvature(k):
    """S of curvatures (k11, k22, 2 k12) [1/m]."""
    return (k[0] * k[0] + k[1] * k[1] + 0.5 * k[2] * k[2]) * _PER_STEP2


@kernel()
def _form(d, k, z):
    """k^T D z."""
    return d[0] * k[0] * z[0] + d[1] * k[1] * z[1] + d[2] * (k[0] * z[1] + k[1] * z[0]) + d[3] * k[2] * z[2]


@kernel()
def _times(d, k):
    """D k."""
    return d[0] * k[0] + d[2] * k[1], d[2] * k[0] + d[1] * k[1], d[3] * k[2]


@kernel()
def _rise(k):
    """dS/d kappa."""
    return 2.0 * _PER_STEP2 * k[0], 2.0 * _PER_STEP2 * k[1], _PER_STEP2 * k[2]


@kernel()
def plate_bending(k, stiffness):
    """Energy and moments.

    Args:
        k: Curvatures less those at rest (k11, k22, 2 k12) [1/m].
        stiffness: From `plate_stiffness` at their S.

    Returns:
        psi [J/m2], and its gradient, the moments [N].
    """
    by_size = 0.5 * _form(stiffness[1], k, k)
    rise, moment = _rise(k), _times(stiffness[0], k)
    return 0.5 * _form(stiffness[0], k, k), (
        moment[0] + by_size * rise[0], moment[1] + by_size * rise[1], moment[2] + by_size * rise[2],
    )  # fmt: skip


@kernel()
def plate_tangent(k, stiffness, exact):
    """Hessian of the energy in the curvatures, or D alone, which is positive definite.

    Args:
        k: Curvatures less those at rest [1/m].
        stiffness: From `plate_stiffness`.
        exact: The Hessian.

    Returns:
        Entries 00, 11, 22, 01, 02, 12 [N m].
    """
    d = stiffness[0]
    if not exact:
        return d[0], d[1], d[3], d[2], 0.0, 0.0
    by_size, by_both = 0.5 * _form(stiffness[1], k, k), 0.5 * _form(stiffness[2], k, k)
    r, t = _rise(k), _times(stiffness[1], k)
    curve = 2.0 * _PER_STEP2 * by_size
    return (
        d[0] + 2.0 * t[0] * r[0] + curve + by_both * r[0] * r[0],
        d[1] + 2.0 * t[1] * r[1] + curve + by_both * r[1] * r[1],
        d[3] + 2.0 * t[2] * r[2] + 0.5 * curve + by_both * r[2] * r[2],
        d[2] + t[0] * r[1] + t[1] * r[0] + by_both * r[0] * r[1],
        t[0] * r[2] + t[2] * r[0] + by_both * r[0] * r[2],
        t[1] * r[2] + t[2] * r[1] + by_both * r[1] * r[2],
    )


@kernel()
def plate_secant_slope(k, along, across, stiffness):
    """Derivative of along^T D across by the curvatures, D at their S."""
    change, rise = _form(stiffness[1], along, across), _rise(k)
    return change * rise[0], change * rise[1], change * rise[2]


@kernel()
def plate_table_adjoint(k, along, across, force, secant, table, poisson, shares, stiffness, scale, g_table):
    """Adds scale times the derivatives of force * along . moments + secant * along^T D across to the table's.

    Args:
        k: Curvatures less those at rest [1/m].
        along, across: Vectors in the space of curvatures.
        force, secant: Factors.
        table, poisson, shares: As in `plate_stiffness`.
        stiffness: What that returned.
        scale: Factor.
        g_table: Adds up (3, 5).

    Returns:
        scale times the derivative to nu.
    """
    rise = _rise(k)
    size = 0.5 * force * (along[0] * rise[0] + along[1] * rise[1] + along[2] * rise[2])
    z = (force * k[0] + secant * across[0], force * k[1] + secant * across[1], force * k[2] + secant * across[2])
    # derivatives to D and dD/dS
    p11, p22, p33 = along[0] * z[0], along[1] * z[1], along[2] * z[2]
    p12 = along[0] * z[1] + along[1] * z[0]
    r11, r22, r12, r33 = size * k[0] * k[0], size * k[1] * k[1], 2.0 * size * k[0] * k[1], size * k[2] * k[2]
    a, b, a1, b1 = stiffness[0, 0], stiffness[0, 1], stiffness[1, 0], stiffness[1, 1]
    mean = np.sqrt(max(a * b, _TINY))
    mean1 = 0.5 * (a1 * b + a * b1) / mean
    x = _read(table[1], shares[0]) - 0.25 * (a + b) - 0.5 * stiffness[0, 2]
    x1 = _read(table[1], shares[1]) - 0.25 * (a1 + b1) - 0.5 * stiffness[1, 2]
    m, m1 = _LEAST * mean, _LEAST * mean1
    t = x / m
    phi, slope, curve = _floor(t)
    turn = curve * (x1 - t * m1) / m
    g_x, g_x1 = p33 * slope + r33 * turn, r33 * slope
    g_m, g_m1 = p33 * (phi - t * slope) - r33 * turn * t, r33 * (phi - t * slope)
    g_mean = poisson * (p12 - 0.5 * g_x) + _LEAST * g_m
    g_mean1 = poisson * (r12 - 0.5 * g_x1) + _LEAST * g_m1
    half = 0.5 / mean
    g_a = p11 - 0.25 * g_x + g_mean * half * b + g_mean1 * half * (b1 - mean1 * b / mean)
    g_b = p22 - 0.25 * g_x + g_mean * half * a + g_mean1 * half * (a1 - mean1 * a / mean)
    g_a1, g_b1 = r11 - 0.25 * g_x1 + g_mean1 * half * b, r22 - 0.25 * g_x1 + g_mean1 * half * a
    for sample in range(5):
        w, w1 = scale * shares[0, sample], scale * shares[1, sample]
        g_table[2, sample] += w * g_a + w1 * g_a1
        g_table[0, sample] += w * g_b + w1 * g_b1
        g_table[1, sample] += w * g_x + w1 * g_x1
    return scale * (mean * (p12 - 0.5 * g_x) + mean1 * (r12 - 0.5 * g_x1))


def bias_stiffness(
    warp: Float[ndarray, "*tables"], weft: Float[ndarray, "*tables"], bias: Float[ndarray, "*tables"], poisson: float
) -> Float[ndarray, "*tables"]:
    """Stiffness at 45 degrees, D11 / 4 + D22 / 4 + D12 / 2 + D33, of the plate that this law makes of a table.

    Args:
        warp: Entries of row 2, D11 [N m].
        weft: Entries of row 0, D22 [N m].
        bias: Entries of row 1 at the same curvature [N m].
        poisson: nu.

    Returns:
        The entries of row 1 again, but for those too soft for a plate [N m].
    """
    mean = np.sqrt(warp * weft)
    without_twist = 0.25 * (warp + weft) + 0.5 * poisson * mean
    t = (bias - without_twist) / (_LEAST * mean)
    y = np.maximum(2.0 - t, 0.0)
    return without_twist + _LEAST * mean * (np.maximum(t, 2.0) - 4.0 * y / (4.0 + y * y))
