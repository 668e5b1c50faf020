"""Pixel metrics of silhouettes: mean squared error and intersection over union, for all pairs of two stacks.

A mean over pixels depends on how much background an image shows. The mean squared error here is the squared difference,
integrated over the plane of the plate, divided by the area that an image of the public release shows of a cloth of this
size: (256 px / 723 px/m)^2 = (354 mm)^2, times (cloth radius / 0.15 m)^2. That is the plain mean over pixels for the
release. For the same drapes it is the same number at any field of view, and nearly at any resolution: a pixel that a
rim crosses is partly covered, so that an area in which two images differ counts as a sixth of a pixel less wide along
each rim. Between discs of 0.12 and 0.1 m radius the release's pixels give 2.3 % less than the plane would, and pixels
of half the size 1.2 % less.

Images hold the cloth's coverage: 1 = cloth, 0 = background; bytes are read as 0..255. Squares of differences are summed
pair by pair, which takes a second for a thousand draws against eleven samples. One matrix product would be faster, but
then an image would not have the distance 0 from itself, and the last digit would depend on the number of threads.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from numpy.typing import ArrayLike

from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.metrics.errors import MetricError

_CHUNK = 128  # images held in float64 at a time: 64 MiB
_ROUNDING = 1e-3  # by which coverage may leave [0, 1], as sums in short floats do


def mse(image: ArrayLike, target: ArrayLike, protocol: Protocol = RELEASE) -> float:
    """Mean squared error of two silhouettes in [0, 1], over the area that an image of the release shows.

    Args:
        image: A silhouette.
        target: A silhouette of the same size.
        protocol: How they were taken.

    Returns:
        The mean over pixels times `Protocol.mse_scale`, which is 1 for the release; at most about 0.56, for cloth that
        covers the flat cloth's disc in one image and nothing in the other.

    Raises:
        MetricError: The images differ in size, have no pixels, or hold values beyond [0, 1].
    """
    return float(mse_pairs(image_array(image)[None], image_array(target)[None], protocol)[0, 0])


def iou(image: ArrayLike, target: ArrayLike) -> float:
    """Intersection over union of the cloth in two silhouettes (coverage > 0.5); 1 where both are empty.

    Args:
        image: A silhouette.
        target: A silhouette of the same size.

    Returns:
        The share, 0 to 1.

    Raises:
        MetricError: The images differ in size, have no pixels, or hold values beyond [0, 1].
    """
    return float(iou_pairs(image_array(image)[None], image_array(target)[None])[0, 0])


def mse_pairs(images: ArrayLike, targets: ArrayLike, protocol: Protocol = RELEASE) -> Float[ndarray, "images targets"]:
    """Mean squared error of every image against every target; see `mse`.

    Args:
        images: Silhouettes (N, H, W), floats in [0, 1] or bytes.
        targets: Silhouettes (M, H, W).
        protocol: How they were taken.

    Returns:
        One row an image, one column a target.

    Raises:
        MetricError: The sizes differ, images have no pixels, or values lie beyond [0, 1].
    """

    def compare(first: ndarray, second: ndarray) -> ndarray:
        squares = np.empty((len(first), len(second)))
        for i, one in enumerate(first):
            for j, other in enumerate(second):
                difference = one - other
                squares[i, j] = np.square(difference, out=difference).sum()
        return squares / first.shape[1] * protocol.mse_scale

    return _pairs(images, targets, compare)


def iou_pairs(images: ArrayLike, targets: ArrayLike) -> Float[ndarray, "images targets"]:
    """Intersection over union of every image with every target (coverage > 0.5); 1 where both are empty.

    Args:
        images: Silhouettes (N, H, W), floats in [0, 1] or bytes.
        targets: Silhouettes (M, H, W).

    Returns:
        One row an image, one column a target.

    Raises:
        MetricError: The sizes differ, images have no pixels, or values lie beyond [0, 1].
    """

    def compare(first: ndarray, second: ndarray) -> ndarray:
        one, other = cloth(first).astype(np.float64), cloth(second).astype(np.float64)
        both = one @ other.T
        either = one.sum(1)[:, None] + other.sum(1)[None] - both
        return np.where(either > 0, both / np.maximum(either, 1), 1.0)

    return _pairs(images, targets, compare)


def cloth(images: Float[ndarray, "*shape"]) -> Bool[ndarray, "*shape"]:
    """Pixels of a silhouette that show cloth and not background.

    Args:
        images: Silhouettes in [0, 1].

    Returns:
        True where the coverage is above 0.5.
    """
    return images > 0.5


def _pairs(images: ArrayLike, targets: ArrayLike, compare: Callable[[ndarray, ndarray], ndarray]) -> ndarray:
    first, second = image_array(images), image_array(targets)
    if first.ndim != 3 or second.ndim != 3 or first.shape[1:] != second.shape[1:]:
        raise MetricError(f"silhouettes must be stacks of one size, got shapes {first.shape} and {second.shape}")
    if 0 in first.shape[1:]:
        raise MetricError(f"silhouettes must have pixels, got images of shape {first.shape[1:]}")
    flat_targets = _coverage(second)
    rows = [compare(_coverage(first[at : at + _CHUNK]), flat_targets) for at in range(0, len(first), _CHUNK)]
    return np.concatenate(rows) if rows else np.zeros((0, len(second)))


def image_array(images: Any) -> ndarray:
    """Images as an array.

    Args:
        images: One or many, as an array or as a tensor, which may carry a gradient or lie on a device.

    Returns:
        The same numbers.
    """
    return images.detach().cpu().numpy() if hasattr(images, "detach") else np.asarray(images)


def _coverage(stack: ndarray) -> ndarray:
    flat = stack.reshape(len(stack), stack.shape[1] * stack.shape[2]).astype(np.float64)
    if stack.dtype == np.uint8:
        flat /= 255
    if not np.isfinite(flat).all():
        raise MetricError("a silhouette holds values that are not finite; the drape behind it has probably diverged")
    if flat.size and not (flat.min() >= -_ROUNDING and flat.max() <= 1 + _ROUNDING):
        raise MetricError(
            f"a silhouette must hold values in [0, 1] (cloth = 1), got {flat.min():g} to {flat.max():g}; divide levels "
            "by the largest that they can have; only bytes are read as 0 to 255"
        )
    return flat
