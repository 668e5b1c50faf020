"""Surfaces built from a silhouette alone, as the "ground-truth" meshes of the public release are built.

The release's meshes are no scans: the plate part is flat, and straight generators of fixed slant length run
from the plate edge outwards and down to the rim, whose radius is read off the silhouette:

    z(theta) = -sqrt(slant^2 - (r(theta) - r_plate)^2)

So a Hausdorff distance to them is a metric of silhouettes with an assumption. Building the same surface from
any silhouette gives predictors without a mesh (a disc, a copied image, a mean image) their Hausdorff distance
too.
"""

import numpy as np
import trimesh
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.metrics.errors import MetricError
from cusick_bench.sim.mesh import PLATE_RADIUS

SLANT = 0.06  # [m], cloth radius minus plate radius; the release's meshes have 0.059 to 0.064


def ruled_surface(
    radii: Float[ndarray, " angles"], *, slant: float = SLANT, plate_radius: float = PLATE_RADIUS
) -> trimesh.Trimesh:
    """Builds the ruled surface over a radius profile.

    Args:
        radii: Rim radii at equidistant angles over the full turn, counter-clockwise from +x [m].
        slant: Length of the generators from plate edge to rim [m].
        plate_radius: Plate radius [m].

    Returns:
        A mesh of one flat fan (the plate part) and one strip. A rim further out than the slant length allows
        stays at the plate's height; one that lies under the plate hangs from its edge.

    Raises:
        MetricError: Fewer than 3 radii, or radii that are not finite.
    """
    count = len(radii)
    if count < 3 or not np.isfinite(radii).all():
        raise MetricError(f"a ruled surface needs at least 3 finite radii, got {count}; check the silhouette")
    radii = np.maximum(radii, plate_radius)
    angle = 2 * np.pi * np.arange(count) / count
    unit = np.column_stack([np.cos(angle), np.sin(angle)])
    drop = np.sqrt(np.maximum(slant**2 - (radii - plate_radius) ** 2, 0.0))
    vertices = np.zeros((2 * count + 1, 3))
    vertices[1 : count + 1, :2] = plate_radius * unit
    vertices[count + 1 :, :2] = radii[:, None] * unit
    vertices[count + 1 :, 2] = -drop
    edge = 1 + np.arange(count)
    following = 1 + (np.arange(count) + 1) % count
    fan = np.column_stack([np.zeros(count, dtype=np.int64), edge, following])
    strip = np.concatenate(
        [
            np.column_stack([edge, edge + count, following + count]),
            np.column_stack([edge, following + count, following]),
        ]
    )
    return trimesh.Trimesh(vertices, np.concatenate([fan, strip]), process=False)
