"""Compiled kernels of law `plate`: energy, forces and stiffness at the quadrature points of a shell.

With y as in `points`, N = x_,1 x x_,2, C = sum_k m_k c_k and moments m_k, second derivatives of sum_k m_k kappa_k
are those of

    2 sum_k m_k ds_k . P dN / J + 2 C . (dx_,1 x dx_,2) - dN . [n C^T + C n^T + (sum_k m_k kappa_k) P / J] dN / J,
    P = I - n n^T.

Edge points carry bending and a small share of the membrane energy, vertex points the rest of it: fewer membrane points
than control points would need, so that folds are not stiffened by strains that a coarse mesh cannot avoid, and the
share at the edges leaves no mode without energy (reduced integration with stabilisation).

All curvatures change along n alone, so that the stiffness of a point between its nodes i and j, whose weights in y are
w_i and w_j, needs few numbers of each node: with slopes B_ki = w_1i a_k + w_2i b_k + w_(2+k)i of the curvatures,

    K_ij = sum_(r, s = 1, 2) w_ri K_rs w_sj + (B_i^T T B_j) n n^T   [+ mu_i (w_1j Phi_1^T + w_2j Phi_2^T)
           + (w_1i Phi_1 + w_2i Phi_2) mu_j,   mu_i = sum_k m_k w_(2+k)i,   Phi_r = (P dN/dx_,r / J)^T];

the term in brackets belongs to the Hessian. The points keep K_rs, n n^T and Phi_r, the nodes B_i, T B_i and mu_i, and
every row of the matrix is summed from these by itself: no block of a point is ever stored. Gauss-Newton stiffness (of
the implicit Euler step): T = D for bending, and that of law `paper` for the membrane.

All arrays have a leading axis for the members of a batch. Nodes of all points lie one behind another ("places"), those
of the edges first.

References:
    Belytschko, Ong, Liu, Kennedy. Hourglass control in linear and nonlinear problems. Computer Methods in Applied
    Mechanics and Engineering 43, 1984.
"""

import numpy as np

from cusick_bench.sim.engine.plate.block_sums import BLOCK_BYTES, add_blocks, put_blocks
from cusick_bench.sim.engine.plate.points import (
    bending_slopes,
    curvature,
    member_table,
    normal,
    position_slopes,
    second_slopes,
)
from cusick_bench.sim.kernel_cache import numba
from cusick_bench.sim.laws.paper import paper_stress, paper_tangent
from cusick_bench.sim.laws.plate import (
    curvature_shares,
    plate_bending,
    plate_stiffness,
    plate_tangent,
    squared_curvature,
)
from cusick_bench.sim.laws.vectors import CHUNKS, combine, cross, dot, kernel

_K11, _K12, _K21, _K22, _NN, _PHI_1, _PHI_2, _PHI_1_T, _PHI_2_T = range(0, 81, 9)  # first number of each block
_BYTES = BLOCK_BYTES // 9  # of a number
EDGE_BLOCKS, VERTEX_BLOCKS = 81, 36
"""Numbers that a point keeps: blocks K_11, K_12, K_21 and K_22 row by row, and at edges n n^T, Phi_1, Phi_2, Phi_1^T
and Phi_2^T."""

NODE_SLOPES = 7
"""Numbers that a node of an edge point keeps: B (3), T B (3) and mu."""


@kernel()
def _membrane(xu, xv, table, rest, scale, exact, block):
    """Energy and its gradient in (x_,1, x_,2), all times `scale`; `block` receives K_11, K_12 and K_22 (not K_21).

    `rest` is the shear x_,1 . x_,2 without shear stress.
    """
    g00, g11, g01 = 0.5 * (dot(xu, xu) - 1.0), 0.5 * (dot(xv, xv) - 1.0), 0.5 * (dot(xu, xv) - rest)
    psi, k, stress = paper_stress(g00, g11, g01, table)
    if exact:
        t00, t11, t22, t01, t02, t12 = paper_tangent(g00, g11, g01, table, k)
        uu, vv, uv = stress
    else:
        t00, t11, t22, t01, t02, t12 = k[0], k[2], 2.0 * k[3], k[1], 0.0, 0.0
        plus0, plus1 = max(g00, 0.0), max(g11, 0.0)
        uu, vv, uv = max(k[0] * plus0 + k[1] * plus1, 0.0), max(k[2] * plus1 + k[1] * plus0, 0.0), 0.0
    shear, half = 0.25 * scale * t22, 0.5 * scale
    by_u, by_v = combine(scale * t00, xu, half * t02, xv), combine(half * t02, xu, shear, xv)
    both_u, both_v = combine(half * t02, xu, scale * t01, xv), combine(shear, xu, half * t12, xv)
    next_u, next_v = combine(shear, xu, half * t12, xv), combine(half * t12, xu, scale * t11, xv)
    for i in range(3):
        for j in range(3):
            block[_K11 + 3 * i + j] = xu[i] * by_u[j] + xv[i] * by_v[j]
            block[_K12 + 3 * i + j] = xu[i] * both_u[j] + xv[i] * both_v[j]
            block[_K22 + 3 * i + j] = xu[i] * next_u[j] + xv[i] * next_v[j]
        block[_K11 + 4 * i] += scale * uu
        block[_K12 + 4 * i] += half * uv
        block[_K22 + 4 * i] += scale * vv
    return (
        scale * psi, combine(scale * stress[0], xu, half * stress[2], xv),
        combine(half * stress[2], xu, scale * stress[1], xv),
    )  # fmt: skip


@kernel()
def _unit(axis):
    return (1.0, 0.0, 0.0) if axis == 0 else ((0.0, 1.0, 0.0) if axis == 1 else (0.0, 0.0, 1.0))


@kernel()
def _add_geometric(xu, xv, n, length, total, size, block):
    """Adds the part of the Hessian that comes from the moments to K_11, K_12 and K_22, and puts Phi_1 and Phi_2.

    Args:
        xu, xv, n, length: x_,1, x_,2, n and J.
        total: C, times the point's area.
        size: Sum of m_k kappa_k, times the point's area.
        block: Stiffness numbers of an edge point (EDGE_BLOCKS); changed.
    """
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
            if r == 0:
                by_u = cross(xv, push)
                by_v = combine(1.0, cross(push, xu), 1.0, cross(total, e))  # C . (dx_,1 x dx_,2)
                for i in range(3):
                    block[_K11 + 3 * i + axis] += by_u[i]
                    block[_K12 + 3 * axis + i] += by_v[i]
            else:
                by_v = cross(push, xu)
                for i in range(3):
                    block[_K22 + 3 * i + axis] += by_v[i]
            phi, transposed = (_PHI_1, _PHI_1_T) if r == 0 else (_PHI_2, _PHI_2_T)
            for i in range(3):
                block[phi + 3 * axis + i] = flat[i]
                block[transposed + 3 * i + axis] = flat[i]


@kernel()
def _put_transposed(block):
    """K_21 from K_12."""
    for i in range(3):
        for j in range(3):
            block[_K21 + 3 * j + i] = block[_K12 + 3 * i + j]


@kernel()
def _put_force(vector, at, u, by_u, v, by_v, bend, n):
    """Force on a node: the negative gradient, u by_u + v by_v + bend n."""
    vector[at, 0] = -(u * by_u[0] + v * by_v[0] + bend * n[0])
    vector[at, 1] = -(u * by_u[1] + v * by_v[1] + bend * n[1])
    vector[at, 2] = -(u * by_u[2] + v * by_v[2] + bend * n[2])


@kernel(parallel=True)
def edge_stiffness(
    exact, start, nodes, weight, area, share, base, field, stretch, shear, bending, rest, poisson, energy, vector,
    block, slope,
):  # fmt: skip
    """Energy, forces and stiffness of all edge points.

    Args:
        exact: Hessian of the energy instead of the Gauss-Newton stiffness.
        start: First place of every point, edges first, and the end.
        nodes: Control point at every place.
        weight: Rows of the derivatives at every place (places, 5).
        area: Area of every edge (edges) [m2].
        share: Share of the membrane energy that the edges carry.
        base: Derivatives x_,1 and x_,2 of the undeformed cloth on the plate (members, 2, 3).
        field: Displacements of the control points (members, rows, 3) [m].
        stretch: (members or 1, points or 1, 6, 4) [N/m].
        shear: Shear x_,1 . x_,2 at rest (points).
        bending: (members or 1, edges or 1, 3, 5) [N m].
        rest: Curvatures at rest (members, edges, 3) [1/m].
        poisson: (members).
        energy: Receives (members, points) [J].
        vector: Receives forces (members, places, 3) [N].
        block: Receives what the point keeps (members, edges, EDGE_BLOCKS).
        slope: Receives what nodes keep (members, places of edges, NODE_SLOPES).
    """
    members, count = field.shape[0], area.shape[0]
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        stretches, bendings = member_table(stretch, member), member_table(bending, member)
        forces, kept, parts, d = vector[member], slope[member], np.empty((3, 5)), np.empty((3, 4))
        for p in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            first, end, size, own = start[p], start[p + 1], area[p], block[member, p]
            xu, xv = position_slopes(first, end, nodes, weight, base[member], field[member])
            s0, s1, s2 = second_slopes(first, end, nodes, weight, field[member])
            work, by_u, by_v = _membrane(xu, xv, member_table(stretches, p), shear[p], share * size, exact, own)
            n, length = normal(xu, xv)
            k0, c0 = curvature(s0, n, length)
            k1, c1 = curvature(s1, n, length)
            k2, c2 = curvature(s2, n, length)
            a0, b0 = bending_slopes(c0, xu, xv, n)
            a1, b1 = bending_slopes(c1, xu, xv, n)
            a2, b2 = bending_slopes(c2, xu, xv, n)
            k = (k0 - rest[member, p, 0], k1 - rest[member, p, 1], k2 - rest[member, p, 2])
            curvature_shares(squared_curvature(k), parts)
            plate_stiffness(member_table(bendings, p), poisson[member], parts, d)
            psi, moment = plate_bending(k, d)
            energy[member, p] = work + size * psi
            m0, m1, m2 = size * moment[0], size * moment[1], size * moment[2]
            t = plate_tangent(k, d, exact)
            t0, t1, t2, t3, t4, t5 = (
                size * t[0], size * t[1], size * t[2], size * t[3], size * t[4], size * t[5],
            )  # fmt: skip
            for i in range(3):
                for j in range(3):
                    own[_NN + 3 * i + j] = n[i] * n[j]
            if exact:
                c = combine(1.0, combine(m0, c0, m1, c1), m2, c2)
                _add_geometric(xu, xv, n, length, c, m0 * k0 + m1 * k1 + m2 * k2, own)
            _put_transposed(own)
            for at in range(first, end):
                u, v = weight[at, 0], weight[at, 1]
                g0 = u * a0 + v * b0 + weight[at, 2]
                g1 = u * a1 + v * b1 + weight[at, 3]
                g2 = u * a2 + v * b2 + weight[at, 4]
                kept[at, 0], kept[at, 1], kept[at, 2] = g0, g1, g2
                kept[at, 3] = t0 * g0 + t3 * g1 + t4 * g2
                kept[at, 4] = t3 * g0 + t1 * g1 + t5 * g2
                kept[at, 5] = t4 * g0 + t5 * g1 + t2 * g2
                kept[at, 6] = m0 * weight[at, 2] + m1 * weight[at, 3] + m2 * weight[at, 4]
                _put_force(forces, at, u, by_u, v, by_v, m0 * g0 + m1 * g1 + m2 * g2, n)


@kernel(parallel=True)
def vertex_stiffness(
    exact, start, nodes, weight, area, share, offset, base, field, stretch, shear, energy, vector, block
):
    """Energy, forces and stiffness of all vertex points; arguments as in `edge_stiffness`.

    Args:
        area: Area of every vertex outside the plate [m2].
        share: Share of the membrane energy that the vertices carry.
        offset: Number of edges, which come before the vertices in `start`, `stretch`, `shear` and `energy`.
        block: Receives what the point keeps (members, vertices, VERTEX_BLOCKS).
    """
    members, count = field.shape[0], area.shape[0]
    nowhere = (0.0, 0.0, 0.0)
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        stretches, forces = member_table(stretch, member), vector[member]
        for p in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            first, end = start[offset + p], start[offset + p + 1]
            xu, xv = position_slopes(first, end, nodes, weight, base[member], field[member])
            work, by_u, by_v = _membrane(
                xu,
                xv,
                member_table(stretches, offset + p),
                shear[offset + p],
                share * area[p],
                exact,
                block[member, p],
            )
            energy[member, offset + p] = work
            _put_transposed(block[member, p])
            for at in range(first, end):
                _put_force(forces, at, weight[at, 0], by_u, weight[at, 1], by_v, 0.0, nowhere)


@kernel(parallel=True)
def shell_curvatures(start, nodes, weight, base, field, found):
    """Curvatures (k11, k22, 2 k12) at all edge points.

    Args:
        start, nodes, weight, base, field: As in `edge_stiffness`.
        found: Receives (members, edges, 3) [1/m].
    """
    members, count = found.shape[0], found.shape[1]
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        for p in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            xu, xv = position_slopes(start[p], start[p + 1], nodes, weight, base[member], field[member])
            s0, s1, s2 = second_slopes(start[p], start[p + 1], nodes, weight, field[member])
            n, _ = normal(xu, xv)
            found[member, p, 0], found[member, p, 1], found[member, p, 2] = dot(n, s0), dot(n, s1), dot(n, s2)


@kernel(parallel=True)
def gather_stiffness(
    exact, scale, row_start, places, point, offset, term_start, other, slots, indptr, diagonal_slot, vertex, diagonal,
    weight, edge_block, vertex_block, slope, out,
):  # fmt: skip
    """out = scale * stiffness + diagonal, row by row, in the slots that the linear solver reads.

    Args:
        exact, scale: Whether the points were evaluated for their Hessian; factor of the stiffness.
        row_start, places: Places that hold every row's control point.
        point: Point of every place, edges first.
        offset: Number of edges.
        term_start, other, slots: For every entry of `places` the places of its point's nodes whose column the solver
            reads in this row, and the slots.
        indptr: First slot of every row, and the end.
        diagonal_slot: Slot of every diagonal block.
        vertex: Vertex of every row.
        diagonal: Added to the diagonal (members, vertices).
        weight: Rows of the derivatives at every place (places, 5).
        edge_block, vertex_block, slope: From `edge_stiffness` and `vertex_stiffness`.
        out: Receives (members, slots of the pattern, 9); slots that are not read receive anything.
    """
    members, count = out.shape[0], vertex.shape[0]
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        own, bent = out[member], slope[member]
        sums = np.empty((3, 9))
        to, by_u, by_v, flat = own.ctypes.data, sums[0].ctypes.data, sums[1].ctypes.data, sums[2].ctypes.data
        for row in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            own[indptr[row] : indptr[row + 1]] = 0.0
            for entry in range(row_start[row], row_start[row + 1]):
                at = places[entry]
                p, w = point[at], (scale * weight[at, 0], scale * weight[at, 1])
                block = vertex_block[member, p - offset] if p >= offset else edge_block[member, p]
                kept = block.ctypes.data
                put_blocks(by_u, w, (kept + _BYTES * _K11, kept + _BYTES * _K21))
                put_blocks(by_v, w, (kept + _BYTES * _K12, kept + _BYTES * _K22))
                first, end = term_start[entry], term_start[entry + 1]
                if p >= offset:
                    for term in range(first, end):
                        i = other[term]
                        add_blocks(to + BLOCK_BYTES * slots[term], (weight[i, 0], weight[i, 1]), (by_u, by_v))
                    continue
                n, h0, h1, h2 = kept + _BYTES * _NN, scale * bent[at, 3], scale * bent[at, 4], scale * bent[at, 5]
                if exact:
                    push = (scale * bent[at, 6],)
                    add_blocks(by_u, push, (kept + _BYTES * _PHI_1_T,))
                    add_blocks(by_v, push, (kept + _BYTES * _PHI_2_T,))
                    put_blocks(flat, w, (kept + _BYTES * _PHI_1, kept + _BYTES * _PHI_2))
                    for term in range(first, end):
                        i = other[term]
                        h = h0 * bent[i, 0] + h1 * bent[i, 1] + h2 * bent[i, 2]
                        factors = (weight[i, 0], weight[i, 1], h, bent[i, 6])
                        add_blocks(to + BLOCK_BYTES * slots[term], factors, (by_u, by_v, n, flat))
                else:
                    for term in range(first, end):
                        i = other[term]
                        h = h0 * bent[i, 0] + h1 * bent[i, 1] + h2 * bent[i, 2]
                        factors = (weight[i, 0], weight[i, 1], h)
                        add_blocks(to + BLOCK_BYTES * slots[term], factors, (by_u, by_v, n))
            add, slot = diagonal[member, vertex[row]], diagonal_slot[row]
            own[slot, 0] += add
            own[slot, 4] += add
            own[slot, 8] += add


@kernel(parallel=True)
def gather_vectors(start, terms, vectors, out):
    """Sums the points' vectors at every control point.

    Args:
        start, terms: Places that belong to every row.
        vectors: (members, places, 3).
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
