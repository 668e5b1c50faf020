"""Sums element results into the global matrix and into vertices: gathers in a fixed order, so bitwise repeatable."""

from cusick_bench.sim.kernel_cache import numba
from cusick_bench.sim.laws.vectors import CHUNKS, kernel


@kernel()
def _add(total, block, transposed, scale):
    if transposed:
        return (
            total[0] + scale * block[0], total[1] + scale * block[3], total[2] + scale * block[6],
            total[3] + scale * block[1], total[4] + scale * block[4], total[5] + scale * block[7],
            total[6] + scale * block[2], total[7] + scale * block[5], total[8] + scale * block[8],
        )  # fmt: skip
    return (
        total[0] + scale * block[0], total[1] + scale * block[1], total[2] + scale * block[2],
        total[3] + scale * block[3], total[4] + scale * block[4], total[5] + scale * block[5],
        total[6] + scale * block[6], total[7] + scale * block[7], total[8] + scale * block[8],
    )  # fmt: skip


@kernel()
def _add_outer(total, factor, g, first, second):
    a0, a1, a2 = factor * g[first], factor * g[first + 1], factor * g[first + 2]
    b0, b1, b2 = g[second], g[second + 1], g[second + 2]
    return (
        total[0] + a0 * b0, total[1] + a0 * b1, total[2] + a0 * b2,
        total[3] + a1 * b0, total[4] + a1 * b1, total[5] + a1 * b2,
        total[6] + a2 * b0, total[7] + a2 * b1, total[8] + a2 * b2,
    )  # fmt: skip


@kernel(parallel=True)
def assemble_blocks(
    slots, vertex, face_start, face_terms, hinge_start, hinge_terms, exact, scale, diagonal, face_blocks, gradient,
    stiffness, hinge_blocks, out,
):  # fmt: skip
    """out = scale * (sum of element blocks) + diagonal, in the slots that the linear solver reads.

    Args:
        slots, vertex, face_start, face_terms, hinge_start, hinge_terms: From `Assembly`.
        exact: Take hinges from `hinge_blocks`; otherwise they are stiffness * gradient gradient^T.
        scale: Factor of all element blocks.
        diagonal: Added to the diagonal (members, vertices).
        face_blocks, gradient, stiffness, hinge_blocks: From the element kernels.
        out: Receives (members, slots of the pattern, 3, 3); other slots stay.
    """
    members, count = out.shape[0], slots.shape[0]
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        for place in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            total = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            for at in range(face_start[place], face_start[place + 1]):
                term = face_terms[at]
                total = _add(total, face_blocks[member, term >> 4, (term >> 1) & 7], term & 1, 1.0)
            for at in range(hinge_start[place], hinge_start[place + 1]):
                term = hinge_terms[at]
                hinge = term >> 10
                if exact:
                    total = _add(total, hinge_blocks[member, hinge, (term >> 1) & 15], term & 1, 1.0)
                else:
                    first, second = 3 * ((term >> 7) & 3), 3 * ((term >> 5) & 3)
                    total = _add_outer(total, stiffness[member, hinge], gradient[member, hinge], first, second)
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
def gather_vertices(
    chosen, face_start, face_corners, hinge_start, hinge_corners, face_vector, hinge_vector, factor, out
):
    """Sums corner vectors of faces and hinges into vertices.

    Args:
        chosen: Vertices to sum up.
        face_start, face_corners, hinge_start, hinge_corners: From `Assembly`.
        face_vector: (members, faces, 3, 3).
        hinge_vector: (members, hinges, 12).
        factor: Times each hinge's vector (members, hinges).
        out: Receives (members, vertices, 3); other vertices stay.
    """
    members, count = out.shape[0], chosen.shape[0]
    for job in numba.prange(members * CHUNKS):
        member, chunk = job // CHUNKS, job % CHUNKS
        for place in range(chunk * count // CHUNKS, (chunk + 1) * count // CHUNKS):
            i = chosen[place]
            x, y, z = 0.0, 0.0, 0.0
            for at in range(face_start[i], face_start[i + 1]):
                source = face_corners[at]
                vector = face_vector[member, source // 3, source % 3]
                x, y, z = x + vector[0], y + vector[1], z + vector[2]
            for at in range(hinge_start[i], hinge_start[i + 1]):
                hinge, corner = hinge_corners[at] >> 2, 3 * (hinge_corners[at] & 3)
                times, vector = factor[member, hinge], hinge_vector[member, hinge]
                x += times * vector[corner]
                y += times * vector[corner + 1]
                z += times * vector[corner + 2]
            out[member, i, 0], out[member, i, 1], out[member, i, 2] = x, y, z
