"""The true outline of a drawn drape: how far it reaches at every angle, seen by an ideal camera on the plate's axis."""

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

_MARGIN = 1e-9  # of an edge, by which rays through a vertex may miss it


def apparent_radii(
    vertices: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"], height: float, angles: Float[ndarray, " n"]
) -> Float[ndarray, " n"]:
    """Outermost radius at each angle of a mesh that an eye above the plate's middle sees.

    Args:
        vertices: Positions [m].
        faces: Vertex indices of each triangle.
        height: Height of the eye above the plate [m]; infinite for a parallel view.
        angles: Where to measure [rad].

    Returns:
        Radii at the scale of the plate's plane [m].
    """
    scale = 1 / (1 - vertices[:, 2:] / height)
    seen = vertices[:, :2] * scale
    edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)
    start, step = seen[edges[:, 0]], seen[edges[:, 1]] - seen[edges[:, 0]]
    radii = np.zeros(len(angles))
    for place, angle in enumerate(angles):
        across = np.array([-np.sin(angle), np.cos(angle)])
        along = np.array([np.cos(angle), np.sin(angle)])
        offset, change = start @ across, step @ across
        with np.errstate(divide="ignore", invalid="ignore"):
            part = -offset / change
        hit = (part >= -_MARGIN) & (part <= 1 + _MARGIN)
        reach = start[hit] @ along + part[hit] * (step[hit] @ along)
        radii[place] = reach.max(initial=0.0)
    return radii
