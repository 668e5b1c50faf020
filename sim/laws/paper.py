"""Law `paper`: the tables blended smoothly, so that forces and Hessian derive from an energy.

Stretch: k = sum_j W_j(G) C_j, with I = G00^2 + 2 G01^2 + G11^2, q = min(I / E^2, 1), s = 1 - (1 - q)^3, E the Green
strain of the samples: W_0 = 2 (1 - s), and W_1..W_5 = 2 s / I^2 times the terms of (a + b + c)^2 sorted by direction,
a = G00^2, b = 2 G01^2, c = G11^2. Twice continuously differentiable, positive, summing to 2 (the published law doubles
its table as well): a Bernstein basis of degree 4 in cos^2 of a uniaxial strain's direction. With scalars V_j (a column
of C, or C times a vector), f = sum_j W_j V_j is written in (a, b, c), where

    f = 2 (1 - s) V_0 + 2 h P,   h = s / I^2,   P = a^2 V_1 + 2 a b V_2 + (b^2 + 2 a c) V_3 + 2 b c V_4 + c^2 V_5.

Bending: quadratic B-spline over |curvature|, mirrored at zero and constant beyond the last sample.
"""

from cusick_bench.sim.laws.tables import CURVATURE_STEP, STRAIN_SAMPLE
from cusick_bench.sim.laws.vectors import kernel

NUMERICS_VERSION = 1  # raised when this law's numbers change: see runner/numerics.py

_E2 = STRAIN_SAMPLE**2
_TINY = 1e-24  # q below which the shares of samples 1..5 vanish in rounding


@kernel()
def shares(a, b, c):
    """s, ds/dI, d2s/dI2 and h = s / I^2 with its two derivatives."""
    invariant = a + b + c
    q = invariant / _E2
    if q < _TINY:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if q < 1.0:
        rest, per = 1.0 - q, 1.0 / q
        s = q * (3.0 - 3.0 * q + q * q)
        h = (3.0 * per - 3.0 + q) / (_E2 * _E2)
        h1 = (1.0 - 3.0 * per * per) / (_E2 * _E2 * _E2)
        h2 = 6.0 * per * per * per / (_E2 * _E2 * _E2 * _E2)
        return s, 3.0 * rest * rest / _E2, -6.0 * rest / (_E2 * _E2), h, h1, h2
    per = 1.0 / invariant
    return 1.0, 0.0, 0.0, per * per, -2.0 * per * per * per, 6.0 * per * per * per * per


@kernel()
def weights(a, b, c, s, h):
    """W_0 .. W_5."""
    return 2.0 * (1.0 - s), 2 * h * a * a, 4 * h * a * b, 2 * h * (b * b + 2 * a * c), 4 * h * b * c, 2 * h * c * c


@kernel()
def weight_changes(a, b, c, da, db, dc, s1, h, h1):
    """Directional derivative of W_0 .. W_5 where (a, b, c) changes by (da, db, dc)."""
    change = da + db + dc
    rise = 2.0 * h1 * change
    return (
        -2.0 * s1 * change,
        rise * a * a + 4 * h * a * da,
        2 * rise * a * b + 4 * h * (a * db + b * da),
        rise * (b * b + 2 * a * c) + 4 * h * (b * db + a * dc + c * da),
        2 * rise * b * c + 4 * h * (b * dc + c * db),
        rise * c * c + 4 * h * c * dc,
    )


@kernel()
def mixed(table, v):
    """Sum over j of v_j times row j of C: four numbers."""
    return (
        v[0] * table[0, 0] + v[1] * table[1, 0] + v[2] * table[2, 0] + v[3] * table[3, 0] + v[4] * table[4, 0]
        + v[5] * table[5, 0],
        v[0] * table[0, 1] + v[1] * table[1, 1] + v[2] * table[2, 1] + v[3] * table[3, 1] + v[4] * table[4, 1]
        + v[5] * table[5, 1],
        v[0] * table[0, 2] + v[1] * table[1, 2] + v[2] * table[2, 2] + v[3] * table[3, 2] + v[4] * table[4, 2]
        + v[5] * table[5, 2],
        v[0] * table[0, 3] + v[1] * table[1, 3] + v[2] * table[2, 3] + v[3] * table[3, 3] + v[4] * table[4, 3]
        + v[5] * table[5, 3],
    )  # fmt: skip


@kernel()
def _along(row, t):
    return row[0] * t[0] + row[1] * t[1] + row[2] * t[2] + row[3] * t[3]


@kernel()
def contracted(table, t):
    """C times a vector of four: V_0 .. V_5."""
    return (
        _along(table[0], t), _along(table[1], t), _along(table[2], t),
        _along(table[3], t), _along(table[4], t), _along(table[5], t),
    )  # fmt: skip


@kernel()
def slopes(v, a, b, c, s1, h, h1):
    """df/da, df/db, df/dc at fixed V."""
    value = a * a * v[1] + 2 * a * b * v[2] + (b * b + 2 * a * c) * v[3] + 2 * b * c * v[4] + c * c * v[5]
    common = 2.0 * (h1 * value - s1 * v[0])
    return (
        common + 4.0 * h * (a * v[1] + b * v[2] + c * v[3]),
        common + 4.0 * h * (a * v[2] + b * v[3] + c * v[4]),
        common + 4.0 * h * (a * v[3] + b * v[4] + c * v[5]),
    )


@kernel()
def curvatures(v, a, b, c, s2, h, h1, h2):
    """Second derivatives of f at fixed V: aa, bb, cc, ab, ac, bc."""
    value = a * a * v[1] + 2 * a * b * v[2] + (b * b + 2 * a * c) * v[3] + 2 * b * c * v[4] + c * c * v[5]
    by_a = 4.0 * h1 * (a * v[1] + b * v[2] + c * v[3])
    by_b = 4.0 * h1 * (a * v[2] + b * v[3] + c * v[4])
    by_c = 4.0 * h1 * (a * v[3] + b * v[4] + c * v[5])
    common = 2.0 * (h2 * value - s2 * v[0])
    return (
        common + 2 * by_a + 4 * h * v[1],
        common + 2 * by_b + 4 * h * v[3],
        common + 2 * by_c + 4 * h * v[5],
        common + by_a + by_b + 4 * h * v[2],
        common + by_a + by_c + 4 * h * v[3],
        common + by_b + by_c + 4 * h * v[4],
    )


@kernel()
def paper_stress(g00, g11, g01, table):
    """Energy density psi = k0 G00^2 / 2 + k1 G00 G11 + k2 G11^2 / 2 + k3 G01^2 and its gradient.

    Args:
        g00, g11, g01: Green strain [1].
        table: C of the face (6, 4) [N/m].

    Returns:
        psi [N/m], (k0, k1, k2, k3) [N/m] and d psi / d (G00, G11, G01) [N/m].
    """
    a, b, c = g00 * g00, 2.0 * g01 * g01, g11 * g11
    s, s1, _, h, h1, _ = shares(a, b, c)
    k = mixed(table, weights(a, b, c, s, h))
    phi = (0.5 * a, g00 * g11, 0.5 * c, 0.5 * b)
    fa, fb, fc = slopes(contracted(table, phi), a, b, c, s1, h, h1)
    psi = k[0] * phi[0] + k[1] * phi[1] + k[2] * phi[2] + k[3] * phi[3]
    stress = (
        (k[0] + 2.0 * fa) * g00 + k[1] * g11,
        (k[2] + 2.0 * fc) * g11 + k[1] * g00,
        (2.0 * k[3] + 4.0 * fb) * g01,
    )
    return psi, k, stress


@kernel()
def paper_tangent(g00, g11, g01, table, k):
    """Hessian of psi in (G00, G11, G01): 00, 11, 22, 01, 02, 12."""
    a, b, c = g00 * g00, 2.0 * g01 * g01, g11 * g11
    _, s1, s2, h, h1, h2 = shares(a, b, c)
    v = contracted(table, (0.5 * a, g00 * g11, 0.5 * c, 0.5 * b))
    fa, fb, fc = slopes(v, a, b, c, s1, h, h1)
    faa, fbb, fcc, fab, fac, fbc = curvatures(v, a, b, c, s2, h, h1, h2)
    # d k_m / d (G00, G11, G01): a rises by 2 G00, c by 2 G11, b by 4 G01
    by0 = mixed(table, weight_changes(a, b, c, 2.0 * g00, 0.0, 0.0, s1, h, h1))
    by1 = mixed(table, weight_changes(a, b, c, 0.0, 0.0, 2.0 * g11, s1, h, h1))
    by2 = mixed(table, weight_changes(a, b, c, 0.0, 4.0 * g01, 0.0, s1, h, h1))
    t00 = 4.0 * faa * a + 2.0 * fa + 2.0 * (by0[0] * g00 + by0[1] * g11) + k[0]
    t11 = 4.0 * fcc * c + 2.0 * fc + 2.0 * (by1[2] * g11 + by1[1] * g00) + k[2]
    t22 = 8.0 * fbb * b + 4.0 * fb + 4.0 * by2[3] * g01 + 2.0 * k[3]
    t01 = 4.0 * fac * g00 * g11 + by0[1] * g00 + by0[2] * g11 + by1[0] * g00 + by1[1] * g11 + k[1]
    t02 = 8.0 * fab * g00 * g01 + 2.0 * by0[3] * g01 + by2[0] * g00 + by2[1] * g11
    t12 = 8.0 * fbc * g11 * g01 + 2.0 * by1[3] * g01 + by2[2] * g11 + by2[1] * g00
    return t00, t11, t22, t01, t02, t12


@kernel()
def paper_bending(angle, scale, fraction, low_row, high_row):
    """Bending stiffness, its derivative to the angle, and where it was read.

    Args:
        angle: Dihedral angle less the rest angle [rad].
        scale: Curvature per angle [1/m].
        fraction: Weight of `high_row`.
        low_row, high_row: B of the directions beside the hinge's (5) [N m].

    Returns:
        B, dB/d(angle), three samples and their weights.
    """
    curvature = angle * scale
    position = abs(curvature) / CURVATURE_STEP
    slope = (1.0 if curvature >= 0.0 else -1.0) * scale / CURVATURE_STEP
    if position >= 4.5:
        position, slope = 4.5, 0.0
    i = min(int(position + 0.5), 4)
    f = position - i
    before, after = abs(i - 1), min(i + 1, 4)
    w0, w1, w2 = 0.5 * (0.5 - f) * (0.5 - f), 0.75 - f * f, 0.5 * (0.5 + f) * (0.5 + f)
    b0 = (1.0 - fraction) * low_row[before] + fraction * high_row[before]
    b1 = (1.0 - fraction) * low_row[i] + fraction * high_row[i]
    b2 = (1.0 - fraction) * low_row[after] + fraction * high_row[after]
    rise = (f - 0.5) * b0 - 2.0 * f * b1 + (f + 0.5) * b2
    return w0 * b0 + w1 * b1 + w2 * b2, rise * slope, before, i, after, w0, w1, w2
