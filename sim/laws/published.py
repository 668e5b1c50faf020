"""Law `published`: the tables as the published program reads them, its quirks included.

C is read trilinearly from a 10 x 10 x 10 grid over the Green strain, whose nodes are rectified; B bilinearly over
curvature and direction, with sample 0 for all curvatures of one sign.

References:
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Section 3.3.1.
"""

import numpy as np

from cusick_bench.sim.laws.vectors import kernel

NUMERICS_VERSION = 1  # raised when this law's numbers change: see runner/numerics.py

_GRID = 10


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


@kernel()
def _cell(position):
    """Grid cell, fraction inside it and d fraction / d position, clamped to the grid."""
    if position <= 0.0:
        return 0, 0.0, 0.0
    if position >= _GRID - 1.0:
        return _GRID - 2, 1.0, 0.0
    low = min(int(position), _GRID - 2)
    return low, position - low, 1.0


@kernel()
def published_stretch(g00, g11, g01, table, k, dk, active):
    """k0..k3 = (c11, c12, c22, c33) at a Green strain, trilinear.

    Args:
        g00, g11, g01: Green strain [1].
        table: C of the face (6, 4) [N/m].
        k, dk: Receive k (4) and its gradient to (G00, G11, G01) (4, 3).
        active: Receives d k_m / d table[sample, m] (6, 4); the rectifier switches negative nodes off.
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


@kernel()
def published_bending(angle, scale, fraction, low_row, high_row):
    """Bending stiffness, its derivative to the angle, and where it was read.

    Args:
        angle: Dihedral angle less the rest angle [rad].
        scale: Curvature per angle [1/m].
        fraction: Weight of `high_row`.
        low_row, high_row: B of the directions beside the hinge's (5) [N m].

    Returns:
        B, dB/d(angle), three samples and their weights (all 0 where the rectifier acts).
    """
    position = -0.05 * angle * scale  # the program measures the angle with the opposite sign
    slope = -0.1 * scale if 0.0 < position < 2.0 else 0.0
    position = 2.0 * min(max(position, 0.0), 2.0)
    i = min(int(position), 3)
    f = position - i
    here = (1.0 - fraction) * low_row[i] + fraction * high_row[i]
    there = (1.0 - fraction) * low_row[i + 1] + fraction * high_row[i + 1]
    value = (1.0 - f) * here + f * there
    if value <= 0.0:
        return 0.0, 0.0, i, i + 1, i + 1, 0.0, 0.0, 0.0
    return value, (there - here) * slope, i, i + 1, i + 1, 1.0 - f, f, 0.0
