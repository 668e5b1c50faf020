"""The radius-angle profile of a drape and the numbers read from it: drape coefficient, folds, spectrum.

A silhouette of a Cusick drape is star-shaped about the plate's centre, so the outermost radius at each angle
describes it. Angles run counter-clockwise from +x (warp) with the image's y axis up.

References:
    ISO 9073-9 (drape coefficient: share of the annulus between plate and flat cloth that the shadow covers).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy import ndarray

from cusick_bench.datasets.errors import DataError
from cusick_bench.sim.cloth.folds import FOLD_HARMONICS, FOLD_PROMINENCE, ring_folds
from cusick_bench.sim.constants import CLOTH_RADIUS, IMAGE_CENTRE, PIXELS_PER_METRE, PLATE_RADIUS

if TYPE_CHECKING:
    import torch


PROFILE_ANGLES = 720
_ROUNDING = 1e-3  # by which coverage may leave [0, 1], as sums in short floats do


@dataclass(frozen=True)
class Profile:
    """Outermost radius of a drape at equidistant angles.

    Attributes:
        radii: Radii [m] at `angles`, counter-clockwise from +x.
    """

    radii: Float[ndarray, " angles"]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Profile) and np.array_equal(self.radii, other.radii)

    @cached_property
    def angles(self) -> Float[ndarray, " angles"]:
        """Angles [rad], counter-clockwise from +x (warp)."""
        return _angles(len(self.radii))

    def rotated(self, degrees: int) -> Profile:
        """The profile of the drape turned counter-clockwise about z, to the nearest angle step.

        Args:
            degrees: Angle of the turn [degrees].

        Returns:
            The turned profile.
        """
        return Profile(np.roll(self.radii, round(degrees * len(self.radii) / 360)))

    def rms(self, other: Profile) -> float:
        """Root-mean-square difference of the radii.

        Args:
            other: A profile at the same angles.

        Returns:
            The difference [m].
        """
        return float(np.sqrt(np.mean((self.radii - other.radii) ** 2)))


def _angles(count: int) -> Float[ndarray, " angles"]:
    return np.arange(count) * (2 * np.pi / count)


@lru_cache(maxsize=8)
def _directions(count: int, image_y: str) -> tuple[ndarray, ndarray]:
    """Step in column and row per pixel along each ray."""
    angles = _angles(count)
    return np.cos(angles), (-np.sin(angles) if image_y == "up" else np.sin(angles))


def _bilinear(image: ndarray, column: ndarray, row: ndarray) -> ndarray:
    """Values between pixels of an image that is padded by two rows and columns of background."""
    height, width = image.shape
    column = np.clip(column + 2, 0, width - 1.001)
    row = np.clip(row + 2, 0, height - 1.001)
    left, top = column.astype(np.int32), row.astype(np.int32)
    right_share, low_share = column - left, row - top
    flat, start = image.ravel(), top * width + left
    upper = flat[start] * (1 - right_share) + flat[start + 1] * right_share
    lower = flat[start + width] * (1 - right_share) + flat[start + width + 1] * right_share
    return upper * (1 - low_share) + lower * low_share


def profile_from_image(
    image: Float[ndarray, "height width"] | Float[torch.Tensor, "height width"] | UInt8[ndarray, "height width"],
    *,
    pixels_per_metre: float = PIXELS_PER_METRE,
    centre: tuple[float, float] = IMAGE_CENTRE,
    image_y: str = "up",
    angles: int = PROFILE_ANGLES,
) -> Profile:
    """Radius of the outermost crossing of 0.5 along rays from the plate's centre, to a fraction of a pixel.

    Args:
        image: Coverage in [0, 1], cloth = 1; bytes are read as 0..255.
        pixels_per_metre: Scale of the parallel projection [px/m].
        centre: Column and row of the plate's axis [px].
        image_y: "up" if y points to the first row, "down" otherwise.
        angles: Number of rays.

    Returns:
        The profile; 0 where a ray meets no cloth.

    Raises:
        DataError: No single image, levels beyond [0, 1], or a scale, centre, direction or number of rays that is none.
    """
    pixels = _as_array(image)
    _check_scale(pixels_per_metre)
    if image_y not in ("up", "down"):
        raise DataError(f"image_y must be up or down, got {image_y!r}", remedy="say where y points in the image")
    if not np.isfinite(centre).all():
        raise DataError(f"centre must be a finite column and row, got {centre}", remedy="give the plate's axis in px")
    if angles < 1:
        raise DataError(f"a profile needs at least 1 ray, got {angles}", remedy=f"{PROFILE_ANGLES} are usual")
    padded = np.pad(pixels, 2)
    step_column, step_row = _directions(angles, image_y)

    def along(radii: ndarray) -> ndarray:  # (angles, n) radii [px] -> coverage
        return _bilinear(padded, centre[0] + step_column[:, None] * radii, centre[1] + step_row[:, None] * radii)

    rows, columns = np.ogrid[: padded.shape[0], : padded.shape[1]]
    distance = np.hypot(columns - 2 - centre[0], rows - 2 - centre[1])
    cloth = padded >= 0.5
    if not cloth.any():
        return Profile(np.zeros(angles))
    # Between the nearest background pixel and the farthest cloth pixel lies every crossing.
    coarse = np.arange(max(0, int(distance[~cloth].min()) - 2), int(distance[cloth].max()) + 3)
    inside = along(coarse[None, :]) >= 0.5
    last = coarse[inside.shape[1] - 1 - np.argmax(inside[:, ::-1], axis=1)]
    fine = last[:, None] + np.linspace(0, 1, 5)
    values = along(fine)
    cell = np.minimum(4 - np.argmax(values[:, ::-1] >= 0.5, axis=1), 3)
    rays = np.arange(angles)
    here, beyond = values[rays, cell], values[rays, cell + 1]
    radii = fine[rays, cell] + 0.25 * (here - 0.5) / np.maximum(here - beyond, 1e-12)
    return Profile(np.where(inside.any(axis=1), radii, 0.0) / pixels_per_metre)


def profile_from_mesh(
    vertices: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"], *, angles: int = PROFILE_ANGLES
) -> Profile:
    """Outermost radius of a mesh seen along z (parallel projection): the largest over all its edges.

    Args:
        vertices: Positions [m], z along the plate's axis.
        faces: Vertex indices of each triangle.
        angles: Number of angles.

    Returns:
        The profile.
    """
    faces = faces.astype(np.int64)  # squares of numbers of vertices are more than 32 bits hold
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    keys = np.unique(edges[:, 0] * len(vertices) + edges[:, 1])
    start, end = vertices[keys // len(vertices), :2], vertices[keys % len(vertices), :2]
    cross = start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]
    first = np.arctan2(start[:, 1], start[:, 0])
    turn = np.arctan2(cross, (start * end).sum(axis=1))  # signed angle under which the axis sees the edge
    step = 2 * np.pi / angles
    low = np.ceil(np.minimum(first, first + turn) / step - 1e-9).astype(np.int64)
    high = np.floor(np.maximum(first, first + turn) / step + 1e-9).astype(np.int64)
    count = np.maximum(high - low + 1, 0)
    edge = np.repeat(np.arange(len(keys)), count)
    ray = low[edge] + np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    along = end[edge] - start[edge]
    across = np.cos(ray * step) * along[:, 1] - np.sin(ray * step) * along[:, 0]
    parallel = np.abs(across) < 1e-15  # an edge along its ray: its neighbours have the same end points
    radius = np.where(parallel, 0.0, cross[edge] / np.where(parallel, 1.0, across))
    radii = np.zeros(angles)
    np.maximum.at(radii, ray % angles, radius)
    return Profile(radii)


def drape_coefficient(
    image: Float[ndarray, "height width"] | Float[torch.Tensor, "height width"] | UInt8[ndarray, "height width"],
    *,
    pixels_per_metre: float = PIXELS_PER_METRE,
    cloth_radius: float = CLOTH_RADIUS,
    plate_radius: float = PLATE_RADIUS,
) -> float:
    """Drape coefficient of a silhouette: (A - pi r^2) / (pi (R^2 - r^2)), with A its grey-weighted area.

    Args:
        image: Coverage in [0, 1], cloth = 1; bytes are read as 0..255.
        pixels_per_metre: Scale [px/m].
        cloth_radius: R, radius of the flat cloth [m].
        plate_radius: r, radius of the plate [m].

    Returns:
        0 for a cloth that hangs vertically, 1 for one that stays flat.

    Raises:
        DataError: No single image, levels beyond [0, 1], no scale > 0, or radii out of order.
    """
    _check_scale(pixels_per_metre)
    if not 0 <= plate_radius < cloth_radius < np.inf:
        what = f"radii must satisfy 0 <= plate < cloth, got plate {plate_radius} m and cloth {cloth_radius} m"
        raise DataError(what, remedy="give radii, not diameters, in metres")
    area = float(_as_array(image).sum()) / pixels_per_metre**2
    return (area - np.pi * plate_radius**2) / (np.pi * (cloth_radius**2 - plate_radius**2))


def fold_count(profile: Profile, *, prominence: float = FOLD_PROMINENCE, harmonics: int = FOLD_HARMONICS) -> int:
    """Counts folds: peaks of the low harmonics of a profile that stand out.

    Args:
        profile: The profile.
        prominence: By how much a fold stands out at least [m].
        harmonics: Highest harmonic that is kept.

    Returns:
        Number of folds.

    Raises:
        DataError: No radii, or radii that are not finite.
    """
    if not (len(profile.radii) and np.isfinite(profile.radii).all()):
        raise DataError("a profile must have finite radii to count its folds", remedy="check the silhouette behind it")
    return ring_folds(profile.radii, prominence=prominence, harmonics=harmonics)


def amplitude_spectrum(profile: Profile, *, modes: int = FOLD_HARMONICS) -> Float[ndarray, " modes"]:
    """Amplitudes c_m of the harmonics c_m cos(m angle - phase) of a profile.

    Args:
        profile: The profile.
        modes: Highest order m.

    Returns:
        Mean radius (m = 0), then the amplitudes of m = 1 to `modes` [m].
    """
    count = len(profile.radii)
    harmonics = np.abs(np.fft.rfft(profile.radii)) / count
    harmonics[1 : (count + 1) // 2] *= 2  # the others stand once in the transform: the mean, and order count / 2
    return harmonics[: modes + 1]


def _check_scale(pixels_per_metre: float) -> None:
    if not 0 < pixels_per_metre < np.inf:
        what = f"pixels_per_metre must be > 0 and finite, got {pixels_per_metre}"
        raise DataError(what, remedy="give the scale in the plane of the plate")


def _as_array(image: ndarray | torch.Tensor) -> Float[ndarray, "height width"]:
    pixels = image if isinstance(image, ndarray) else image.detach().cpu().numpy()
    share = np.asarray(pixels, dtype=np.float64) / (255 if pixels.dtype == np.uint8 else 1)
    if share.ndim != 2:
        what = f"an image must have a height and a width, got the shape {share.shape}"
        raise DataError(what, remedy="give the images of a batch one by one")
    if share.size and not (share.min() >= -_ROUNDING and share.max() <= 1 + _ROUNDING):
        what = f"coverage must be in [0, 1], got {share.min():g} to {share.max():g}"
        raise DataError(what, remedy="divide levels by the largest that they can have; only bytes are read as 0 to 255")
    return share
