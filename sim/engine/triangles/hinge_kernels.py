"""Compiled hinge kernels: bending forces, stiffness blocks and their adjoint, for both material laws.

Per hinge: dihedral angle theta, positive where the cloth is convex seen from its face; with t = theta - rest angle the
moment is M = weight B(t scale) t, the force f = -M grad theta. Under `published` the weight is a quarter of the one
that gives a plate the tabulated bending stiffness. Gauss-Newton stiffness: (M / t) grad theta grad theta^T; exact:
M' grad theta grad theta^T + M Hess theta. The adjoint is that of `face_kernels`, and so are the batches.

With edge e, legs p and r to the outer corners, normals n0 = e x p, n1 = r x e and N = |n|^2, t0 = p.e / |e|^2 and
t1 = r.e / |e|^2, m0 = n0 x e and m1 = n1 x e, S = n m^T + m n^T, the Hessian of theta to (e, p, r) is

    pp: |e| S0 / N0^2      pe: -t0 pp + e n0^T / (|e| N0)      rr: -|e| S1 / N1^2     re: -t1 rr + e n1^T / (|e| N1)
    ee: S0 / (2 |e|^3 N0) - S1 / (2 |e|^3 N1) + t0^2 pp + t1^2 rr - w e^T - e w^T,
        w = t0 n0 / (|e| N0) + t1 n1 / (|e| N1)                pr: 0

References:
    Tamstorf, Grinspun. Discrete bending forces and their Jacobians. Graphical Models 75(6), 2013.
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Eq. 5.
"""

import math

import numpy as np

from cusick_bench.sim.kernel_cache import numba
from cusick_bench.sim.laws.paper import paper_bending
from cusick_bench.sim.laws.published import published_bending
from cusick_bench.sim.laws.tables import CURVATURE_STEP, PUBLISHED
from cusick_bench.sim.laws.vectors import CHUNKS, between, combine, cross, dot, kernel


@kernel()
def _legs(corners, values):
    """Differences of a vertex field along the edge and the two legs."""
    start = corners[0]
    return between(values, corners[1], start), between(values, corners[2], start), between(values, corners[3], start)


@kernel()
def _hinge(e, p, r):
    """Dihedral angle, its gradient to p and r, t0, t1, and the unnormalised face normals."""
    n0, n1 = cross(e, p), cross(r, e)
    length2 = dot(e, e)
    length = math.sqrt(length2)
    # e . (n0 x n1) / |e| = -|e| (p . n1) in this orientation: positive where both outer corners lie below
    angle = math.atan2(-length * dot(p, n1), dot(n0, n1))
    scale0, scale1 = -length / dot(n0, n0), -length / dot(n1, n1)
    a = (scale0 * n0[0], scale0 * n0[1], scale0 * n0[2])
    b = (scale1 * n1[0], scale1 * n1[1], scale1 * n1[2])
    return angle, a, b, dot(p, e) / length2, dot(r, e) / length2, n0, n1


@kernel()
def _bending_law(law, angle, scale, fraction, low_row, high_row):
    if law == PUBLISHED:
        return published_bending(angle, scale, fraction, low_row, high_row)
    return paper_bending(angle, scale, fraction, low_row, high_row)


@kernel()
def _bending_factor(law):
    # The published hinge stiffness is a quarter of the one that gives a plate the tabulated bending stiffness.
    return 0.25 if law == PUBLISHED else 1.0


@kernel()
def _bending_energy(law, angle, scale, fraction, low_row, high_row):
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
            total += half * t * _bending_law(law, math.copysign(t, angle), scale, fraction, low_row, high_row)[0]
        start = stop
        piece += 1
    return total


@kernel()
def _put_gradient(g, a, b, t0, t1):
    """Gradient of the angle to the four corners, from those to the legs."""
    for axis in range(3):
        end = -(t0 * a[axis] + t1 * b[axis])
        g[axis] = -(end + a[axis] + b[axis])
        g[3 + axis] = end
        g[6 + axis] = a[axis]
        g[9 + axis] = b[axis]


@kernel()
def _put_hessian(blocks, moment, e, n0, n1, t0, t1):
    """Adds moment Hess(theta) to blocks 11, 12, 13, 22, 33 (corner 0 follows by `_complete`); 23 stays."""
    length2 = dot(e, e)
    length = math.sqrt(length2)
    normal0, normal1 = dot(n0, n0), dot(n1, n1)
    m0, m1 = cross(n0, e), cross(n1, e)
    pp, rr = moment * length / (normal0 * normal0), -moment * length / (normal1 * normal1)
    turn0, turn1 = moment / (length * normal0), moment / (length * normal1)
    ee0 = 0.5 * moment / (length * length2 * normal0) + t0 * t0 * pp
    ee1 = -0.5 * moment / (length * length2 * normal1) + t1 * t1 * rr
    w = combine(t0 * turn0, n0, t1 * turn1, n1)
    for i in range(3):
        for j in range(3):
            s0, s1 = n0[i] * m0[j] + m0[i] * n0[j], n1[i] * m1[j] + m1[i] * n1[j]
            at = 3 * i + j
            blocks[4, at] += ee0 * s0 + ee1 * s1 - w[i] * e[j] - e[i] * w[j]
            blocks[5, at] += n0[i] * e[j] * turn0 - t0 * pp * s0  # ep, the transpose of pe
            blocks[6, at] += n1[i] * e[j] * turn1 - t1 * rr * s1
            blocks[7, at] += pp * s0
            blocks[9, at] += rr * s1


@kernel()
def _complete(blocks):
    """Blocks of corner 0 from the others: moving the whole hinge bends nothing."""
    for i in range(3):
        for j in range(3):
            at, turned = 3 * i + j, 3 * j + i
            blocks[1, at] = -(blocks[4, at] + blocks[5, turned] + blocks[6, turned])
            blocks[2, at] = -(blocks[5, at] + blocks[7, at] + blocks[8, turned])
            blocks[3, at] = -(blocks[6, at] + blocks[8, at] + blocks[9, at])
    for i in range(3):
        for j in range(3):
            at, turned = 3 * i + j, 3 * j + i
            blocks[0, at] = -(blocks[1, turned] + blocks[2, turned] + blocks[3, turned])


@kernel(parallel=True)
def hinge_stiffness(
    law, exact, chosen, hinges, scale, weight, low, fraction, x, rest_angle, bending, energy, gradient, moment,
    stiffness, blocks,
):  # fmt: skip
    """Moments and stiffness of all hinges.

    Args:
        chosen: Hinges to evaluate; what is kept of the others stays.
        rest_angle: Stress-free dihedral angles (members, hinges) [rad].
        bending: (members or 1, hinges or 1, 3, 5) [N m].
        energy: Receives (members, hinges) [J] where `exact`.
        gradient: Receives grad theta (members, hinges, 12) [1/m].
        moment: Receives -M (members, hinges) [J]; times the gradient it is the force.
        stiffness: Receives (members, hinges): the factor of grad theta grad theta^T [J].
        blocks: Receives where `exact` (members, hinges, 10, 9) [N/m]: corners 00, 01, 02, 03, 11, 12, 13, 22, 23, 33,
            each row by row.
    """
    members, count = x.shape[0], chosen.shape[0]
    factor = _bending_factor(law)
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        tables = bending[member if bending.shape[0] > 1 else 0]
        for place in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            i = chosen[place]
            table = tables[i if tables.shape[0] > 1 else 0]
            low_row, high_row = table[low[i]], table[low[i] + 1]
            e, p, r = _legs(hinges[i], x[member])
            bent, a, b, t0, t1, n0, n1 = _hinge(e, p, r)
            angle = bent - rest_angle[member, i]
            value, slope, _, _, _, _, _, _ = _bending_law(law, angle, scale[i], fraction[i], low_row, high_row)
            g = gradient[member, i]
            _put_gradient(g, a, b, t0, t1)
            pull = factor * weight[i] * value * angle
            moment[member, i] = -pull
            stiffness[member, i] = factor * weight[i] * (value + slope * angle if exact else value)
            if exact:
                energy[member, i] = (
                    factor * weight[i] * _bending_energy(law, angle, scale[i], fraction[i], low_row, high_row)
                )
                own = blocks[member, i]
                pair = 4
                for first in range(1, 4):
                    for second in range(first, 4):
                        for m in range(3):
                            k = stiffness[member, i] * g[3 * first + m]
                            for n in range(3):
                                own[pair, 3 * m + n] = k * g[3 * second + n]
                        pair += 1
                _put_hessian(own, pull, e, n0, n1, t0, t1)
                _complete(own)


@kernel()
def hinge_angles(hinges, x, angle):
    """Dihedral angles of one cloth.

    Args:
        hinges: From `Elements`.
        x: Positions (vertices, 3) [m].
        angle: Receives (hinges) [rad].
    """
    for i in range(len(hinges)):
        e, p, r = _legs(hinges[i], x)
        angle[i] = _hinge(e, p, r)[0]


@kernel()
def hinge_secants(law, scale, low, fraction, angle, bending, secant):
    """Bending stiffness that the hinges of one cloth have at their angles.

    Args:
        law: PUBLISHED or PAPER.
        scale, low, fraction: From `Elements`.
        angle: Dihedral angles less the rest angles (hinges) [rad].
        bending: (hinges or 1, 3, 5) [N m].
        secant: Receives B (hinges) [N m].
    """
    for i in range(len(angle)):
        table = bending[i if bending.shape[0] > 1 else 0]
        low_row, high_row = table[low[i]], table[low[i] + 1]
        secant[i] = _bending_law(law, angle[i], scale[i], fraction[i], low_row, high_row)[0]


@kernel()
def _hessian_product(e, p, r, n0, n1, a, b, t0, t1, de, dp, dr):
    """Change of grad theta to e, p and r when edge and legs change by de, dp, dr."""
    length2 = dot(e, e)
    length = math.sqrt(length2)
    d_length = dot(e, de) / length
    normal0, normal1 = dot(n0, n0), dot(n1, n1)
    dt0 = (dot(dp, e) + dot(p, de) - 2.0 * t0 * dot(e, de)) / length2
    dt1 = (dot(dr, e) + dot(r, de) - 2.0 * t1 * dot(e, de)) / length2
    m0 = combine(1.0, cross(de, p), 1.0, cross(e, dp))
    m1 = combine(1.0, cross(dr, e), 1.0, cross(r, de))
    turn0, turn1 = 2.0 * dot(n0, m0) / normal0, 2.0 * dot(n1, m1) / normal1
    da = combine((length * turn0 - d_length) / normal0, n0, -length / normal0, m0)
    db = combine((length * turn1 - d_length) / normal1, n1, -length / normal1, m1)
    by_end = combine(-1.0, combine(t0, da, t1, db), -1.0, combine(dt0, a, dt1, b))
    return by_end, da, db


@kernel(parallel=True)
def hinge_adjoint(
    law, force_factor, stiffness_factor, chosen, hinges, scale, weight, low, fraction, x, rest_angle, adjoint, v,
    bending, g_x, g_bending, g_rest,
):  # fmt: skip
    """Derivatives of S (see the module) to positions, bending tables and rest angles.

    Args:
        chosen: Hinges to evaluate.
        adjoint: lambda (members, vertices, 3).
        v: Velocity after the step (members, vertices, 3) [m/s].
        g_x: Receives (members, hinges, 12).
        g_bending: Adds up (members, hinges, 3, 5).
        g_rest: Adds up (members, hinges).
    """
    members, count = x.shape[0], chosen.shape[0]
    h, hh = force_factor, stiffness_factor
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        tables = bending[member if bending.shape[0] > 1 else 0]
        g = np.empty(12)
        for place in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            i = chosen[place]
            table = tables[i if tables.shape[0] > 1 else 0]
            low_row, high_row = table[low[i]], table[low[i] + 1]
            e, p, r = _legs(hinges[i], x[member])
            bent, a, b, t0, t1, n0, n1 = _hinge(e, p, r)
            angle = bent - rest_angle[member, i]
            value, slope, i0, i1, i2, w0, w1, w2 = _bending_law(law, angle, scale[i], fraction[i], low_row, high_row)
            factor = _bending_factor(law) * weight[i]
            by_end = combine(-t0, a, -t1, b)
            le, lp, lr = _legs(hinges[i], adjoint[member])
            ve, vp, vr = _legs(hinges[i], v[member])
            along = dot(by_end, le) + dot(a, lp) + dot(b, lr)  # grad theta . lambda
            across = dot(by_end, ve) + dot(a, vp) + dot(b, vr)  # grad theta . v
            stiffness = factor * value
            by_angle = factor * (h * (value + slope * angle) * along + hh * slope * along * across)
            by_lambda = stiffness * (h * angle + hh * across)
            by_v = stiffness * hh * along
            # both Hessian products in one, for they are linear
            change = _hessian_product(
                e, p, r, n0, n1, a, b, t0, t1,
                combine(by_lambda, le, by_v, ve), combine(by_lambda, lp, by_v, vp), combine(by_lambda, lr, by_v, vr),
            )  # fmt: skip
            to_end = combine(-by_angle, by_end, -1.0, change[0])
            to_p, to_r = combine(-by_angle, a, -1.0, change[1]), combine(-by_angle, b, -1.0, change[2])
            for axis in range(3):
                g[axis] = -(to_end[axis] + to_p[axis] + to_r[axis])
                g[3 + axis] = to_end[axis]
                g[6 + axis] = to_p[axis]
                g[9 + axis] = to_r[axis]
            g_x[member, i] = g
            g_rest[member, i] += by_angle
            amount = factor * along * (h * angle + hh * across)
            under, over = amount * (1.0 - fraction[i]), amount * fraction[i]
            rows = g_bending[member, i]
            rows[low[i], i0] -= under * w0
            rows[low[i], i1] -= under * w1
            rows[low[i], i2] -= under * w2
            rows[low[i] + 1, i0] -= over * w0
            rows[low[i] + 1, i1] -= over * w1
            rows[low[i] + 1, i2] -= over * w2
