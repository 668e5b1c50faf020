"""Compiled kernels of law `plate`: energy, forces, stiffness blocks and adjoint at the quadrature points of a shell.

At a quadrature point everything depends on the derivatives of position by the material coordinates,
y = (x_,1, x_,2, x_,11, x_,22, 2 x_,12), which are fixed sums over the control points nearby. With
n = x_,1 x x_,2 / J, J = |x_,1 x x_,2|, curvatures are kappa = n . (x_,11, x_,22, 2 x_,12), and

    d kappa_k / d s_k = n,   d kappa_k / d x_,1 = x_,2 x c_k,   d kappa_k / d x_,2 = c_k x x_,1,
    c_k = (s_k - (n . s_k) n) / J,   s = (x_,11, x_,22, 2 x_,12);

with N = x_,1 x x_,2, C = sum_k m_k c_k and moments m_k the second derivatives of sum_k m_k kappa_k are those of

    2 sum_k m_k ds_k . P dN / J + 2 C . (dx_,1 x dx_,2) - dN . [n C^T + C n^T + (sum_k m_k n . s_k) P / J] dN / J,
    P = I - n n^T.

Edge points carry bending and a small share of the membrane energy, vertex points the rest of it: fewer membrane points
than control points would need, so that folds are not stiffened by strains that a coarse mesh cannot avoid, and the
share at the edges leaves no mode without energy (reduced integration with stabilisation).

Gauss-Newton stiffness (of the implicit Euler step): B^T D B for bending, that of law `paper` for the membrane. The
adjoint is that of `face_kernels`. All arrays have a leading axis for the members of a batch; element vectors and
blocks lie one behind another, those of all nodes (pairs of nodes, first <= second) of the edges, then of the vertices.

References:
    Cirak, Ortiz, Schroeder. Subdivision surfaces: a new paradigm for thin-shell finite-element analysis. Int. J.
    Numerical Methods in Engineering 47, 2000: energy of the shell, Section 2.
    Belytschko, Ong, Liu, Kennedy. Hourglass control in linear and nonlinear problems. Computer Methods in Applied
    Mechanics and Engineering 43, 1984.
"""

import math

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
def _derivatives(weight, nodes, count, base, field, y):
    """y_r = base_r + sum_i weight[r, i] field[nodes[i]]; base holds rows 0 and 1."""
    for r in range(len(y)):
        a, b, c = (base[r, 0], base[r, 1], base[r, 2]) if r < 2 else (0.0, 0.0, 0.0)
        for i in range(count):
            w, node = weight[r, i], nodes[i]
            a += w * field[node, 0]
            b += w * field[node, 1]
            c += w * field[node, 2]
        y[r, 0], y[r, 1], y[r, 2] = a, b, c


@kernel()
def _row(y, r):
    return y[r, 0], y[r, 1], y[r, 2]


@kernel()
def _add_outer(block, factor, p, q):
    """block += factor p q^T, row by row."""
    for i in range(3):
        t = factor * p[i]
        block[3 * i] += t * q[0]
        block[3 * i + 1] += t * q[1]
        block[3 * i + 2] += t * q[2]


@kernel()
def _add_identity(block, factor):
    block[0] += factor
    block[4] += factor
    block[8] += factor


@kernel()
def _put_transposed(block, turned):
    for i in range(3):
        for j in range(3):
            turned[3 * j + i] = block[3 * i + j]


@kernel()
def _membrane(y, table, scale, exact, gradient, stiffness):
    """Adds membrane gradient and stiffness in (x_,1, x_,2), all times `scale`; returns the energy.

    Args:
        y: Derivatives of position (2 or more, 3).
        table: C of the point (6, 4) [N/m].
        scale: Area [m2].
        exact: Hessian instead of the Gauss-Newton stiffness.
        gradient: Rows 0 and 1 receive the gradient's.
        stiffness: Blocks 00, 01 and 11 receive (rows, rows, 9).
    """
    xu, xv = _row(y, 0), _row(y, 1)
    g00, g11, g01 = 0.5 * (dot(xu, xu) - 1.0), 0.5 * (dot(xv, xv) - 1.0), 0.5 * dot(xu, xv)
    psi, k, stress = paper_stress(g00, g11, g01, table)
    for axis in range(3):
        gradient[0, axis] += scale * (stress[0] * xu[axis] + 0.5 * stress[2] * xv[axis])
        gradient[1, axis] += scale * (0.5 * stress[2] * xu[axis] + stress[1] * xv[axis])
    if exact:
        t00, t11, t22, t01, t02, t12 = paper_tangent(g00, g11, g01, table, k)
        uu, vv, uv = stress
    else:
        t00, t11, t22, t01, t02, t12 = k[0], k[2], 2.0 * k[3], k[1], 0.0, 0.0
        plus0, plus1 = max(g00, 0.0), max(g11, 0.0)
        uu, vv, uv = max(k[0] * plus0 + k[1] * plus1, 0.0), max(k[2] * plus1 + k[1] * plus0, 0.0), 0.0
    first, both, second = stiffness[0, 0], stiffness[0, 1], stiffness[1, 1]
    _add_outer(first, scale, xu, combine(t00, xu, 0.5 * t02, xv))
    _add_outer(first, scale, xv, combine(0.5 * t02, xu, 0.25 * t22, xv))
    _add_identity(first, scale * uu)
    _add_outer(second, scale, xv, combine(t11, xv, 0.5 * t12, xu))
    _add_outer(second, scale, xu, combine(0.5 * t12, xv, 0.25 * t22, xu))
    _add_identity(second, scale * vv)
    _add_outer(both, scale, xu, combine(0.5 * t02, xu, t01, xv))
    _add_outer(both, scale, xv, combine(0.25 * t22, xu, 0.5 * t12, xv))
    _add_identity(both, scale * 0.5 * uv)
    return scale * psi


@kernel()
def _normal(y):
    """Unit normal n, and J = |x_,1 x x_,2|."""
    a = cross(_row(y, 0), _row(y, 1))
    length = math.sqrt(dot(a, a))
    return (a[0] / length, a[1] / length, a[2] / length), length


@kernel()
def _curvature(y, n, length, k):
    """n . s_k and c_k of the k-th curvature."""
    s = _row(y, 2 + k)
    value = dot(n, s)
    return value, combine(1.0 / length, s, -value / length, n)


@kernel()
def _bent(y, n, length, rest, slope):
    """Curvatures less those at rest [1/m]; `slope` receives their gradients by y (3, 5, 3)."""
    xu, xv = _row(y, 0), _row(y, 1)
    values = (0.0, 0.0, 0.0)
    slope[:] = 0.0
    for k in range(3):
        value, c = _curvature(y, n, length, k)
        gu, gv = cross(xv, c), cross(c, xu)
        for axis in range(3):
            slope[k, 0, axis], slope[k, 1, axis], slope[k, 2 + k, axis] = gu[axis], gv[axis], n[axis]
        if k == 0:
            values = (value - rest[0], 0.0, 0.0)
        elif k == 1:
            values = (values[0], value - rest[1], 0.0)
        else:
            values = (values[0], values[1], value - rest[2])
    return values


@kernel()
def _add_bending(slope, moment, tangent, scale, gradient, stiffness):
    """Adds scale sum_k m_k grad kappa_k to the gradient and scale B^T T B to the stiffness's blocks first <= second."""
    t = (
        (tangent[0], tangent[3], tangent[4]),
        (tangent[3], tangent[1], tangent[5]),
        (tangent[4], tangent[5], tangent[2]),
    )
    for r in range(5):
        for axis in range(3):
            gradient[r, axis] += scale * (
                moment[0] * slope[0, r, axis] + moment[1] * slope[1, r, axis] + moment[2] * slope[2, r, axis]
            )
    for p in range(3):
        for r in range(5):
            if r >= 2 and r != 2 + p:
                continue
            left = _row(slope[p], r)
            for second in range(r, 5):
                right = (0.0, 0.0, 0.0)
                for q in range(3):
                    factor = t[p][q]
                    right = (
                        right[0] + factor * slope[q, second, 0], right[1] + factor * slope[q, second, 1],
                        right[2] + factor * slope[q, second, 2],
                    )  # fmt: skip
                _add_outer(stiffness[r, second], scale, left, right)


@kernel()
def _unit(axis):
    return (1.0, 0.0, 0.0) if axis == 0 else ((0.0, 1.0, 0.0) if axis == 1 else (0.0, 0.0, 1.0))


@kernel()
def _add_geometric(y, n, length, moment, scale, stiffness):
    """Adds scale sum_k m_k Hess kappa_k to the stiffness's blocks first <= second."""
    xu, xv = _row(y, 0), _row(y, 1)
    total, size = (0.0, 0.0, 0.0), 0.0
    for k in range(3):
        value, c = _curvature(y, n, length, k)
        total = combine(1.0, total, moment[k], c)
        size += moment[k] * value
    for axis in range(3):
        e = _unit(axis)
        for r in range(2):
            change = cross(e, xv) if r == 0 else cross(xu, e)  # dN
            along = dot(n, change)
            flat = combine(1.0 / length, change, -along / length, n)  # P dN / J
            # - [n (C . dN) + C (n . dN) + size P dN / J] / J
            push = combine(-dot(total, change) / length, n, -along / length, total)
            push = combine(1.0, push, -size / length, flat)
            # dN^T push by x_,1 is x_,2 x push, by x_,2 push x x_,1
            by_u, by_v = cross(xv, push), cross(push, xu)
            if r == 0:
                by_v = combine(1.0, by_v, 1.0, cross(total, e))  # C . (dx_,1 x dx_,2)
            for i in range(3):
                if r == 0:
                    stiffness[0, 0, 3 * i + axis] += scale * by_u[i]
                    stiffness[0, 1, 3 * axis + i] += scale * by_v[i]
                else:
                    stiffness[1, 1, 3 * i + axis] += scale * by_v[i]
            for k in range(3):
                for i in range(3):
                    stiffness[r, 2 + k, 3 * axis + i] += scale * moment[k] * flat[i]


@kernel()
def _complete(stiffness):
    """Blocks below the diagonal from those above."""
    for r in range(len(stiffness)):
        for second in range(r + 1, len(stiffness)):
            _put_transposed(stiffness[r, second], stiffness[second, r])


@kernel()
def _put_weighted(weight, node, source, block):
    """block = sum_r weight[r, node] source[r], nine sums side by side: one alone waits for each of its products."""
    a, b, c, d, e, f, g, h, i = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for r in range(len(source)):
        w, row = weight[r, node], source[r]
        a, b, c = a + w * row[0], b + w * row[1], c + w * row[2]
        d, e, f = d + w * row[3], e + w * row[4], f + w * row[5]
        g, h, i = g + w * row[6], h + w * row[7], i + w * row[8]
    block[0], block[1], block[2], block[3], block[4] = a, b, c, d, e
    block[5], block[6], block[7], block[8] = f, g, h, i


@kernel()
def _to_nodes(weight, count, gradient, stiffness, vector, blocks, half):
    """Forces (the negative gradient) and stiffness of the nodes, from those by y."""
    rows = len(gradient)
    for i in range(count):
        for axis in range(3):
            value = 0.0
            for r in range(rows):
                value -= weight[r, i] * gradient[r, axis]
            vector[i, axis] = value
    place = 0
    for i in range(count):
        for second in range(rows):
            _put_weighted(weight, i, stiffness[:, second], half[second])
        for j in range(i, count):
            _put_weighted(weight, j, half, blocks[place])
            place += 1


@kernel()
def _table(tables, at):
    return tables[at if tables.shape[0] > 1 else 0]


@kernel(parallel=True)
def edge_stiffness(
    exact, nodes, counts, weight, area, share, first_node, first_block, base, field, stretch, bending, rest, poisson,
    energy, vector, blocks,
):  # fmt: skip
    """Energy, forces and stiffness blocks of all edge points.

    Args:
        exact: Hessian of the energy instead of the Gauss-Newton stiffness.
        nodes, counts, weight, area: From `ShellStencils`.
        share: Share of the membrane energy that the edges carry.
        first_node, first_block: Where a point's vectors and blocks begin (edges).
        base: Derivatives x_,1 and x_,2 of the undeformed cloth on the plate (members, 2, 3).
        field: Displacements of the control points (members, rows, 3) [m].
        stretch: (members or 1, points or 1, 6, 4) [N/m].
        bending: (members or 1, edges or 1, 3, 5) [N m].
        rest: Curvatures at rest (members, edges, 3) [1/m].
        poisson: (members).
        energy: Receives (members, points) [J].
        vector: Receives forces (members, nodes of all points, 3) [N].
        blocks: Receives (members, pairs of nodes of all points, 9) [N/m].
    """
    members, count = field.shape[0], nodes.shape[0]
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        stretches, bendings = _table(stretch, member), _table(bending, member)
        y, gradient, stiffness = np.empty((5, 3)), np.empty((5, 3)), np.empty((5, 5, 9))
        parts, d, slope, half = np.empty((3, 5)), np.empty((3, 4)), np.empty((3, 5, 3)), np.empty((5, 9))
        for p in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            _derivatives(weight[p], nodes[p], counts[p], base[member], field[member], y)
            gradient[:] = 0.0
            stiffness[:] = 0.0
            work = _membrane(y, _table(stretches, p), share * area[p], exact, gradient, stiffness)
            n, length = _normal(y)
            k = _bent(y, n, length, rest[member, p], slope)
            curvature_shares(squared_curvature(k), parts)
            plate_stiffness(_table(bendings, p), poisson[member], parts, d)
            psi, moment = plate_bending(k, d)
            _add_bending(slope, moment, plate_tangent(k, d, exact), area[p], gradient, stiffness)
            if exact:
                _add_geometric(y, n, length, moment, area[p], stiffness)
            _complete(stiffness)
            energy[member, p] = work + area[p] * psi
            at = first_node[p]
            _to_nodes(
                weight[p], counts[p], gradient, stiffness, vector[member, at : at + counts[p]],
                blocks[member, first_block[p] :], half,
            )  # fmt: skip


@kernel(parallel=True)
def vertex_stiffness(
    exact, nodes, counts, weight, area, share, first_node, first_block, base, field, stretch, offset, energy, vector,
    blocks,
):  # fmt: skip
    """Energy, forces and stiffness blocks of all vertex points; arguments as in `edge_stiffness`.

    Args:
        share: Share of the membrane energy that the vertices carry.
        offset: Number of edges, which come before the vertices in `stretch` and `energy`.
    """
    members, count = field.shape[0], nodes.shape[0]
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        stretches = _table(stretch, member)
        y, gradient, stiffness, half = np.empty((2, 3)), np.empty((2, 3)), np.empty((2, 2, 9)), np.empty((2, 9))
        for p in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            _derivatives(weight[p], nodes[p], counts[p], base[member], field[member], y)
            gradient[:] = 0.0
            stiffness[:] = 0.0
            energy[member, offset + p] = _membrane(
                y, _table(stretches, offset + p), share * area[p], exact, gradient, stiffness
            )
            _complete(stiffness)
            at = first_node[p]
            _to_nodes(
                weight[p], counts[p], gradient, stiffness, vector[member, at : at + counts[p]],
                blocks[member, first_block[p] :], half,
            )  # fmt: skip


@kernel()
def _membrane_adjoint(y, along, across, table, force, secant, scale, g_y, g_table):
    """Adds -scale times the derivatives of the membrane's part of S to g_y and g_table (see `face_adjoint`).

    S = force lambda . f - secant lambda . K v per area, with f = - psi'; `along` and `across` are the derivatives of
    lambda and v by the material coordinates.
    """
    h, hh = force, secant
    xu, xv, lu, lv, vu, vv = _row(y, 0), _row(y, 1), _row(along, 0), _row(along, 1), _row(across, 0), _row(across, 1)
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
    for axis in range(3):
        g_y[0, axis] -= scale * (
            s0 * xu[axis] + 0.5 * s2 * xv[axis] + s_a * lu[axis] + s_c * lv[axis] + s_ap * vu[axis] + s_cp * vv[axis]
        )
        g_y[1, axis] -= scale * (
            s1 * xv[axis] + 0.5 * s2 * xu[axis] + s_b * lv[axis] + s_c * lu[axis] + s_bp * vv[axis] + s_cp * vu[axis]
        )


@kernel()
def _add_slope_change(y, n, length, k, weight, z, scale, g_y):
    """Adds scale times Hess kappa_k (weight z) to g_y."""
    xu, xv = _row(y, 0), _row(y, 1)
    value, c = _curvature(y, n, length, k)
    zu, zv, zs = _row(z, 0), _row(z, 1), _row(z, 2 + k)
    change = combine(1.0, cross(zu, xv), 1.0, cross(xu, zv))  # dN
    stretch = dot(n, change)  # dJ
    dn = combine(1.0 / length, change, -stretch / length, n)
    d_value = dot(n, zs) + dot(dn, _row(y, 2 + k))
    dc = combine(1.0 / length, zs, -d_value / length, n)
    dc = combine(1.0, dc, -value / length, dn)
    dc = combine(1.0, dc, -stretch / length, c)
    by_u = combine(1.0, cross(zv, c), 1.0, cross(xv, dc))
    by_v = combine(1.0, cross(dc, xu), 1.0, cross(c, zu))
    factor = scale * weight
    for axis in range(3):
        g_y[0, axis] += factor * by_u[axis]
        g_y[1, axis] += factor * by_v[axis]
        g_y[2 + k, axis] += factor * dn[axis]


@kernel()
def _along(slope, z):
    """Changes of the three curvatures where y changes by z."""
    a, b, c = 0.0, 0.0, 0.0
    for r in range(5):
        for axis in range(3):
            a += slope[0, r, axis] * z[r, axis]
            b += slope[1, r, axis] * z[r, axis]
            c += slope[2, r, axis] * z[r, axis]
    return a, b, c


@kernel()
def _symmetric_times(t, k):
    return (
        t[0] * k[0] + t[3] * k[1] + t[4] * k[2], t[3] * k[0] + t[1] * k[1] + t[5] * k[2],
        t[4] * k[0] + t[5] * k[1] + t[2] * k[2],
    )  # fmt: skip


@kernel()
def _spread(weight, count, g_y, vector):
    """Derivatives by the nodes from those by y."""
    for i in range(count):
        for axis in range(3):
            value = 0.0
            for r in range(len(g_y)):
                value += weight[r, i] * g_y[r, axis]
            vector[i, axis] = value


@kernel(parallel=True)
def edge_adjoint(
    force, secant, nodes, counts, weight, area, share, first_node, base, field, adjoint, velocity, stretch, bending,
    rest, poisson, vector, g_base, g_stretch, g_bending, g_rest, g_poisson,
):  # fmt: skip
    """Derivatives of S = force lambda . F - secant lambda . K v (K the Gauss-Newton stiffness) at fixed lambda and v.

    Args:
        adjoint: lambda (members, rows, 3).
        velocity: v (members, rows, 3) [m/s].
        vector: Receives derivatives by the control points, as in `edge_stiffness`.
        g_base: Receives derivatives by `base` of every point (members, points, 2, 3).
        g_stretch, g_bending, g_rest: Add up (members, points, 6, 4), (members, edges, 3, 5), (members, edges, 3).
        g_poisson: Receives every edge's share (members, edges).
    """
    members, count = field.shape[0], nodes.shape[0]
    nowhere = np.zeros((2, 3))
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        stretches, bendings = _table(stretch, member), _table(bending, member)
        y, along, across, g_y = np.empty((5, 3)), np.empty((5, 3)), np.empty((5, 3)), np.empty((5, 3))
        parts, d, slope = np.empty((3, 5)), np.empty((3, 4)), np.empty((3, 5, 3))
        for p in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            _derivatives(weight[p], nodes[p], counts[p], base[member], field[member], y)
            _derivatives(weight[p], nodes[p], counts[p], nowhere, adjoint[member], along)
            _derivatives(weight[p], nodes[p], counts[p], nowhere, velocity[member], across)
            g_y[:] = 0.0
            _membrane_adjoint(
                y, along, across, _table(stretches, p), force, secant, share * area[p], g_y, g_stretch[member, p]
            )
            table = _table(bendings, p)
            n, length = _normal(y)
            k = _bent(y, n, length, rest[member, p], slope)
            curvature_shares(squared_curvature(k), parts)
            plate_stiffness(table, poisson[member], parts, d)
            _, moment = plate_bending(k, d)
            lk, vk = _along(slope, along), _along(slope, across)
            hard = _symmetric_times(plate_tangent(k, d, True), lk)
            soft = plate_tangent(k, d, False)
            turn = plate_secant_slope(k, lk, vk, d)
            dv, dl = _symmetric_times(soft, vk), _symmetric_times(soft, lk)
            for q in range(3):
                by_k = -area[p] * (force * hard[q] + secant * turn[q])
                g_rest[member, p, q] -= by_k
                for r in range(5):
                    for axis in range(3):
                        g_y[r, axis] += by_k * slope[q, r, axis]
                _add_slope_change(y, n, length, q, force * moment[q] + secant * dv[q], along, -area[p], g_y)
                _add_slope_change(y, n, length, q, secant * dl[q], across, -area[p], g_y)
            g_poisson[member, p] = plate_table_adjoint(
                k, lk, vk, force, secant, table, poisson[member], parts, d, -area[p], g_bending[member, p]
            )
            at = first_node[p]
            _spread(weight[p], counts[p], g_y, vector[member, at : at + counts[p]])
            g_base[member, p] = g_y[:2]


@kernel(parallel=True)
def vertex_adjoint(
    force, secant, nodes, counts, weight, area, share, first_node, base, field, adjoint, velocity, stretch, offset,
    vector, g_base, g_stretch,
):  # fmt: skip
    """The vertex points' part of `edge_adjoint`; points are counted behind the edges in g_base and g_stretch."""
    members, count = field.shape[0], nodes.shape[0]
    nowhere = np.zeros((2, 3))
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        stretches = _table(stretch, member)
        y, along, across, g_y = np.empty((2, 3)), np.empty((2, 3)), np.empty((2, 3)), np.empty((2, 3))
        for p in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            _derivatives(weight[p], nodes[p], counts[p], base[member], field[member], y)
            _derivatives(weight[p], nodes[p], counts[p], nowhere, adjoint[member], along)
            _derivatives(weight[p], nodes[p], counts[p], nowhere, velocity[member], across)
            g_y[:] = 0.0
            _membrane_adjoint(
                y, along, across, _table(stretches, offset + p), force, secant, share * area[p], g_y,
                g_stretch[member, offset + p],
            )  # fmt: skip
            at = first_node[p]
            _spread(weight[p], counts[p], g_y, vector[member, at : at + counts[p]])
            g_base[member, offset + p] = g_y


@kernel(parallel=True)
def shell_curvatures(nodes, counts, weight, base, field, curvature):
    """Curvatures (k11, k22, 2 k12) at all edge points.

    Args:
        nodes, counts, weight: From `ShellStencils`.
        base, field: As in `edge_stiffness`.
        curvature: Receives (members, edges, 3) [1/m].
    """
    members, count = field.shape[0], nodes.shape[0]
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        y = np.empty((5, 3))
        for p in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            _derivatives(weight[p], nodes[p], counts[p], base[member], field[member], y)
            n, _ = _normal(y)
            for k in range(3):
                curvature[member, p, k] = dot(n, _row(y, 2 + k))


@kernel()
def _plus(total, block, transposed):
    if transposed:
        return (
            total[0] + block[0], total[1] + block[3], total[2] + block[6], total[3] + block[1], total[4] + block[4],
            total[5] + block[7], total[6] + block[2], total[7] + block[5], total[8] + block[8],
        )  # fmt: skip
    return (
        total[0] + block[0], total[1] + block[1], total[2] + block[2], total[3] + block[3], total[4] + block[4],
        total[5] + block[5], total[6] + block[6], total[7] + block[7], total[8] + block[8],
    )  # fmt: skip


@kernel(parallel=True)
def gather_blocks(slots, vertex, start, terms, scale, diagonal, blocks, out):
    """out = scale * (sum of blocks) + diagonal, in the slots that the linear solver reads.

    Args:
        slots: Slots to fill.
        vertex: Vertex whose diagonal block a slot is, or -1.
        start, terms: For every slot 2 b + t for each block b that adds to it, transposed where t = 1.
        scale: Factor of all blocks.
        diagonal: Added to the diagonal (members, vertices).
        blocks: (members, pairs, 9).
        out: Receives (members, slots of the pattern, 3, 3); other slots stay.
    """
    members, count = out.shape[0], slots.shape[0]
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        for place in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            total = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            for at in range(start[place], start[place + 1]):
                total = _plus(total, blocks[member, terms[at] >> 1], terms[at] & 1)
            add = diagonal[member, vertex[place]] if vertex[place] >= 0 else 0.0
            block = out[member, slots[place]]
            block[0, 0] = scale * total[0] + add
            block[0, 1] = scale * total[1]
            block[0, 2] = scale * total[2]
            block[1, 0] = scale * total[3]
            block[1, 1] = scale * total[4] + add
            block[1, 2] = scale * total[5]
            block[2, 0] = scale * total[6]
            block[2, 1] = scale * total[7]
            block[2, 2] = scale * total[8] + add


@kernel(parallel=True)
def gather_vectors(start, terms, vectors, out):
    """Sums the points' vectors at every control point.

    Args:
        start, terms: Vectors that belong to every row.
        vectors: (members, nodes of all points, 3).
        out: Receives (members, rows, 3).
    """
    members, count = out.shape[0], out.shape[1]
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        for row in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            a, b, c = 0.0, 0.0, 0.0
            for at in range(start[row], start[row + 1]):
                own = vectors[member, terms[at]]
                a, b, c = a + own[0], b + own[1], c + own[2]
            out[member, row, 0], out[member, row, 1], out[member, row, 2] = a, b, c
