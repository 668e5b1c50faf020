"""Variability of drapes of one cloth, which draws should reproduce.

For a set of silhouettes: the mean squared error of pairs, which is mostly due to folds in other places, and the
standard deviations of the drape coefficient and of the number of folds. Draws that differ only in independent elements
hardly differ; real samples do. The mean number of folds stands beside them. Each number has its jackknife standard
error, as there are only a dozen samples.

References:
    B. Efron, C. Stein. The jackknife estimate of variance. Annals of Statistics 9 (1981), 586-596.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.metrics.distances.image import mse_pairs
from cusick_bench.metrics.distances.shape import Shape
from cusick_bench.metrics.errors import MetricError

Images = Float[ndarray, "drapes height width"] | UInt8[ndarray, "drapes height width"]


@dataclass(frozen=True)
class Spread:
    """A number with its standard error."""

    value: float
    error: float


@dataclass(frozen=True)
class Variability:
    """Variability of drapes of one cloth.

    Attributes:
        drapes: Number of drapes that were compared.
        pair_mse: Mean squared error of two of them; see `mse`.
        dc_sd: Standard deviation of the drape coefficient.
        folds_sd: Standard deviation of the number of folds.
        folds: Its mean.
    """

    drapes: int
    pair_mse: Spread
    dc_sd: Spread
    folds_sd: Spread
    folds: Spread


def variability(images: Images, protocol: Protocol = RELEASE) -> Variability:
    """Measures how drapes of one cloth differ from each other.

    Args:
        images: Silhouettes, cloth = 1 (or 255 in bytes): samples of a cloth, or draws.
        protocol: How they were taken.

    Returns:
        Mean differences and spreads with their standard errors.

    Raises:
        MetricError: Fewer than three drapes.
    """
    if len(images) < 3:
        raise MetricError(f"variability takes 3 drapes or more, got {len(images)}; make the solver offer more draws")
    pairs = mse_pairs(images, images, protocol)
    full = 255 if images.dtype == np.uint8 else 1
    shapes = [Shape(image / full, protocol=protocol) for image in images]
    coefficients = np.array([shape.drape_coefficient for shape in shapes])
    folds = np.array([float(shape.folds) for shape in shapes])

    def deviation(values: ndarray) -> Callable[[ndarray], float]:
        return lambda kept: float(values[kept].std(ddof=1))

    return Variability(
        len(images),
        _jackknife(lambda kept: _mean_pair(pairs[np.ix_(kept, kept)]), len(images)),
        _jackknife(deviation(coefficients), len(images)),
        _jackknife(deviation(folds), len(images)),
        _jackknife(lambda kept: float(folds[kept].mean()), len(images)),
    )


def variability_rows(sets: Mapping[str, Images], protocol: Protocol = RELEASE) -> list[dict[str, str | float]]:
    """Tabulates how drapes differ within each of several sets.

    Args:
        sets: Name, such as "samples" or a solver's, to silhouettes of one cloth.
        protocol: How they were taken.

    Returns:
        A row a set: its name, the number of its drapes, every measure and its `_error`.
    """
    rows: list[dict[str, str | float]] = []
    for name, images in sets.items():
        found = variability(images, protocol)
        row: dict[str, str | float] = {"drapes_of": name, "drapes": found.drapes}
        for measure in ("pair_mse", "dc_sd", "folds_sd", "folds"):
            spread: Spread = getattr(found, measure)
            row |= {measure: spread.value, f"{measure}_error": spread.error}
        rows.append(row)
    return rows


def _mean_pair(table: Float[ndarray, "drapes drapes"]) -> float:
    """Mean over pairs of different drapes."""
    return float(table.sum() - np.trace(table)) / (len(table) * (len(table) - 1))


def _jackknife(measure: Callable[[ndarray], float], count: int) -> Spread:
    """A measure of the drapes 0 .. count - 1, and its standard error from leaving each out."""
    every = np.arange(count)
    without: Sequence[float] = [measure(np.delete(every, index)) for index in every]
    return Spread(measure(every), sqrt((count - 1) * float(np.var(without))))
