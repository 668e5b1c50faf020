"""Compiled face kernels: stretch forces, stiffness blocks and their adjoint, for both material laws.

Per face: x_u, x_v are the columns of the deformation gradient F; Green strain G = (F^T F - I) / 2;
f_uu = s_u (x) x_u, f_vv = s_v (x) x_v, f_uv = s_u (x) x_v + s_v (x) x_u (the derivatives of G00, G11 and 2 G01);
k = (k0, k1, k2, k3) = (c11, c12, c22, c33) from the law's table. The secant force is
f = -A [k0 G00 f_uu + k2 G11 f_vv + k1 (G00 f_vv + G11 f_uu) + k3 G01 f_uv]; the `paper` law adds the terms that come
from the dependence of k on G, so that f is the gradient of
E = A [k0 G00^2 / 2 + k1 G00 G11 + k2 G11^2 / 2 + k3 G01^2].

Gauss-Newton blocks are the positive-semidefinite stiffness of the published implicit Euler step; `paper` makes sure of
that by max(k0 G00+ + k1 G11+, 0) and alike, where c12 < 0. Exact ones are the Hessian of the energy. The adjoint
returns the derivatives of S = force_factor * lambda . f - stiffness_factor * lambda . K v (K the Gauss-Newton
stiffness) at fixed lambda and v: with h and h^2 the adjoint of an implicit Euler step, with 1 and 0 that of static
balance. All arrays have a leading axis for the members of a batch.

References:
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Eq. 3 and 4.
    Volino, Magnenat-Thalmann, Faure. A simple approach to nonlinear tensile stiffness for accurate cloth simulation.
    ACM Transactions on Graphics 28(4), 2009.
"""

import numpy as np

from cusick_bench.sim.kernel_cache import numba
from cusick_bench.sim.laws.paper import (
    contracted,
    curvatures,
    mixed,
    paper_stress,
    paper_tangent,
    shares,
    slopes,
    weight_changes,
    weights,
)
from cusick_bench.sim.laws.published import published_stretch
from cusick_bench.sim.laws.tables import PAPER
from cusick_bench.sim.laws.vectors import CHUNKS, combine, dot, kernel


@kernel()
def _columns(su, sv, corners, values):
    """u = sum_a s_u[a] y_a and v = sum_a s_v[a] y_a for a vertex field y."""
    i, j, k = corners[0], corners[1], corners[2]
    x0, x1, x2 = values[i, 0], values[j, 0], values[k, 0]
    y0, y1, y2 = values[i, 1], values[j, 1], values[k, 1]
    z0, z1, z2 = values[i, 2], values[j, 2], values[k, 2]
    return (
        (su[0] * x0 + su[1] * x1 + su[2] * x2, su[0] * y0 + su[1] * y1 + su[2] * y2,
         su[0] * z0 + su[1] * z1 + su[2] * z2),
        (sv[0] * x0 + sv[1] * x1 + sv[2] * x2, sv[0] * y0 + sv[1] * y1 + sv[2] * y2,
         sv[0] * z0 + sv[1] * z1 + sv[2] * z2),
    )  # fmt: skip


@kernel()
def _published_stress(g00, g11, g01, table, k, dk, active):
    published_stretch(g00, g11, g01, table, k, dk, active)
    psi = 0.5 * k[0] * g00 * g00 + k[1] * g00 * g11 + 0.5 * k[2] * g11 * g11 + k[3] * g01 * g01
    stress = (k[0] * g00 + k[1] * g11, k[2] * g11 + k[1] * g00, 2.0 * k[3] * g01)
    return psi, (k[0], k[1], k[2], k[3]), stress


@kernel()
def _put(out, corner, vector, scale):
    out[corner, 0] = scale * vector[0]
    out[corner, 1] = scale * vector[1]
    out[corner, 2] = scale * vector[2]


@kernel()
def _put_outer(block, xu, p, xv, q, identity):
    """block = x_u p^T + x_v q^T + identity I, row by row."""
    block[0] = xu[0] * p[0] + xv[0] * q[0] + identity
    block[1] = xu[0] * p[1] + xv[0] * q[1]
    block[2] = xu[0] * p[2] + xv[0] * q[2]
    block[3] = xu[1] * p[0] + xv[1] * q[0]
    block[4] = xu[1] * p[1] + xv[1] * q[1] + identity
    block[5] = xu[1] * p[2] + xv[1] * q[2]
    block[6] = xu[2] * p[0] + xv[2] * q[0]
    block[7] = xu[2] * p[1] + xv[2] * q[1]
    block[8] = xu[2] * p[2] + xv[2] * q[2] + identity


@kernel()
def _pair_block(block, area, ua, va, ub, vb, xu, xv, tangent, g_uu, g_vv, g_uv):
    """A [sum t_pq dG_p dG_q^T + g_uu D_uu + g_vv D_vv + g_uv D_uv] of two corners, D_uu = s_u s_u^T (x) I and alike."""
    t00, t11, t22, t01, t02, t12 = tangent
    uu, vv, uv, vu = area * ua * ub, area * va * vb, area * ua * vb, area * va * ub
    both = uv + vu
    # coefficients of x_u x_u^T, x_v x_v^T, x_u x_v^T, x_v x_u^T in this block
    c_uu = t00 * uu + 0.5 * t02 * both + 0.25 * t22 * vv
    c_vv = t11 * vv + 0.5 * t12 * both + 0.25 * t22 * uu
    across = 0.5 * (t02 * uu + t12 * vv)
    c_uv = t01 * uv + across + 0.25 * t22 * vu
    c_vu = t01 * vu + across + 0.25 * t22 * uv
    identity = g_uu * uu + g_vv * vv + 0.5 * g_uv * both
    _put_outer(block, xu, combine(c_uu, xu, c_uv, xv), xv, combine(c_vu, xu, c_vv, xv), identity)


@kernel()
def _complete(blocks):
    """Blocks of corner 0, from those of corners 1 and 2: moving all three corners together strains nothing."""
    b00, b01, b02, b11, b12, b22 = blocks[0], blocks[1], blocks[2], blocks[3], blocks[4], blocks[5]
    for i in range(3):
        for j in range(3):
            b01[3 * i + j] = -(b11[3 * i + j] + b12[3 * j + i])
            b02[3 * i + j] = -(b12[3 * i + j] + b22[3 * i + j])
    for i in range(3):
        for j in range(3):
            b00[3 * i + j] = -(b01[3 * j + i] + b02[3 * j + i])


@kernel(parallel=True)
def face_stiffness(law, exact, chosen, faces, face_u, face_v, area, x, stretch, energy, vector, blocks):
    """Energy, forces and stiffness blocks of all faces.

    Args:
        law: PUBLISHED or PAPER.
        exact: Hessian of the energy (PAPER only) instead of the Gauss-Newton stiffness.
        chosen: Faces to evaluate; what is kept of the others stays.
        faces, face_u, face_v, area: From `Elements`.
        x: Positions (members, vertices, 3) [m].
        stretch: (members or 1, faces or 1, 6, 4) [N/m].
        energy: Receives (members, faces) [J].
        vector: Receives the forces (members, faces, 3, 3) [N].
        blocks: Receives (members, faces, 6, 9) [N/m]: corners 00, 01, 02, 11, 12, 22, each row by row.
    """
    members, count = x.shape[0], chosen.shape[0]
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        tables = stretch[member if stretch.shape[0] > 1 else 0]
        k_work, dk_work, active = np.empty(4), np.empty((4, 3)), np.empty((6, 4))
        for place in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            f = chosen[place]
            su, sv = face_u[f], face_v[f]
            xu, xv = _columns(su, sv, faces[f], x[member])
            g00, g11, g01 = 0.5 * (dot(xu, xu) - 1.0), 0.5 * (dot(xv, xv) - 1.0), 0.5 * dot(xu, xv)
            table = tables[f if tables.shape[0] > 1 else 0]
            if law == PAPER:
                psi, k, stress = paper_stress(g00, g11, g01, table)
            else:
                psi, k, stress = _published_stress(g00, g11, g01, table, k_work, dk_work, active)
            energy[member, f] = area[f] * psi
            along_u = combine(stress[0], xu, 0.5 * stress[2], xv)
            along_v = combine(0.5 * stress[2], xu, stress[1], xv)
            for corner in range(3):
                _put(vector[member, f], corner, combine(su[corner], along_u, sv[corner], along_v), -area[f])
            if exact:
                tangent = paper_tangent(g00, g11, g01, table, k)
                g_uu, g_vv, g_uv = stress
            else:
                tangent = (k[0], k[2], 2.0 * k[3], k[1], 0.0, 0.0)
                plus0, plus1 = max(g00, 0.0), max(g11, 0.0)
                g_uu, g_vv, g_uv = k[0] * plus0 + k[1] * plus1, k[2] * plus1 + k[1] * plus0, 0.0
                if law == PAPER:
                    g_uu, g_vv = max(g_uu, 0.0), max(g_vv, 0.0)
            own = blocks[member, f]
            _pair_block(own[3], area[f], su[1], sv[1], su[1], sv[1], xu, xv, tangent, g_uu, g_vv, g_uv)
            _pair_block(own[4], area[f], su[1], sv[1], su[2], sv[2], xu, xv, tangent, g_uu, g_vv, g_uv)
            _pair_block(own[5], area[f], su[2], sv[2], su[2], sv[2], xu, xv, tangent, g_uu, g_vv, g_uv)
            _complete(own)


@kernel()
def _paper_along(g00, g11, g01, table, direction, phi, push, extra):
    """Derivatives of the force part psi' . direction and of an extra part sum_m k_m extra_m, for law `paper`.

    Args:
        direction: Change of (G00, G11, 2 G01) along lambda.
        phi: phi_m, with psi = sum_m k_m phi_m.
        push: Derivative of phi_m along lambda.
        extra: Weights of k_m outside the force part.

    Returns:
        Hess f . direction + grad k . (push + extra), derivatives of the weights W along lambda (6), and those of k (4).
    """
    a, b, c = g00 * g00, 2.0 * g01 * g01, g11 * g11
    da, db, dc = 2.0 * g00 * direction[0], 2.0 * g01 * direction[2], 2.0 * g11 * direction[1]
    _, s1, s2, h, h1, h2 = shares(a, b, c)
    v = contracted(table, phi)
    fa, fb, fc = slopes(v, a, b, c, s1, h, h1)
    faa, fbb, fcc, fab, fac, fbc = curvatures(v, a, b, c, s2, h, h1, h2)
    ea, eb, ec = slopes(
        contracted(table, (push[0] + extra[0], push[1] + extra[1], push[2] + extra[2], push[3] + extra[3])),
        a, b, c, s1, h, h1,
    )  # fmt: skip
    changes = weight_changes(a, b, c, da, db, dc, s1, h, h1)
    by_a = faa * da + fab * db + fac * dc + ea
    by_b = fab * da + fbb * db + fbc * dc + eb
    by_c = fac * da + fbc * db + fcc * dc + ec
    bent = (
        2.0 * (by_a * g00 + fa * direction[0]),
        2.0 * (by_c * g11 + fc * direction[1]),
        4.0 * by_b * g01 + 2.0 * fb * direction[2],
    )
    return bent, changes, mixed(table, changes)


@kernel(parallel=True)
def face_adjoint(
    law, force_factor, stiffness_factor, chosen, faces, face_u, face_v, area, x, adjoint, v, stretch, g_x, g_stretch
):
    """Derivatives of S (see the module) to positions and stretch tables.

    Args:
        chosen: Faces to evaluate.
        adjoint: lambda (members, vertices, 3).
        v: Velocity after the step (members, vertices, 3) [m/s].
        g_x: Receives (members, faces, 3, 3).
        g_stretch: Adds up (members, faces, 6, 4).
    """
    members, count = x.shape[0], chosen.shape[0]
    h, hh = force_factor, stiffness_factor
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        tables = stretch[member if stretch.shape[0] > 1 else 0]
        k_work, dk, active = np.empty(4), np.empty((4, 3)), np.empty((6, 4))
        for place in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            f = chosen[place]
            su, sv = face_u[f], face_v[f]
            xu, xv = _columns(su, sv, faces[f], x[member])
            lu, lv = _columns(su, sv, faces[f], adjoint[member])
            vu, vv = _columns(su, sv, faces[f], v[member])
            g00, g11, g01 = 0.5 * (dot(xu, xu) - 1.0), 0.5 * (dot(xv, xv) - 1.0), 0.5 * dot(xu, xv)
            table = tables[f if tables.shape[0] > 1 else 0]
            if law == PAPER:
                _, k, stress = paper_stress(g00, g11, g01, table)
            else:
                _, k, stress = _published_stress(g00, g11, g01, table, k_work, dk, active)
            # contractions with lambda (a, b, c) and with v (ap, bp, cp) of f_uu, f_vv, f_uv
            a, b, c = dot(lu, xu), dot(lv, xv), dot(lu, xv) + dot(lv, xu)
            ap, bp, cp = dot(vu, xu), dot(vv, xv), dot(vu, xv) + dot(vv, xu)
            plus0, plus1 = max(g00, 0.0), max(g11, 0.0)
            uu, ww = dot(lu, vu), dot(lv, vv)
            if law == PAPER:  # where the Gauss-Newton stiffness is cut off; at c12 = 0 it is not yet
                uu = uu if k[0] * plus0 + k[1] * plus1 >= 0.0 else 0.0
                ww = ww if k[2] * plus1 + k[1] * plus0 >= 0.0 else 0.0
            on0, on1 = (hh if g00 > 0.0 else 0.0), (hh if g11 > 0.0 else 0.0)
            # S = sum_m k_m (push_m + extra_m), apart from the change of k along lambda
            push = (h * g00 * a, h * (g00 * b + g11 * a), h * g11 * b, h * g01 * c)
            extra = (
                hh * (a * ap + plus0 * uu),
                hh * (a * bp + b * ap + plus0 * ww + plus1 * uu),
                hh * (b * bp + plus1 * ww),
                hh * 0.5 * c * cp,
            )
            s0 = k[0] * (h * a + on0 * uu) + k[1] * (h * b + on0 * ww)
            s1 = k[2] * (h * b + on1 * ww) + k[1] * (h * a + on1 * uu)
            s2 = k[3] * h * c
            s_a = h * stress[0] + hh * (k[0] * ap + k[1] * bp)
            s_b = h * stress[1] + hh * (k[2] * bp + k[1] * ap)
            s_c = 0.5 * h * stress[2] + hh * 0.5 * k[3] * cp
            s_ap, s_bp, s_cp = hh * (k[0] * a + k[1] * b), hh * (k[2] * b + k[1] * a), hh * 0.5 * k[3] * c
            rows = g_stretch[member, f]
            if law == PAPER:
                qa, qb, qc = g00 * g00, 2.0 * g01 * g01, g11 * g11
                phi = (0.5 * qa, g00 * g11, 0.5 * qc, 0.5 * qb)
                bent, changes, dk_along = _paper_along(g00, g11, g01, table, (h * a, h * b, h * c), phi, push, extra)
                s0 += bent[0] + dk_along[0] * g00 + dk_along[1] * g11
                s1 += bent[1] + dk_along[2] * g11 + dk_along[1] * g00
                s2 += bent[2] + 2.0 * dk_along[3] * g01
                s, _, _, share, _, _ = shares(qa, qb, qc)
                w = weights(qa, qb, qc, s, share)
                for m in range(4):
                    total = area[f] * (push[m] + extra[m])
                    part = area[f] * phi[m]
                    for j in range(6):
                        rows[j, m] -= w[j] * total + changes[j] * part
            else:
                for m in range(4):
                    total = push[m] + extra[m]
                    s0 += dk[m, 0] * total
                    s1 += dk[m, 1] * total
                    s2 += dk[m, 2] * total
                    for j in range(6):
                        rows[j, m] -= area[f] * active[j, m] * total
            for axis in range(3):
                gu = s0 * xu[axis] + 0.5 * s2 * xv[axis] + s_a * lu[axis] + s_c * lv[axis]
                gu += s_ap * vu[axis] + s_cp * vv[axis]
                gv = s1 * xv[axis] + 0.5 * s2 * xu[axis] + s_b * lv[axis] + s_c * lu[axis]
                gv += s_bp * vv[axis] + s_cp * vu[axis]
                for corner in range(3):
                    g_x[member, f, corner, axis] = -area[f] * (su[corner] * gu + sv[corner] * gv)
