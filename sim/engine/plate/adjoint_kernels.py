"""Compiled adjoint of law `plate`: derivatives of S = h lambda . F - h^2 lambda . K v, as in `triangles.face_kernels`.

Points, nodes and places are those of `kernels`, y is that of `points`.
"""

import numpy as np

from cusick_bench.sim.engine.plate.points import (
    bending_slopes,
    curvature,
    member_table,
    normal,
    position_slopes,
    second_slopes,
)
from cusick_bench.sim.kernel_cache import numba
from cusick_bench.sim.laws.paper import (
    contracted,
    curvatures,
    mixed,
    paper_stress,
    shares,
    slopes,
    weight_changes,
    weights,
)
from cusick_bench.sim.laws.plate import (
    curvature_shares,
    plate_bending,
    plate_secant_slope,
    plate_stiffness,
    plate_table_adjoint,
    plate_tangent,
    squared_curvature,
)
from cusick_bench.sim.laws.vectors import CHUNKS, combine, cross, dot, kernel


@kernel()
def _membrane_adjoint(xu, xv, lu, lv, vu, vv, table, force, secant, scale, g_table):
    """-scale times the derivatives of the membrane's part of S to x_,1 and x_,2; those to C are added to g_table.

    S = force lambda . f - secant lambda . K v per area, with f = - psi' (see `face_adjoint`); (lu, lv) and (vu, vv) are
    the derivatives of lambda and v by the material coordinates.
    """
    h, hh = force, secant
    g00, g11, g01 = 0.5 * (dot(xu, xu) - 1.0), 0.5 * (dot(xv, xv) - 1.0), 0.5 * dot(xu, xv)
    _, k, stress = paper_stress(g00, g11, g01, table)
    a, b, c = dot(lu, xu), dot(lv, xv), dot(lu, xv) + dot(lv, xu)
    ap, bp, cp = dot(vu, xu), dot(vv, xv), dot(vu, xv) + dot(vv, xu)
    plus0, plus1 = max(g00, 0.0), max(g11, 0.0)
    uu = dot(lu, vu) if k[0] * plus0 + k[1] * plus1 >= 0.0 else 0.0
    ww = dot(lv, vv) if k[2] * plus1 + k[1] * plus0 >= 0.0 else 0.0
    on0, on1 = (hh if g00 > 0.0 else 0.0), (hh if g11 > 0.0 else 0.0)
    push = (h * g00 * a, h * (g00 * b + g11 * a), h * g11 * b, h * g01 * c)
    extra = (
        hh * (a * ap + plus0 * uu), hh * (a * bp + b * ap + plus0 * ww + plus1 * uu), hh * (b * bp + plus1 * ww),
        hh * 0.5 * c * cp,
    )  # fmt: skip
    s0 = k[0] * (h * a + on0 * uu) + k[1] * (h * b + on0 * ww)
    s1 = k[2] * (h * b + on1 * ww) + k[1] * (h * a + on1 * uu)
    s2 = k[3] * h * c
    s_a = h * stress[0] + hh * (k[0] * ap + k[1] * bp)
    s_b = h * stress[1] + hh * (k[2] * bp + k[1] * ap)
    s_c = 0.5 * h * stress[2] + hh * 0.5 * k[3] * cp
    s_ap, s_bp, s_cp = hh * (k[0] * a + k[1] * b), hh * (k[2] * b + k[1] * a), hh * 0.5 * k[3] * c
    # what comes from the dependence of k on the strain
    qa, qb, qc = g00 * g00, 2.0 * g01 * g01, g11 * g11
    phi = (0.5 * qa, g00 * g11, 0.5 * qc, 0.5 * qb)
    da, db, dc = 2.0 * g00 * h * a, 2.0 * g01 * h * c, 2.0 * g11 * h * b
    s, d1, d2, part, part1, part2 = shares(qa, qb, qc)
    v = contracted(table, phi)
    fa, fb, fc = slopes(v, qa, qb, qc, d1, part, part1)
    faa, fbb, fcc, fab, fac, fbc = curvatures(v, qa, qb, qc, d2, part, part1, part2)
    both = contracted(table, (push[0] + extra[0], push[1] + extra[1], push[2] + extra[2], push[3] + extra[3]))
    ea, eb, ec = slopes(both, qa, qb, qc, d1, part, part1)
    changes = weight_changes(qa, qb, qc, da, db, dc, d1, part, part1)
    dk = mixed(table, changes)
    s0 += 2.0 * ((faa * da + fab * db + fac * dc + ea) * g00 + fa * h * a) + dk[0] * g00 + dk[1] * g11
    s1 += 2.0 * ((fac * da + fbc * db + fcc * dc + ec) * g11 + fc * h * b) + dk[2] * g11 + dk[1] * g00
    s2 += 4.0 * (fab * da + fbb * db + fbc * dc + eb) * g01 + 2.0 * fb * h * c + 2.0 * dk[3] * g01
    w = weights(qa, qb, qc, s, part)
    for m in range(4):
        total, own = scale * (push[m] + extra[m]), scale * phi[m]
        for j in range(6):
            g_table[j, m] -= w[j] * total + changes[j] * own
    by_u = combine(-scale * s0, xu, -0.5 * scale * s2, xv)
    by_u = combine(1.0, combine(1.0, by_u, -scale * s_a, lu), -scale * s_c, lv)
    by_u = combine(1.0, combine(1.0, by_u, -scale * s_ap, vu), -scale * s_cp, vv)
    by_v = combine(-scale * s1, xv, -0.5 * scale * s2, xu)
    by_v = combine(1.0, combine(1.0, by_v, -scale * s_b, lv), -scale * s_c, lu)
    by_v = combine(1.0, combine(1.0, by_v, -scale * s_bp, vv), -scale * s_cp, vu)
    return by_u, by_v


@kernel()
def _slope_change(xu, xv, s, n, length, factor, zu, zv, zs):
    """factor times Hess kappa (zu, zv, zs): parts by x_,1, x_,2 and s of one curvature."""
    value, c = curvature(s, n, length)
    change = combine(1.0, cross(zu, xv), 1.0, cross(xu, zv))  # dN
    stretch = dot(n, change)  # dJ
    dn = combine(1.0 / length, change, -stretch / length, n)
    d_value = dot(n, zs) + dot(dn, s)
    dc = combine(1.0 / length, zs, -d_value / length, n)
    dc = combine(1.0, dc, -value / length, dn)
    dc = combine(1.0, dc, -stretch / length, c)
    return (
        combine(factor, cross(zv, c), factor, cross(xv, dc)), combine(factor, cross(dc, xu), factor, cross(c, zu)),
        combine(factor, dn, 0.0, dn),
    )  # fmt: skip


@kernel()
def _symmetric_times(t, k):
    return (
        t[0] * k[0] + t[3] * k[1] + t[4] * k[2], t[3] * k[0] + t[1] * k[1] + t[5] * k[2],
        t[4] * k[0] + t[5] * k[1] + t[2] * k[2],
    )  # fmt: skip


@kernel()
def _put(target, value):
    target[0], target[1], target[2] = value[0], value[1], value[2]


@kernel(parallel=True)
def edge_adjoint(
    force, secant, start, nodes, weight, area, share, base, field, adjoint, velocity, stretch, bending, rest, poisson,
    vector, g_base, g_stretch, g_bending, g_rest, g_poisson,
):  # fmt: skip
    """Derivatives of S = force lambda . F - secant lambda . K v (K the Gauss-Newton stiffness) at fixed lambda and v.

    Args:
        force, secant: Factors of forces and stiffness.
        start, nodes, weight, area, share, base, field, stretch, bending, rest, poisson: As in `edge_stiffness`.
        adjoint: lambda (members, rows, 3).
        velocity: v (members, rows, 3) [m/s].
        vector: Receives derivatives by the control points (members, places, 3).
        g_base: Receives derivatives by `base` of every point (members, points, 2, 3).
        g_stretch, g_bending, g_rest: Add up (members, points, 6, 4), (members, edges, 3, 5), (members, edges, 3).
        g_poisson: Receives every edge's share (members, edges).
    """
    members, count = field.shape[0], area.shape[0]
    nowhere = np.zeros((2, 3))
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        stretches, bendings = member_table(stretch, member), member_table(bending, member)
        parts, d, by_y, found = np.empty((3, 5)), np.empty((3, 4)), np.empty((5, 3)), vector[member]
        for p in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            first, end, table = start[p], start[p + 1], member_table(bendings, p)
            xu, xv = position_slopes(first, end, nodes, weight, base[member], field[member])
            lu, lv = position_slopes(first, end, nodes, weight, nowhere, adjoint[member])
            vu, vv = position_slopes(first, end, nodes, weight, nowhere, velocity[member])
            s = second_slopes(first, end, nodes, weight, field[member])
            ls = second_slopes(first, end, nodes, weight, adjoint[member])
            vs = second_slopes(first, end, nodes, weight, velocity[member])
            by_u, by_v = _membrane_adjoint(
                xu, xv, lu, lv, vu, vv, member_table(stretches, p), force, secant, share * area[p],
                g_stretch[member, p],
            )  # fmt: skip
            n, length = normal(xu, xv)
            k0, c0 = curvature(s[0], n, length)
            k1, c1 = curvature(s[1], n, length)
            k2, c2 = curvature(s[2], n, length)
            a0, b0 = bending_slopes(c0, xu, xv, n)
            a1, b1 = bending_slopes(c1, xu, xv, n)
            a2, b2 = bending_slopes(c2, xu, xv, n)
            k = (k0 - rest[member, p, 0], k1 - rest[member, p, 1], k2 - rest[member, p, 2])
            nu, nv, mu, mv = dot(n, lu), dot(n, lv), dot(n, vu), dot(n, vv)
            # changes of the curvatures where position changes by lambda, and by v
            lk = (
                a0 * nu + b0 * nv + dot(n, ls[0]), a1 * nu + b1 * nv + dot(n, ls[1]),
                a2 * nu + b2 * nv + dot(n, ls[2]),
            )  # fmt: skip
            vk = (
                a0 * mu + b0 * mv + dot(n, vs[0]), a1 * mu + b1 * mv + dot(n, vs[1]),
                a2 * mu + b2 * mv + dot(n, vs[2]),
            )  # fmt: skip
            curvature_shares(squared_curvature(k), parts)
            plate_stiffness(table, poisson[member], parts, d)
            _, moment = plate_bending(k, d)
            hard = _symmetric_times(plate_tangent(k, d, True), lk)
            soft = plate_tangent(k, d, False)
            turn = plate_secant_slope(k, lk, vk, d)
            dv, dl = _symmetric_times(soft, vk), _symmetric_times(soft, lk)
            size = -area[p]
            r0, r1, r2 = (
                size * (force * hard[0] + secant * turn[0]), size * (force * hard[1] + secant * turn[1]),
                size * (force * hard[2] + secant * turn[2]),
            )  # fmt: skip
            g_rest[member, p, 0] -= r0
            g_rest[member, p, 1] -= r1
            g_rest[member, p, 2] -= r2
            by_u = combine(1.0, by_u, r0 * a0 + r1 * a1 + r2 * a2, n)
            by_v = combine(1.0, by_v, r0 * b0 + r1 * b1 + r2 * b2, n)
            _put(by_y[2], combine(r0, n, 0.0, n))
            _put(by_y[3], combine(r1, n, 0.0, n))
            _put(by_y[4], combine(r2, n, 0.0, n))
            for q in range(3):
                along, across = size * (force * moment[q] + secant * dv[q]), size * secant * dl[q]
                # the Hessian is linear in the direction: one product for lambda and v together
                du, dw, ds = _slope_change(
                    xu, xv, s[q], n, length, 1.0, combine(along, lu, across, vu), combine(along, lv, across, vv),
                    combine(along, ls[q], across, vs[q]),
                )  # fmt: skip
                by_u, by_v = combine(1.0, by_u, 1.0, du), combine(1.0, by_v, 1.0, dw)
                for axis in range(3):
                    by_y[2 + q, axis] += ds[axis]
            g_poisson[member, p] = plate_table_adjoint(
                k, lk, vk, force, secant, table, poisson[member], parts, d, size, g_bending[member, p]
            )
            _put(by_y[0], by_u)
            _put(by_y[1], by_v)
            _put(g_base[member, p, 0], by_u)
            _put(g_base[member, p, 1], by_v)
            for at in range(first, end):
                for axis in range(3):
                    found[at, axis] = (
                        weight[at, 0] * by_y[0, axis] + weight[at, 1] * by_y[1, axis] + weight[at, 2] * by_y[2, axis]
                        + weight[at, 3] * by_y[3, axis] + weight[at, 4] * by_y[4, axis]
                    )  # fmt: skip


@kernel(parallel=True)
def vertex_adjoint(
    force, secant, start, nodes, weight, area, share, offset, base, field, adjoint, velocity, stretch, vector, g_base,
    g_stretch,
):  # fmt: skip
    """The vertex points' part of `edge_adjoint`; `offset` as in `vertex_stiffness`."""
    members, count = field.shape[0], area.shape[0]
    nowhere = np.zeros((2, 3))
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        stretches, found = member_table(stretch, member), vector[member]
        for p in range(offset + chunk * count // CHUNKS, offset + (chunk + 1) * count // CHUNKS):
            first, end = start[p], start[p + 1]
            xu, xv = position_slopes(first, end, nodes, weight, base[member], field[member])
            lu, lv = position_slopes(first, end, nodes, weight, nowhere, adjoint[member])
            vu, vv = position_slopes(first, end, nodes, weight, nowhere, velocity[member])
            by_u, by_v = _membrane_adjoint(
                xu, xv, lu, lv, vu, vv, member_table(stretches, p), force, secant, share * area[p - offset],
                g_stretch[member, p],
            )  # fmt: skip
            _put(g_base[member, p, 0], by_u)
            _put(g_base[member, p, 1], by_v)
            for at in range(first, end):
                for axis in range(3):
                    found[at, axis] = weight[at, 0] * by_u[axis] + weight[at, 1] * by_v[axis]
