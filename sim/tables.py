"""Where a strain or a curvature falls in the stiffness tables C (6 x 4) and B (3 x 5), for both material laws.

Stretch samples: 0 at rest; 1 to 5 at a largest principal stretch of 1 + 1/6, whose direction is 0, 22.5, 45, 67.5 and
90 degrees from the warp. Bending samples: curvature 0, 10, 20, 30 and 40 per metre.

`published` reads C trilinearly from a 10 x 10 x 10 grid over the Green strain, as the published program does.
`paper` blends the same samples smoothly: twice continuously differentiable weights, positive and summing to 1.

References:
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Section 3.3.1.
    Wang, O'Brien, Ramamoorthi. Data-driven elastic models for cloth. ACM Transactions on Graphics 30(4), 2011.
"""

import numba
import numpy as np

STRAIN_SAMPLE = ((1 + 1 / 6) ** 2 - 1) / 2  # Green strain at a stretch of 1 + 1/6
CURVATURE_STEP = 10.0  # [1/m] between bending samples
_GRID = 10

PUBLISHED = 0
PAPER = 1
"""Material laws, as the kernels know them."""


def _published_nodes() -> tuple[np.ndarray, np.ndarray]:
    """Samples (three a node) and their weights at every node (i, j, k) of the published strain grid."""
    i, j, k = np.meshgrid(*[np.arange(_GRID)] * 3, indexing="ij")
    a, b, c = 0.5 + 0.2 * i, 0.5 + 0.2 * j, 0.2 * k
    largest = (a + b + np.sqrt(4 * c**2 + (a - b) ** 2)) / 2
    strain = np.clip(6 * (np.sqrt(largest) - 1), 0, 1)
    angle = np.where(k == 0, np.where(i >= j, 0.0, 4.0), 8 * np.abs(np.arctan2(c, largest - b)) / np.pi)
    low = np.minimum(angle.astype(np.int64), 3)
    fraction = angle - low
    samples = np.stack([np.zeros_like(low), 1 + low, 2 + low], axis=-1)
    weights = np.stack([1 - strain, strain * (1 - fraction), strain * fraction], axis=-1)
    return samples.reshape(-1, 3), np.ascontiguousarray(weights.reshape(-1, 3))


NODE_SAMPLES, NODE_WEIGHTS = _published_nodes()


@numba.njit(cache=True, inline="always")
def _cell(position):
    """Grid cell, fraction inside it and d fraction / d position, clamped to the grid."""
    if position <= 0.0:
        return 0, 0.0, 0.0
    if position >= _GRID - 1.0:
        return _GRID - 2, 1.0, 0.0
    low = min(int(position), _GRID - 2)
    return low, position - low, 1.0


@numba.njit(cache=True)
def published_stretch(g00, g11, g01, table, k, dk, active):
    """k0..k3 = (c11, c12, c22, c33) at a Green strain, trilinear; dk to (G00, G11, G01).

    `active[sample, m]` receives d k_m / d table[sample, m] (the published rectifier switches negative nodes off).
    """
    i, fi, di = _cell(10.0 * (g00 + 0.25))
    j, fj, dj = _cell(10.0 * (g11 + 0.25))
    l, fl, dl = _cell(10.0 * abs(g01))
    sign = 1.0 if g01 >= 0.0 else -1.0
    k[:] = 0.0
    dk[:] = 0.0
    active[:] = 0.0
    for corner in range(8):
        ci, cj, cl = corner & 1, (corner >> 1) & 1, corner >> 2
        wi = fi if ci else 1.0 - fi
        wj = fj if cj else 1.0 - fj
        wl = fl if cl else 1.0 - fl
        node = ((i + ci) * _GRID + j + cj) * _GRID + l + cl
        for m in range(4):
            value = 0.0
            for q in range(3):
                value += 2.0 * NODE_WEIGHTS[node, q] * table[NODE_SAMPLES[node, q], m]
            if value > 0.0:
                weight = wi * wj * wl
                k[m] += weight * value
                dk[m, 0] += (1.0 if ci else -1.0) * 10.0 * di * wj * wl * value
                dk[m, 1] += (1.0 if cj else -1.0) * 10.0 * dj * wi * wl * value
                dk[m, 2] += (1.0 if cl else -1.0) * 10.0 * sign * dl * wi * wj * value
                for q in range(3):
                    active[NODE_SAMPLES[node, q], m] += 2.0 * weight * NODE_WEIGHTS[node, q]


# Strain invariants as quadratic forms in (G00, G11, G01): I, G00^2, 2 G01^2, G11^2. Hessians (diagonal, since no form
# has mixed terms).
_FORM_HESSIAN = np.array([[2.0, 2.0, 4.0], [2.0, 0.0, 0.0], [0.0, 0.0, 4.0], [0.0, 2.0, 0.0]])


@numba.njit(cache=True)
def _direction_shares(strain, invariant, share, d_share, d2_share):
    """p = (G00^2, 2 G01^2, G11^2) / I: how much of a strain is warp, bias and weft; with gradient and Hessian."""
    for p in range(3):
        value = 0.0
        for a in range(3):
            value += 0.5 * _FORM_HESSIAN[p + 1, a] * strain[a] * strain[a]
        share[p] = value / invariant
        for a in range(3):
            d_share[p, a] = (_FORM_HESSIAN[p + 1, a] - share[p] * _FORM_HESSIAN[0, a]) * strain[a] / invariant
    for p in range(3):
        for a in range(3):
            for b in range(3):
                term = (
                    -d_share[p, a] * _FORM_HESSIAN[0, b] * strain[b] - d_share[p, b] * _FORM_HESSIAN[0, a] * strain[a]
                )
                if a == b:
                    term += _FORM_HESSIAN[p + 1, a] - share[p] * _FORM_HESSIAN[0, a]
                d2_share[p, a, b] = term / invariant


# w_1..w_5 = the terms of (p0 + p45 + p90)^2: a Bernstein basis of degree 4 in cos^2 of a uniaxial strain's direction.
_PRODUCTS = np.array([[0, 0, 0], [1, 0, 1], [2, 1, 1], [2, 0, 2], [3, 1, 2], [4, 2, 2]])
_FACTORS = np.array([1.0, 2.0, 1.0, 2.0, 2.0, 1.0])


@numba.njit(cache=True)
def paper_stretch(g00, g11, g01, table, k, dk, d2k, weight, d_weight):
    """k0..k3 of the `paper` law at a Green strain, with gradient and Hessian in (G00, G11, G01).

    k = 2 [(1 - s) C_0 + s sum_j w_j C_j], s = 1 - (1 - q)^3 with q = min(I / STRAIN_SAMPLE^2, 1). The weights are
    positive and sum to 1, so every k is as admissible as the table; at rest k = 2 C_0, and a uniaxial strain along warp
    or weft of the sampled size gives 2 C_1 or 2 C_5.

    Args:
        g00, g11, g01: Green strain [1].
        table: C of the face (6, 4) [N/m].
        k, dk, d2k: Receive k (4), its gradient (4, 3) and its Hessian (4, 3, 3).
        weight, d_weight: Receive d k_m / d C[j, m] (6) and its gradient (6, 3), the same for every m.
    """
    weight[:] = 0.0
    d_weight[:] = 0.0
    dk[:] = 0.0
    d2k[:] = 0.0
    weight[0] = 2.0
    strain = (g00, g11, g01)
    invariant = g00 * g00 + g11 * g11 + 2.0 * g01 * g01
    q = invariant / STRAIN_SAMPLE**2
    if q > 1e-24:  # below, every share of samples 1..5 is lost in rounding
        share, d_share, d2_share = np.empty(3), np.empty((3, 3)), np.empty((3, 3, 3))
        _direction_shares(strain, invariant, share, d_share, d2_share)
        rest = max(1.0 - q, 0.0)
        s, s1, s2 = 1.0 - rest**3, 3.0 * rest**2, -6.0 * rest  # and derivatives in q
        dq = np.empty(3)
        for a in range(3):
            dq[a] = _FORM_HESSIAN[0, a] * strain[a] / STRAIN_SAMPLE**2
        weight[0] = 2.0 * (1.0 - s)
        for a in range(3):
            d_weight[0, a] = -2.0 * s1 * dq[a]
            for b in range(3):
                bend = s2 * dq[a] * dq[b] + (s1 * _FORM_HESSIAN[0, a] / STRAIN_SAMPLE**2 if a == b else 0.0)
                for m in range(4):
                    d2k[m, a, b] -= 2.0 * bend * table[0, m]
        for term in range(6):
            j, left, right = _PRODUCTS[term, 0] + 1, _PRODUCTS[term, 1], _PRODUCTS[term, 2]
            factor = 2.0 * _FACTORS[term]
            w = factor * share[left] * share[right]
            weight[j] += s * w
            for a in range(3):
                dw_a = factor * (d_share[left, a] * share[right] + share[left] * d_share[right, a])
                d_weight[j, a] += s1 * dq[a] * w + s * dw_a
                for b in range(3):
                    dw_b = factor * (d_share[left, b] * share[right] + share[left] * d_share[right, b])
                    d2w = factor * (
                        d2_share[left, a, b] * share[right]
                        + share[left] * d2_share[right, a, b]
                        + d_share[left, a] * d_share[right, b]
                        + d_share[left, b] * d_share[right, a]
                    )
                    bend = s2 * dq[a] * dq[b] + (s1 * _FORM_HESSIAN[0, a] / STRAIN_SAMPLE**2 if a == b else 0.0)
                    value = bend * w + s1 * (dq[a] * dw_b + dq[b] * dw_a) + s * d2w
                    for m in range(4):
                        d2k[m, a, b] += value * table[j, m]
    for m in range(4):
        k[m] = 0.0
        for j in range(6):
            k[m] += weight[j] * table[j, m]
            for a in range(3):
                dk[m, a] += d_weight[j, a] * table[j, m]


@numba.njit(cache=True)
def published_bending(angle, scale, low, fraction, table, active):
    """Bending stiffness and its derivative to the angle; bilinear, and sample 0 for any negative curvature.

    `active[d, i]` receives d B / d table[d, i].
    """
    position = -0.05 * angle * scale  # the program measures the angle with the opposite sign
    slope = -0.1 * scale if 0.0 < position < 2.0 else 0.0
    position = 2.0 * min(max(position, 0.0), 2.0)
    i = min(int(position), 3)
    f = position - i
    active[:] = 0.0
    active[low, i] = (1.0 - fraction) * (1.0 - f)
    active[low, i + 1] = (1.0 - fraction) * f
    active[low + 1, i] = fraction * (1.0 - f)
    active[low + 1, i + 1] = fraction * f
    value = 0.0
    for d in range(low, low + 2):
        value += active[d, i] * table[d, i] + active[d, i + 1] * table[d, i + 1]
    if value <= 0.0:
        active[:] = 0.0
        return 0.0, 0.0
    rise = (1.0 - fraction) * (table[low, i + 1] - table[low, i]) + fraction * (
        table[low + 1, i + 1] - table[low + 1, i]
    )
    return value, rise * slope


@numba.njit(cache=True)
def paper_bending(angle, scale, low, fraction, table, active):
    """Bending stiffness and its derivative to the angle: quadratic B-spline over |curvature|, even and positive.

    The spline is mirrored at zero curvature and constant beyond the last sample. `active[d, i]` receives
    d B / d table[d, i].
    """
    curvature = angle * scale
    position = abs(curvature) / CURVATURE_STEP
    slope = (1.0 if curvature >= 0.0 else -1.0) * scale / CURVATURE_STEP
    if position >= 4.5:
        position, slope = 4.5, 0.0
    i = min(int(position + 0.5), 4)
    f = position - i
    active[:] = 0.0
    value, rise = 0.0, 0.0
    for offset in range(-1, 2):
        if offset == 0:
            w, dw = 0.75 - f * f, -2.0 * f
        else:
            w, dw = 0.5 * (0.5 + offset * f) ** 2, offset * (0.5 + offset * f)
        sample = min(abs(i + offset), 4)
        for d in range(2):
            share = fraction if d else 1.0 - fraction
            active[low + d, sample] += share * w
            value += share * w * table[low + d, sample]
            rise += share * dw * table[low + d, sample]
    return value, rise * slope
