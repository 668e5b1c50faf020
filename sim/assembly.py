"""Sums element blocks into the global matrix and corner vectors into vertices: gathers, so bitwise repeatable."""

import numba


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
    """Sums corner values (3-vectors) of faces and hinges into vertices; corners 3 f + a, then 4 h + a."""
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
