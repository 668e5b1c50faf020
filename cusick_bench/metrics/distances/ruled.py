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

from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.metrics.errors import MetricError


def ruled_surface(
    radii: Float[ndarray, " angles"],
    *,
    slant: float = RELEASE.overhang_m,
    plate_radius: float = RELEASE.plate_radius_m,
    strips: int = 1,
) -> trimesh.Trimesh:
    """Builds the ruled surface over a radius profile.

    Args:
        radii: Rim radii at equidistant angles over the full turn, counter-clockwise from +x [m].
        slant: Length of the generators from plate edge to rim [m]: the cloth's radius less the plate's; the release's
            meshes have 0.059 to 0.064.
        plate_radius: Plate radius [m].
        strips: Strips of triangles from plate edge to rim; more make no other surface, but smoother pictures.

    Returns:
        A mesh of one flat fan (the plate part) and strips. A rim further out than the slant length allows
        stays at the plate's height; one that lies under the plate hangs from its edge.

    Raises:
        MetricError: Fewer than 3 radii, radii that are not finite, or no strip.
    """
    count = len(radii)
    if count < 3 or not np.isfinite(radii).all():
        raise MetricError(f"a ruled surface needs at least 3 finite radii, got {count}; check the silhouette")
    if strips < 1:
        raise MetricError(f"a ruled surface needs at least 1 strip from plate to rim, got {strips}")
    radii = np.maximum(radii, plate_radius)
    angle = 2 * np.pi * np.arange(count) / count
    unit = np.column_stack([np.cos(angle), np.sin(angle)])
    drop = np.sqrt(np.maximum(slant**2 - (radii - plate_radius) ** 2, 0.0))
    edge = np.column_stack([plate_radius * unit, np.zeros(count)])
    rim = np.column_stack([radii[:, None] * unit, -drop])
    rings = [edge + share * (rim - edge) for share in np.linspace(0, 1, strips + 1)]
    here, following = np.arange(count), (np.arange(count) + 1) % count
    faces = [np.column_stack([np.zeros(count, dtype=np.int64), 1 + here, 1 + following])]
    for start in range(1, 1 + strips * count, count):
        inner, inner_next, outer, outer_next = (
            start + offset for offset in (here, following, count + here, count + following)
        )
        faces.append(np.column_stack([inner, outer, outer_next]))
        faces.append(np.column_stack([inner, outer_next, inner_next]))
    return trimesh.Trimesh(np.vstack([np.zeros((1, 3)), *rings]), np.concatenate(faces), process=False)
