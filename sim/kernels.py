"""Compiled element kernels: forces, stiffness blocks and adjoints of faces and hinges, for both material laws.

Notation per face: x_u, x_v columns of the deformation gradient; Green strain G = (F^T F - I) / 2;
f_uu = s_u (x) x_u, f_vv = s_v (x) x_v, f_uv = s_u (x) x_v + s_v (x) x_u (the derivatives of G00, G11 and 2 G01);
k = (k0, k1, k2, k3) = (c11, c12, c22, c33) from `tables`. The secant force is
f = -A [k0 G00 f_uu + k2 G11 f_vv + k1 (G00 f_vv + G11 f_uu) + k3 G01 f_uv]; the `paper` law adds the terms that come
from the dependence of k on G, so that f is the gradient of
E = A [k0 G00^2 / 2 + k1 G00 G11 + k2 G11^2 / 2 + k3 G01^2].
Per hinge: dihedral angle theta, positive where the cloth is convex seen from its face; moment M(theta) and
f = -M grad theta.

The `gauss_newton` blocks are the positive-semidefinite stiffness of the published implicit Euler step; `exact` ones are
the Hessian of the energy. Adjoints return the derivatives of
S = force_factor * lambda . f - stiffness_factor * lambda . K v  (K the Gauss-Newton stiffness) at fixed lambda and v,
which serves an implicit Euler step (DESIGN: S = h lambda^T F + h^2 lambda^T J v) and, with stiffness_factor = 0, the
implicit function theorem.

References:
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Eq. 3-5.
    Tamstorf, Grinspun. Discrete bending forces and their Jacobians. Graphical Models 75(6), 2013.
"""

import math

import numba
import numpy as np

from cusick_bench.sim.tables import paper_bending, paper_stretch, published_bending, published_stretch

PUBLISHED = 0
PAPER = 1
_CHUNKS = 32  # elements are shared out in a fixed number of chunks: results do not depend on the thread count


@numba.njit(cache=True, inline="always")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True, inline="always")
def _columns(weights_u, weights_v, corners, values, u, v):
    """u = sum_a s_u[a] y_a and v = sum_a s_v[a] y_a for a vertex field y."""
    for axis in range(3):
        y0, y1, y2 = values[corners[0], axis], values[corners[1], axis], values[corners[2], axis]
        u[axis] = weights_u[0] * y0 + weights_u[1] * y1 + weights_u[2] * y2
        v[axis] = weights_v[0] * y0 + weights_v[1] * y1 + weights_v[2] * y2


@numba.njit(cache=True)
def _stretch_law(law, g00, g11, g01, table, k, dk, d2k, weight, d_weight, active):
    if law == PUBLISHED:
        published_stretch(g00, g11, g01, table, k, dk, active)
    else:
        paper_stretch(g00, g11, g01, table, k, dk, d2k, weight, d_weight)


@numba.njit(cache=True, parallel=True)
def face_stiffness(law, exact, faces, face_u, face_v, area, x, stretch, energy, force, blocks):
    """Energy, forces and stiffness blocks of all faces.

    Args:
        law: PUBLISHED or PAPER.
        exact: Hessian of the energy (PAPER only) instead of the Gauss-Newton stiffness.
        faces, face_u, face_v, area: From `Elements`.
        x: Positions (vertices, 3) [m].
        stretch: (1, 6, 4) shared or (faces, 6, 4) [N/m].
        energy: Receives (faces) [J].
        force: Receives (faces, 3, 3) [N].
        blocks: Receives (faces, 9, 3, 3) [N/m], block 3 a + b of corners a, b.
    """
    count = faces.shape[0]
    for chunk in numba.prange(_CHUNKS):
        xu, xv = np.empty(3), np.empty(3)
        k, dk, d2k = np.empty(4), np.empty((4, 3)), np.zeros((4, 3, 3))
        weight, d_weight, active = np.empty(6), np.empty((6, 3)), np.empty((6, 4))
        tangent, stress = np.empty((3, 3)), np.empty(3)
        for f in range(chunk * count // _CHUNKS, (chunk + 1) * count // _CHUNKS):
            su, sv = face_u[f], face_v[f]
            _columns(su, sv, faces[f], x, xu, xv)
            g00, g11, g01 = 0.5 * (_dot(xu, xu) - 1.0), 0.5 * (_dot(xv, xv) - 1.0), 0.5 * _dot(xu, xv)
            table = stretch[f] if stretch.shape[0] > 1 else stretch[0]
            _stretch_law(law, g00, g11, g01, table, k, dk, d2k, weight, d_weight, active)
            phi0, phi1, phi2, phi3 = 0.5 * g00 * g00, g00 * g11, 0.5 * g11 * g11, g01 * g01
            energy[f] = area[f] * (k[0] * phi0 + k[1] * phi1 + k[2] * phi2 + k[3] * phi3)
            # stress = d psi / d (G00, G11, G01); f_uv is the derivative of 2 G01
            stress[0] = k[0] * g00 + k[1] * g11
            stress[1] = k[2] * g11 + k[1] * g00
            stress[2] = 2.0 * k[3] * g01
            if law == PAPER:
                for a in range(3):
                    stress[a] += dk[0, a] * phi0 + dk[1, a] * phi1 + dk[2, a] * phi2 + dk[3, a] * phi3
            for a in range(3):
                for axis in range(3):
                    force[f, a, axis] = -area[f] * (
                        su[a] * (stress[0] * xu[axis] + 0.5 * stress[2] * xv[axis])
                        + sv[a] * (stress[1] * xv[axis] + 0.5 * stress[2] * xu[axis])
                    )
            if exact:
                _tangent(g00, g11, g01, k, dk, d2k, phi0, phi1, phi2, phi3, tangent)
                g_uu, g_vv, g_uv = stress[0], stress[1], stress[2]
            else:
                tangent[:] = 0.0
                tangent[0, 0], tangent[1, 1], tangent[2, 2] = k[0], k[2], 2.0 * k[3]
                tangent[0, 1] = tangent[1, 0] = k[1]
                plus0, plus1 = max(g00, 0.0), max(g11, 0.0)
                g_uu, g_vv, g_uv = k[0] * plus0 + k[1] * plus1, k[2] * plus1 + k[1] * plus0, 0.0
            _face_blocks(area[f], su, sv, xu, xv, tangent, g_uu, g_vv, g_uv, blocks[f])


@numba.njit(cache=True)
def _tangent(g00, g11, g01, k, dk, d2k, phi0, phi1, phi2, phi3, tangent):
    """Hessian of psi = sum_m k_m(G) phi_m(G) in (G00, G11, G01)."""
    for a in range(3):
        for b in range(3):
            tangent[a, b] = d2k[0, a, b] * phi0 + d2k[1, a, b] * phi1 + d2k[2, a, b] * phi2 + d2k[3, a, b] * phi3
    d_phi = ((g00, 0.0, 0.0), (g11, g00, 0.0), (0.0, g11, 0.0), (0.0, 0.0, 2.0 * g01))
    for a in range(3):
        for b in range(3):
            for m in range(4):
                tangent[a, b] += dk[m, a] * d_phi[m][b] + dk[m, b] * d_phi[m][a]
    tangent[0, 0] += k[0]
    tangent[0, 1] += k[1]
    tangent[1, 0] += k[1]
    tangent[1, 1] += k[2]
    tangent[2, 2] += 2.0 * k[3]


@numba.njit(cache=True)
def _face_blocks(area, su, sv, xu, xv, tangent, g_uu, g_vv, g_uv, blocks):
    """A [sum tangent_pq dG_p dG_q^T + g_uu D_uu + g_vv D_vv + g_uv D_uv], D_uu = s_u s_u^T (x) I and alike."""
    for a in range(3):
        for b in range(3):
            uu, vv = su[a] * su[b], sv[a] * sv[b]
            uv, vu = su[a] * sv[b], sv[a] * su[b]
            # coefficients of x_u x_u^T, x_v x_v^T, x_u x_v^T, x_v x_u^T in this block
            c_uu = tangent[0, 0] * uu + 0.5 * tangent[0, 2] * (uv + vu) + 0.25 * tangent[2, 2] * vv
            c_vv = tangent[1, 1] * vv + 0.5 * tangent[1, 2] * (uv + vu) + 0.25 * tangent[2, 2] * uu
            c_uv = tangent[0, 1] * uv + 0.5 * tangent[0, 2] * uu + 0.5 * tangent[1, 2] * vv + 0.25 * tangent[2, 2] * vu
            c_vu = tangent[0, 1] * vu + 0.5 * tangent[0, 2] * uu + 0.5 * tangent[1, 2] * vv + 0.25 * tangent[2, 2] * uv
            identity = g_uu * uu + g_vv * vv + 0.5 * g_uv * (uv + vu)
            block = blocks[3 * a + b]
            for i in range(3):
                for j in range(3):
                    block[i, j] = area * (
                        c_uu * xu[i] * xu[j] + c_vv * xv[i] * xv[j] + c_uv * xu[i] * xv[j] + c_vu * xv[i] * xu[j]
                    )
                block[i, i] += area * identity


@numba.njit(cache=True, parallel=True)
def face_adjoint(
    law, force_factor, stiffness_factor, faces, face_u, face_v, area, x, adjoint, v, stretch, g_x, g_stretch
):
    """Derivatives of S (see the module) to positions and stretch tables.

    Args:
        adjoint: lambda (vertices, 3).
        v: Velocity after the step (vertices, 3) [m/s].
        g_x: Receives (faces, 3, 3).
        g_stretch: Adds up (faces, 6, 4).
    """
    count = faces.shape[0]
    for chunk in numba.prange(_CHUNKS):
        xu, xv, lu, lv, vu, vv = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        k, dk, d2k = np.empty(4), np.empty((4, 3)), np.zeros((4, 3, 3))
        weight, d_weight, active = np.empty(6), np.empty((6, 3)), np.empty((6, 4))
        s_g, gu, gv, total = np.empty(3), np.empty(3), np.empty(3), np.empty(4)
        for f in range(chunk * count // _CHUNKS, (chunk + 1) * count // _CHUNKS):
            su, sv = face_u[f], face_v[f]
            _columns(su, sv, faces[f], x, xu, xv)
            _columns(su, sv, faces[f], adjoint, lu, lv)
            _columns(su, sv, faces[f], v, vu, vv)
            g00, g11, g01 = 0.5 * (_dot(xu, xu) - 1.0), 0.5 * (_dot(xv, xv) - 1.0), 0.5 * _dot(xu, xv)
            table = stretch[f] if stretch.shape[0] > 1 else stretch[0]
            _stretch_law(law, g00, g11, g01, table, k, dk, d2k, weight, d_weight, active)
            # contractions with lambda (a, b, c) and with v (ap, bp, cp) of f_uu, f_vv, f_uv
            a, b, c = _dot(lu, xu), _dot(lv, xv), _dot(lu, xv) + _dot(lv, xu)
            ap, bp, cp = _dot(vu, xu), _dot(vv, xv), _dot(vu, xv) + _dot(vv, xu)
            uu, ww = _dot(lu, vu), _dot(lv, vv)
            plus0, plus1 = max(g00, 0.0), max(g11, 0.0)
            on0, on1 = (1.0 if g00 > 0.0 else 0.0), (1.0 if g11 > 0.0 else 0.0)
            h, hh = force_factor, stiffness_factor
            total[0] = h * g00 * a + hh * (a * ap + plus0 * uu)
            total[1] = h * (g00 * b + g11 * a) + hh * (a * bp + b * ap + plus0 * ww + plus1 * uu)
            total[2] = h * g11 * b + hh * (b * bp + plus1 * ww)
            total[3] = h * g01 * c + hh * 0.5 * c * cp
            for p in range(3):
                s_g[p] = dk[0, p] * total[0] + dk[1, p] * total[1] + dk[2, p] * total[2] + dk[3, p] * total[3]
            s_g[0] += k[0] * (h * a + hh * on0 * uu) + k[1] * (h * b + hh * on0 * ww)
            s_g[1] += k[2] * (h * b + hh * on1 * ww) + k[1] * (h * a + hh * on1 * uu)
            s_g[2] += k[3] * h * c
            s_a = k[0] * (h * g00 + hh * ap) + k[1] * (h * g11 + hh * bp)
            s_b = k[2] * (h * g11 + hh * bp) + k[1] * (h * g00 + hh * ap)
            s_c = k[3] * (h * g01 + hh * 0.5 * cp)
            s_ap, s_bp, s_cp = hh * (k[0] * a + k[1] * b), hh * (k[2] * b + k[1] * a), hh * 0.5 * k[3] * c
            if law == PAPER:
                phi = (0.5 * g00 * g00, g00 * g11, 0.5 * g11 * g11, g01 * g01)
                d_phi = ((g00, 0.0, 0.0), (g11, g00, 0.0), (0.0, g11, 0.0), (0.0, 0.0, 2.0 * g01))
                direction = (a, b, 0.5 * c)  # derivative of G along lambda
                for m in range(4):
                    along = dk[m, 0] * a + dk[m, 1] * b + dk[m, 2] * 0.5 * c
                    s_a += h * dk[m, 0] * phi[m]
                    s_b += h * dk[m, 1] * phi[m]
                    s_c += 0.5 * h * dk[m, 2] * phi[m]
                    for p in range(3):
                        s_g[p] += h * along * d_phi[m][p]
                        for q in range(3):
                            s_g[p] += h * d2k[m, p, q] * direction[q] * phi[m]
                for j in range(6):
                    along = d_weight[j, 0] * a + d_weight[j, 1] * b + d_weight[j, 2] * 0.5 * c
                    for m in range(4):
                        g_stretch[f, j, m] -= area[f] * (weight[j] * total[m] + h * along * phi[m])
            else:
                for j in range(6):
                    for m in range(4):
                        g_stretch[f, j, m] -= area[f] * active[j, m] * total[m]
            for axis in range(3):
                gu[axis] = s_g[0] * xu[axis] + 0.5 * s_g[2] * xv[axis] + s_a * lu[axis] + s_c * lv[axis]
                gu[axis] += s_ap * vu[axis] + s_cp * vv[axis]
                gv[axis] = s_g[1] * xv[axis] + 0.5 * s_g[2] * xu[axis] + s_b * lv[axis] + s_c * lu[axis]
                gv[axis] += s_bp * vv[axis] + s_cp * vu[axis]
            for corner in range(3):
                for axis in range(3):
                    g_x[f, corner, axis] = -area[f] * (su[corner] * gu[axis] + sv[corner] * gv[axis])


@numba.njit(cache=True, inline="always")
def _difference(x, first, second, out):
    for axis in range(3):
        out[axis] = x[first, axis] - x[second, axis]


@numba.njit(cache=True, inline="always")
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True)
def _hinge_angle(corners, x, e, p, r, n0, n1, g):
    """Dihedral angle and its gradient g (4, 3); also edge e, opposite legs p, r and (unnormalised) face normals."""
    _difference(x, corners[1], corners[0], e)
    _difference(x, corners[2], corners[0], p)
    _difference(x, corners[3], corners[0], r)
    _cross(e, p, n0)
    _cross(r, e, n1)
    length2 = _dot(e, e)
    length = math.sqrt(length2)
    normal0, normal1 = _dot(n0, n0), _dot(n1, n1)
    # e . (n0 x n1) / |e| = -|e| (p . n1) in this orientation: positive where both opposite corners lie below
    angle = math.atan2(-length * _dot(p, n1), _dot(n0, n1))
    t0, t1 = _dot(p, e) / length2, _dot(r, e) / length2
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
    length2 = _dot(e, e)
    length = math.sqrt(length2)
    d_length = _dot(e, de) / length
    normal0, normal1 = _dot(n0, n0), _dot(n1, n1)
    t0, t1 = _dot(p, e) / length2, _dot(r, e) / length2
    dt0 = (_dot(dp, e) + _dot(p, de) - 2.0 * t0 * _dot(e, de)) / length2
    dt1 = (_dot(dr, e) + _dot(r, de) - 2.0 * t1 * _dot(e, de)) / length2
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
    turn0, turn1 = 2.0 * _dot(n0, m0) / normal0, 2.0 * _dot(n1, m1) / normal1
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
    knot = 0.5 * 10.0 / scale
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
def hinge_stiffness(
    law, exact, hinges, scale, weight, low, fraction, x, rest_angle, bending, energy, force, blocks
):
    """Energy (PAPER), forces and stiffness blocks of all hinges.

    Args:
        rest_angle: Stress-free dihedral angles (hinges) [rad].
        bending: (1, 3, 5) shared or (hinges, 3, 5) [N m].
        energy: Receives (hinges) [J] where `exact`.
        force: Receives (hinges, 4, 3) [N].
        blocks: Receives (hinges, 16, 3, 3) [N/m], block 4 a + b of corners a, b.
    """
    count = hinges.shape[0]
    for chunk in numba.prange(_CHUNKS):
        e, p, r, n0, n1 = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        de, dp, dr = np.empty(3), np.empty(3), np.empty(3)
        g, product, active = np.empty((4, 3)), np.empty((4, 3)), np.empty((3, 5))
        for i in range(chunk * count // _CHUNKS, (chunk + 1) * count // _CHUNKS):
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
    for chunk in numba.prange(_CHUNKS):
        e, p, r, n0, n1 = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        de, dp, dr = np.empty(3), np.empty(3), np.empty(3)
        g, active = np.empty((4, 3)), np.empty((3, 5))
        h_lambda, h_v = np.empty((4, 3)), np.empty((4, 3))
        for i in range(chunk * count // _CHUNKS, (chunk + 1) * count // _CHUNKS):
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
            _difference(adjoint, corners[1], corners[0], de)
            _difference(adjoint, corners[2], corners[0], dp)
            _difference(adjoint, corners[3], corners[0], dr)
            _hinge_hessian_product(e, p, r, n0, n1, g, de, dp, dr, h_lambda)
            _difference(v, corners[1], corners[0], de)
            _difference(v, corners[2], corners[0], dp)
            _difference(v, corners[3], corners[0], dr)
            _hinge_hessian_product(e, p, r, n0, n1, g, de, dp, dr, h_v)
            h, hh = force_factor, stiffness_factor
            stiffness = factor * value
            by_angle = factor * (h * (value + slope * angle) * along + hh * slope * along * across)
            by_lambda = stiffness * (h * angle + hh * across)
            by_v = stiffness * hh * along
            for a in range(4):
                for axis in range(3):
                    g_x[i, a, axis] = -(
                        by_angle * g[a, axis] + by_lambda * h_lambda[a, axis] + by_v * h_v[a, axis]
                    )
            g_rest[i] += by_angle
            amount = factor * along * (h * angle + hh * across)
            for d in range(3):
                for s in range(5):
                    g_bending[i, d, s] -= amount * active[d, s]


@numba.njit(cache=True, parallel=True)
def assemble_blocks(contribution_ptr, contributions, needed, faces_count, face_blocks, hinge_blocks, out):
    """Sums element blocks into the slots listed in `needed`; a fixed order of summation, so bitwise repeatable."""
    flat_face = face_blocks.reshape(-1, 3, 3)
    flat_hinge = hinge_blocks.reshape(-1, 3, 3)
    behind = 9 * faces_count
    for n in numba.prange(needed.shape[0]):
        slot = needed[n]
        out[slot] = 0.0
        for c in range(contribution_ptr[slot], contribution_ptr[slot + 1]):
            source = contributions[c]
            block = flat_face[source] if source < behind else flat_hinge[source - behind]
            for i in range(3):
                for j in range(3):
                    out[slot, i, j] += block[i, j]


@numba.njit(cache=True, parallel=True)
def gather_vertices(pointer, corners, faces_count, face_values, hinge_values, out):
    """Sums corner values (3-vectors) of faces and hinges into vertices; `corners` lists 3 f + a, then 4 h + a behind."""
    flat_face = face_values.reshape(-1, 3)
    flat_hinge = hinge_values.reshape(-1, 3)
    behind = 3 * faces_count
    for i in numba.prange(pointer.shape[0] - 1):
        for axis in range(3):
            out[i, axis] = 0.0
        for c in range(pointer[i], pointer[i + 1]):
            source = corners[c]
            for axis in range(3):
                if source < behind:
                    out[i, axis] += flat_face[source, axis]
                else:
                    out[i, axis] += flat_hinge[source - behind, axis]
