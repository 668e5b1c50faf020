"""Numbers that describe a hanging skirt, and how much draws of the same cloth differ.

A skirt is seen from above, with its waist closed, as the shadow of a Cusick test is; its drape coefficient is the
share of the ring between waist and flat cloth (radius waist + length) that the shadow covers. Folds are counted along
the hem, as peaks of its distance from the axis over the arc length of the pattern: the hem may fold back on itself,
so that its shadow would hide some.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.datasets.profile import Profile, fold_count
from cusick_bench.garment.skirt import Skirt
from cusick_bench.sim.render.camera import ParallelCamera
from cusick_bench.sim.render.silhouette import render

FOLD_PROMINENCE = 0.01  # [m] least prominence of a fold of the hem
IMAGE_SIZE = 512  # [px]
_MARGIN = 1.05  # picture over flat cloth
_ANGLES = 720
_HARMONICS = 60


@dataclass(frozen=True)
class SkirtMeasures:
    """One hanging skirt.

    Attributes:
        hem_radius_m: Mean distance of the hem from the axis.
        hem_depth_m: Mean distance of the hem below the waist.
        folds: Folds of the hem.
        fold_amplitude_m: Root-mean-square deviation of the hem's distance from its mean.
        projected_area_m2: Area of the shadow from above, waist included.
        drape_coefficient: Share of the ring between waist and flat cloth in the shadow.
    """

    hem_radius_m: float
    hem_depth_m: float
    folds: int
    fold_amplitude_m: float
    projected_area_m2: float
    drape_coefficient: float


def closed_waist(skirt: Skirt) -> Int[ndarray, "faces_and_cap 3"]:
    """The skirt's faces and a fan that closes the waist.

    Args:
        skirt: The pattern.

    Returns:
        Vertex indices of all triangles.
    """
    held = np.flatnonzero(skirt.waist)
    ring = held[np.argsort(np.arctan2(skirt.start[held, 1], skirt.start[held, 0]))]
    fan = np.column_stack([np.full(len(ring) - 2, ring[0]), ring[1:-1], ring[2:]])
    return np.concatenate([skirt.mesh.faces, fan])


def pixels_per_metre(skirt: Skirt) -> float:
    """Scale at which the flat skirt fills the picture.

    Args:
        skirt: The pattern.

    Returns:
        The scale [px/m].
    """
    return IMAGE_SIZE / (2 * _MARGIN * (skirt.size.waist + skirt.size.length))


def _camera(skirt: Skirt) -> ParallelCamera:
    return ParallelCamera(pixels_per_metre(skirt), ((IMAGE_SIZE - 1) / 2, (IMAGE_SIZE - 1) / 2))


def seen_from_above(skirt: Skirt, positions: Float[ndarray, "vertices 3"]) -> Float[ndarray, "size size"]:
    """Silhouette from above, front below, waist closed.

    Args:
        skirt: The pattern.
        positions: Positions of its vertices [m].

    Returns:
        Coverage of each pixel, cloth = 1.
    """
    return render(torch.from_numpy(positions), closed_waist(skirt), _camera(skirt), size=IMAGE_SIZE).numpy()


def seen_from_front(skirt: Skirt, positions: Float[ndarray, "vertices 3"]) -> Float[ndarray, "size size"]:
    """Silhouette from the front, to the scale of that from above, half the length below the waist in the middle.

    Args:
        skirt: The pattern.
        positions: Positions of its vertices [m].

    Returns:
        Coverage of each pixel, cloth = 1.
    """
    turned = np.column_stack([positions[:, 0], positions[:, 2] + skirt.size.length / 2, -positions[:, 1]])
    return render(torch.from_numpy(turned), skirt.mesh.faces, _camera(skirt), size=IMAGE_SIZE).numpy()


def measure(skirt: Skirt, positions: Float[ndarray, "vertices 3"]) -> SkirtMeasures:
    """Measures a hanging skirt whose waist lies in the plane z = 0 about the z axis.

    Args:
        skirt: The pattern.
        positions: Positions of its vertices [m].

    Returns:
        The measures.
    """
    hem = positions[skirt.hem]
    radius = np.hypot(hem[:, 0], hem[:, 1])
    places = np.linspace(0, len(radius), _ANGLES, endpoint=False)  # the hem's vertices are evenly spaced
    along = np.interp(places, np.arange(len(radius) + 1), np.append(radius, radius[0]))
    area = float(seen_from_above(skirt, positions).sum()) / pixels_per_metre(skirt) ** 2
    waist, flat = np.pi * skirt.size.waist**2, np.pi * (skirt.size.waist + skirt.size.length) ** 2
    return SkirtMeasures(
        hem_radius_m=float(radius.mean()),
        hem_depth_m=float(-hem[:, 2].mean()),
        folds=fold_count(Profile(along), prominence=FOLD_PROMINENCE, harmonics=_HARMONICS),
        fold_amplitude_m=float(radius.std()),
        projected_area_m2=area,
        drape_coefficient=(area - waist) / (flat - waist),
    )


def vertex_spread(positions: Float[ndarray, "draws vertices 3"]) -> Float[ndarray, "vertices"]:
    """Standard deviation of every vertex's position between draws.

    Args:
        positions: Positions in each draw [m].

    Returns:
        The standard deviation of each vertex [m]; NaN of a single draw.
    """
    draws = len(positions)
    if draws < 2:
        return np.full(positions.shape[1], np.nan)
    return np.sqrt(((positions - positions.mean(0)) ** 2).sum((0, 2)) / (draws - 1))


def spread(positions: Float[ndarray, "draws vertices 3"], measures: list[SkirtMeasures]) -> dict[str, Any]:
    """How much draws of the same cloth differ.

    Args:
        positions: Positions in each draw [m].
        measures: Measures of each draw.

    Returns:
        `mean` over the draws and `sd` between them (NaN of a single draw) of each measure, and root mean square
        and maximum of the vertices' standard deviations [m].
    """
    columns = {name: np.array([asdict(each)[name] for each in measures], dtype=float) for name in asdict(measures[0])}
    between = {name: float(values.std(ddof=1)) if len(values) > 1 else float("nan") for name, values in columns.items()}
    moved = vertex_spread(positions)
    return {
        "mean": {name: float(values.mean()) for name, values in columns.items()},
        "sd": between,
        "vertex_sd_rms_m": float(np.sqrt((moved**2).mean())),
        "vertex_sd_max_m": float(moved.max()),
    }
