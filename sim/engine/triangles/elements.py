"""Constants of every face and hinge of a mesh.

Faces: with D = Dm^-1 the inverse of the material edge matrix, the deformation gradient columns are
x_u = sum_a s_u[a] x_a and x_v = sum_a s_v[a] x_a. Hinges: material edge length l, sum A1 + A2 of the adjacent face
areas, and the direction of the edge in the material frame, which selects between the warp, bias and weft samples. At a
seam the edge lies in two panels: its length and direction are the means of both, and the seam itself adds no stiffness.

A hinge on a clamp has both ends of its edge and one of its two faces held. The held face cannot bend, so the angle is
taken up by the free face alone: over half the width, at twice the curvature. With both areas (A1 + A2, as in the
published program) such a hinge is half as stiff as the cloth, and the cloth leaves its plate at a slope: on a mesh of
1205 vertices a stiff cloth then hangs a quarter too low; with the area of the free face alone it is within 3 % of the
exact plate.

References:
    Volino, Magnenat-Thalmann, Faure. A simple approach to nonlinear tensile stiffness for accurate cloth simulation.
    ACM Transactions on Graphics 28(4), 2009: s_u and s_v, Section 3.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Elements:
    """Per-element constants, contiguous float64 and int64 arrays ready for the kernels.

    Attributes:
        faces: Vertex indices of the faces.
        face_u: s_u, weights of the vertices in x_u [1/m].
        face_v: s_v, weights of the vertices in x_v [1/m].
        face_area: Material areas [m2].
        hinges: Vertex indices (edge start, edge end, opposite in face 0, opposite in face 1).
        hinge_scale: l / A [1/m], A the area that bends: A1 + A2, or the free face of a clamp; dihedral angle times this
            is curvature.
        hinge_weight: l^2 / A [1]; bending stiffness times this is hinge stiffness.
        hinge_share: A / (A1 + A2), 1 but on a clamp; a stress-free angle of the whole hinge times this is that of the
            part that bends.
        direction_low: Lower of the two direction samples between which the hinge lies (0 warp, 1 bias).
        direction_fraction: Weight of the upper one, in [0, 1].
    """

    faces: Int[ndarray, "faces 3"]
    face_u: Float[ndarray, "faces 3"]
    face_v: Float[ndarray, "faces 3"]
    face_area: Float[ndarray, "faces"]
    hinges: Int[ndarray, "hinges 4"]
    hinge_scale: Float[ndarray, "hinges"]
    hinge_weight: Float[ndarray, "hinges"]
    hinge_share: Float[ndarray, "hinges"]
    direction_low: Int[ndarray, "hinges"]
    direction_fraction: Float[ndarray, "hinges"]


def elements_of(mesh: Mesh, clamped: Bool[ndarray, "vertices"] | None = None) -> Elements:
    """Computes the element constants of a mesh from its material coordinates.

    Args:
        mesh: The cloth.
        clamped: Vertices that are held, where of the hinges between held and free cloth the free half alone is to
            bend; by default every hinge bends in full.

    Returns:
        Constants of its faces and hinges.
    """
    corner = mesh.corners
    edge_matrix = np.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]], axis=2)
    inverse = np.linalg.inv(edge_matrix)  # D = Dm^-1
    face_u = np.stack([-(inverse[:, 0, 0] + inverse[:, 1, 0]), inverse[:, 0, 0], inverse[:, 1, 0]], axis=1)
    face_v = np.stack([-(inverse[:, 0, 1] + inverse[:, 1, 1]), inverse[:, 0, 1], inverse[:, 1, 1]], axis=1)

    corners = mesh.hinge_corners
    along, beside = (corners[:, :, k] - corners[:, :, 0] for k in (1, 2))
    length = np.hypot(along[..., 0], along[..., 1]).mean(1)
    sides = 0.5 * np.abs(_cross(along, beside))
    whole = sides.sum(1)
    area = whole if clamped is None else _bending_area(sides, clamped[mesh.hinges])
    direction = np.abs(4 * np.arctan2(along[..., 1], along[..., 0]) / np.pi)
    direction = np.where(direction > 2, 4 - direction, direction).mean(1)  # reflected into warp 0 .. weft 2
    low = np.minimum(direction.astype(np.int64), 1)
    return Elements(
        faces=mesh.faces,
        face_u=np.ascontiguousarray(face_u),
        face_v=np.ascontiguousarray(face_v),
        face_area=mesh.areas,
        hinges=mesh.hinges,
        hinge_scale=length / area,
        hinge_weight=length**2 / area,
        hinge_share=area / whole,
        direction_low=low,
        direction_fraction=direction - low,
    )


def _bending_area(sides: Float[ndarray, "hinges 2"], held: Bool[ndarray, "hinges 4"]) -> Float[ndarray, "hinges"]:
    """Area of the faces beside each hinge, without the held one where the hinge lies on the edge of held cloth."""
    start, end, first, second = held.T
    on_clamp = start & end & (first != second)
    return np.where(on_clamp, np.where(first, sides[:, 1], sides[:, 0]), sides.sum(1))


def _cross(first: ndarray, second: ndarray) -> ndarray:
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
