"""Compiled hinge kernels: bending forces, stiffness blocks and their adjoint, for both material laws.

Per hinge: dihedral angle theta, positive where the cloth is convex seen from its face; with t = theta - rest angle the
moment is M = weight B(t scale) t, the force f = -M grad theta. Under `published` the weight is a quarter of the one
that gives a plate the tabulated bending stiffness. Gauss-Newton stiffness: (M / t) grad theta grad theta^T; exact:
M' grad theta grad theta^T + M Hess theta. The adjoint is that of `face_kernels`.

References:
    Tamstorf, Grinspun. Discrete bending forces and their Jacobians. Graphical Models 75(6), 2013.
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Eq. 5.
"""

import math

import numba
import numpy as np

from cusick_bench.sim.tables import CURVATURE_STEP, PUBLISHED, paper_bending, published_bending
from cusick_bench.sim.vectors import CHUNKS, cross, difference, dot


@numba.njit(cache=True)
def _hinge_angle(corners, x, e, p, r, n0, n1, g):
    """Dihedral angle and its gradient g (4, 3); also edge e, opposite legs p, r and (unnormalised) face normals."""
    difference(x, corners[1], corners[0], e)
    difference(x, corners[2], corners[0], p)
    difference(x, corners[3], corners[0], r)
    cross(e, p, n0)
    cross(r, e, n1)
    length2 = dot(e, e)
    length = math.sqrt(length2)
    normal0, normal1 = dot(n0, n0), dot(n1, n1)
    # e . (n0 x n1) / |e| = -|e| (p . n1) in this orientation: positive where both opposite corners lie below
    angle = math.atan2(-length * dot(p, n1), dot(n0, n1))
    t0, t1 = dot(p, e) / length2, dot(r, e) / length2
    for axis in range(3):
        a, b = -length * n0[axis] / normal0, -length * n1[axis] / normal1
        g[2, axis] = a
        g[3, axis] = b
        g[1, axis] = -(t0 * a + t1 * b)
        g[0, axis] = -((1.0 - t0) * a + (1.0 - t1) * b)
    return angle


@numba.njit(cache=True)
def _hinge_hessian_product(e, p, r, n0, n1, g, de, dp, dr, out):
    """Derivative of the angle gradient when edge and legs change by de, dp, dr: out (4, 3) = Hess(theta) d."""
    length2 = dot(e, e)
    length = math.sqrt(length2)
    d_length = dot(e, de) / length
    normal0, normal1 = dot(n0, n0), dot(n1, n1)
    t0, t1 = dot(p, e) / length2, dot(r, e) / length2
    dt0 = (dot(dp, e) + dot(p, de) - 2.0 * t0 * dot(e, de)) / length2
    dt1 = (dot(dr, e) + dot(r, de) - 2.0 * t1 * dot(e, de)) / length2
    # d n0 = de x p + e x dp, d n1 = dr x e + r x de
    m0 = (
        de[1] * p[2] - de[2] * p[1] + e[1] * dp[2] - e[2] * dp[1],
        de[2] * p[0] - de[0] * p[2] + e[2] * dp[0] - e[0] * dp[2],
        de[0] * p[1] - de[1] * p[0] + e[0] * dp[1] - e[1] * dp[0],
    )
    m1 = (
        dr[1] * e[2] - dr[2] * e[1] + r[1] * de[2] - r[2] * de[1],
        dr[2] * e[0] - dr[0] * e[2] + r[2] * de[0] - r[0] * de[2],
        dr[0] * e[1] - dr[1] * e[0] + r[0] * de[1] - r[1] * de[0],
    )
    turn0, turn1 = 2.0 * dot(n0, m0) / normal0, 2.0 * dot(n1, m1) / normal1
    for axis in range(3):
        a = -(d_length * n0[axis] + length * (m0[axis] - n0[axis] * turn0)) / normal0
        b = -(d_length * n1[axis] + length * (m1[axis] - n1[axis] * turn1)) / normal1
        out[2, axis] = a
        out[3, axis] = b
        change = dt0 * g[2, axis] + dt1 * g[3, axis]
        out[1, axis] = -(t0 * a + t1 * b + change)
        out[0, axis] = -((1.0 - t0) * a + (1.0 - t1) * b - change)


@numba.njit(cache=True)
def _bending_law(law, angle, scale, low, fraction, table, active):
    if law == PUBLISHED:
        return published_bending(angle, scale, low, fraction, table, active)
    return paper_bending(angle, scale, low, fraction, table, active)


@numba.njit(cache=True, inline="always")
def _bending_factor(law):
    # The published hinge stiffness is a quarter of the one that gives a plate the tabulated bending stiffness.
    return 0.25 if law == PUBLISHED else 1.0


@numba.njit(cache=True)
def _bending_energy(law, angle, scale, low, fraction, table, active):
    """Integral of B(t) t from 0 to the angle: Gauss-Legendre on each polynomial piece of the spline (exact)."""
    knot = 0.5 * CURVATURE_STEP / scale
    total, start = 0.0, 0.0
    end = abs(angle)
    piece = 0
    while start < end:
        stop = min(end, knot * (2 * piece + 1)) if piece < 5 else end
        middle, half = 0.5 * (start + stop), 0.5 * (stop - start)
        offset = half / math.sqrt(3.0)
        for t in (middle - offset, middle + offset):
            total += half * t * _bending_law(law, math.copysign(t, angle), scale, low, fraction, table, active)[0]
        start = stop
        piece += 1
    return total


@numba.njit(cache=True, parallel=True)
def hinge_stiffness(law, exact, hinges, scale, weight, low, fraction, x, rest_angle, bending, energy, force, blocks):
    """Energy (PAPER), forces and stiffness blocks of all hinges.

    Args:
        rest_angle: Stress-free dihedral angles (hinges) [rad].
        bending: (1, 3, 5) shared or (hinges, 3, 5) [N m].
        energy: Receives (hinges) [J] where `exact`.
        force: Receives (hinges, 4, 3) [N].
        blocks: Receives (hinges, 16, 3, 3) [N/m], block 4 a + b of corners a, b.
    """
    count = hinges.shape[0]
    for chunk in numba.prange(CHUNKS):
        e, p, r, n0, n1 = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        de, dp, dr = np.empty(3), np.empty(3), np.empty(3)
        g, product, active = np.empty((4, 3)), np.empty((4, 3)), np.empty((3, 5))
        for i in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            table = bending[i] if bending.shape[0] > 1 else bending[0]
            angle = _hinge_angle(hinges[i], x, e, p, r, n0, n1, g) - rest_angle[i]
            value, slope = _bending_law(law, angle, scale[i], low[i], fraction[i], table, active)
            factor = _bending_factor(law) * weight[i]
            moment = factor * value * angle
            for a in range(4):
                for axis in range(3):
                    force[i, a, axis] = -moment * g[a, axis]
            stiffness = factor * (value + slope * angle) if exact else factor * value
            for a in range(4):
                for b in range(4):
                    for m in range(3):
                        for n in range(3):
                            blocks[i, 4 * a + b, m, n] = stiffness * g[a, m] * g[b, n]
            if exact:
                energy[i] = factor * _bending_energy(law, angle, scale[i], low[i], fraction[i], table, active)
                for b in range(4):
                    for n in range(3):
                        for axis in range(3):
                            unit = 1.0 if axis == n else 0.0
                            de[axis] = unit * ((1.0 if b == 1 else 0.0) - (1.0 if b == 0 else 0.0))
                            dp[axis] = unit * ((1.0 if b == 2 else 0.0) - (1.0 if b == 0 else 0.0))
                            dr[axis] = unit * ((1.0 if b == 3 else 0.0) - (1.0 if b == 0 else 0.0))
                        _hinge_hessian_product(e, p, r, n0, n1, g, de, dp, dr, product)
                        for a in range(4):
                            for m in range(3):
                                blocks[i, 4 * a + b, m, n] += moment * product[a, m]


@numba.njit(cache=True, parallel=True)
def hinge_adjoint(
    law,
    force_factor,
    stiffness_factor,
    hinges,
    scale,
    weight,
    low,
    fraction,
    x,
    rest_angle,
    adjoint,
    v,
    bending,
    g_x,
    g_bending,
    g_rest,
):
    """Derivatives of S (see the module) to positions, bending tables and rest angles.

    Args:
        g_x: Receives (hinges, 4, 3).
        g_bending: Adds up (hinges, 3, 5).
        g_rest: Adds up (hinges).
    """
    count = hinges.shape[0]
    for chunk in numba.prange(CHUNKS):
        e, p, r, n0, n1 = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        de, dp, dr = np.empty(3), np.empty(3), np.empty(3)
        g, active = np.empty((4, 3)), np.empty((3, 5))
        h_lambda, h_v = np.empty((4, 3)), np.empty((4, 3))
        for i in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            corners = hinges[i]
            table = bending[i] if bending.shape[0] > 1 else bending[0]
            angle = _hinge_angle(corners, x, e, p, r, n0, n1, g) - rest_angle[i]
            value, slope = _bending_law(law, angle, scale[i], low[i], fraction[i], table, active)
            factor = _bending_factor(law) * weight[i]
            along, across = 0.0, 0.0  # grad theta . lambda and grad theta . v
            for a in range(4):
                for axis in range(3):
                    along += g[a, axis] * adjoint[corners[a], axis]
                    across += g[a, axis] * v[corners[a], axis]
            difference(adjoint, corners[1], corners[0], de)
            difference(adjoint, corners[2], corners[0], dp)
            difference(adjoint, corners[3], corners[0], dr)
            _hinge_hessian_product(e, p, r, n0, n1, g, de, dp, dr, h_lambda)
            difference(v, corners[1], corners[0], de)
            difference(v, corners[2], corners[0], dp)
            difference(v, corners[3], corners[0], dr)
            _hinge_hessian_product(e, p, r, n0, n1, g, de, dp, dr, h_v)
            h, hh = force_factor, stiffness_factor
            stiffness = factor * value
            by_angle = factor * (h * (value + slope * angle) * along + hh * slope * along * across)
            by_lambda = stiffness * (h * angle + hh * across)
            by_v = stiffness * hh * along
            for a in range(4):
                for axis in range(3):
                    g_x[i, a, axis] = -(by_angle * g[a, axis] + by_lambda * h_lambda[a, axis] + by_v * h_v[a, axis])
            g_rest[i] += by_angle
            amount = factor * along * (h * angle + hh * across)
            for d in range(3):
                for s in range(5):
                    g_bending[i, d, s] -= amount * active[d, s]
