"""Compiled face kernels: stretch forces, stiffness blocks and their adjoint, for both material laws.

Per face: x_u, x_v are the columns of the deformation gradient F; Green strain G = (F^T F - I) / 2;
f_uu = s_u (x) x_u, f_vv = s_v (x) x_v, f_uv = s_u (x) x_v + s_v (x) x_u (the derivatives of G00, G11 and 2 G01);
k = (k0, k1, k2, k3) = (c11, c12, c22, c33) from `tables`. The secant force is
f = -A [k0 G00 f_uu + k2 G11 f_vv + k1 (G00 f_vv + G11 f_uu) + k3 G01 f_uv]; the `paper` law adds the terms that come
from the dependence of k on G, so that f is the gradient of
E = A [k0 G00^2 / 2 + k1 G00 G11 + k2 G11^2 / 2 + k3 G01^2].

Gauss-Newton blocks are the positive-semidefinite stiffness of the published implicit Euler step; exact ones are the
Hessian of the energy. The adjoint returns the derivatives of
S = force_factor * lambda . f - stiffness_factor * lambda . K v (K the Gauss-Newton stiffness) at fixed lambda and v:
with h and h^2 the adjoint of an implicit Euler step, with 1 and 0 that of static balance.

References:
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Eq. 3 and 4.
    Volino, Magnenat-Thalmann, Faure. A simple approach to nonlinear tensile stiffness for accurate cloth simulation.
    ACM Transactions on Graphics 28(4), 2009.
"""

import numba
import numpy as np

from cusick_bench.sim.tables import PAPER, PUBLISHED, paper_stretch, published_stretch
from cusick_bench.sim.vectors import CHUNKS, dot


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
    for chunk in numba.prange(CHUNKS):
        xu, xv = np.empty(3), np.empty(3)
        k, dk, d2k = np.empty(4), np.empty((4, 3)), np.zeros((4, 3, 3))
        weight, d_weight, active = np.empty(6), np.empty((6, 3)), np.empty((6, 4))
        tangent, stress = np.empty((3, 3)), np.empty(3)
        for f in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            su, sv = face_u[f], face_v[f]
            _columns(su, sv, faces[f], x, xu, xv)
            g00, g11, g01 = 0.5 * (dot(xu, xu) - 1.0), 0.5 * (dot(xv, xv) - 1.0), 0.5 * dot(xu, xv)
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
    for chunk in numba.prange(CHUNKS):
        xu, xv, lu, lv, vu, vv = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        k, dk, d2k = np.empty(4), np.empty((4, 3)), np.zeros((4, 3, 3))
        weight, d_weight, active = np.empty(6), np.empty((6, 3)), np.empty((6, 4))
        s_g, gu, gv, total = np.empty(3), np.empty(3), np.empty(3), np.empty(4)
        for f in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            su, sv = face_u[f], face_v[f]
            _columns(su, sv, faces[f], x, xu, xv)
            _columns(su, sv, faces[f], adjoint, lu, lv)
            _columns(su, sv, faces[f], v, vu, vv)
            g00, g11, g01 = 0.5 * (dot(xu, xu) - 1.0), 0.5 * (dot(xv, xv) - 1.0), 0.5 * dot(xu, xv)
            table = stretch[f] if stretch.shape[0] > 1 else stretch[0]
            _stretch_law(law, g00, g11, g01, table, k, dk, d2k, weight, d_weight, active)
            # contractions with lambda (a, b, c) and with v (ap, bp, cp) of f_uu, f_vv, f_uv
            a, b, c = dot(lu, xu), dot(lv, xv), dot(lu, xv) + dot(lv, xu)
            ap, bp, cp = dot(vu, xu), dot(vv, xv), dot(vu, xv) + dot(vv, xu)
            uu, ww = dot(lu, vu), dot(lv, vv)
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
