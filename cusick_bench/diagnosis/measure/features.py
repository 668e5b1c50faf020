"""What a diagnosis looks at in a fabric: means, scatter and drift of its drapes' statistics.

    mean    of every statistic over the samples, for each face (statistics in the cloth's frame)
    spread  ln of the standard deviation between samples, of what natural variability moves least alike
    order   how much the last capture of a face differs from the first

Samples are the independent units: faces and captures of one sample are averaged before anything is compared.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.special import digamma, polygamma

from cusick_bench.diagnosis.measure.statistics import columns

SPREADS: tuple[tuple[str, tuple[int, ...]], ...] = (
    ("area_dc", columns("area_dc")),
    ("fold_centroid", columns("fold_centroid")),
    ("fold_depth", columns("fold_depth")),
    *((name, columns(f"{name}_real", f"{name}_imaginary")) for name in ("harmonic_1", "harmonic_2", "harmonic_3")),
    ("envelope_1", columns("envelope_1_real", "envelope_1_imaginary")),
)
"""Names and columns; real and imaginary parts count together."""
ORDERS = columns("mean_radius", "area_dc", "quantile_05", "quantile_95", "fold_depth", "fold_centroid")
"""Statistics whose drift is looked at."""
_SHARED = 0.75  # faces of one sample are partly alike, and count for less than two


@dataclass(frozen=True, eq=False)
class Features:
    """A fabric's features.

    Attributes:
        mean: Mean by face (up, down) and statistic; NaN where a face is missing.
        samples: How many samples each face's mean is over.
        both: How many samples have both faces.
        spread: Entries as in `SPREADS`; NaN below three samples a face.
        spread_variance: Their sampling variance.
        order: Entries as in `ORDERS`; NaN without repeats.
        order_variance: Their sampling variance.
    """

    mean: Float[ndarray, "2 statistics"]
    samples: Int[ndarray, "2"]
    both: int
    spread: Float[ndarray, "spreads"]
    spread_variance: Float[ndarray, "spreads"]
    order: Float[ndarray, "orders"]
    order_variance: Float[ndarray, "orders"]


def features(
    specimens: Float[ndarray, "samples 2 statistics"], drift: Float[ndarray, "samples statistics"] | None = None
) -> Features:
    """Features from the statistics of every sample and face.

    Args:
        specimens: Means over captures; NaN where there is none.
        drift: Last minus first capture; NaN where there is none.

    Returns:
        The features.
    """
    known = np.isfinite(specimens).min(axis=2)
    count = known.sum(0)
    total = np.where(known[..., None], specimens, 0.0).sum(0)
    mean = np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], np.nan)
    spread, spread_variance = _spread(specimens, known, mean)
    order, order_variance = _order(drift)
    return Features(mean, count, int(np.all(known, axis=1).sum()), spread, spread_variance, order, order_variance)


def _spread(specimens: ndarray, known: ndarray, mean: ndarray) -> tuple[ndarray, ndarray]:
    """ln of the pooled standard deviations within faces, free of bias, and their variances."""
    freedom = int(np.maximum(known.sum(0) - 1, 0).sum())
    if freedom < 2:
        return np.full(len(SPREADS), np.nan), np.full(len(SPREADS), np.inf)
    squares = np.where(known[..., None], (specimens - mean) ** 2, 0.0).sum((0, 1)) / freedom
    value, variance = np.empty(len(SPREADS)), np.empty(len(SPREADS))
    for i, (_, chosen) in enumerate(SPREADS):
        half = _SHARED * freedom * len(chosen) / 2
        squared = squares[list(chosen)].sum()
        value[i] = 0.5 * (np.log(max(squared, 1e-18)) - digamma(half) + np.log(half))
        variance[i] = 0.25 * polygamma(1, half)
    return value, variance


def _order(drift: ndarray | None) -> tuple[ndarray, ndarray]:
    """Mean drift and its variance, from the scatter between samples."""
    nothing = np.full(len(ORDERS), np.nan), np.full(len(ORDERS), np.inf)
    if drift is None:
        return nothing
    known = drift[np.isfinite(drift).all(1)][:, list(ORDERS)]
    if len(known) < 3:
        return nothing
    freedom = len(known) - 1
    wider = freedom / (freedom - 2) if freedom > 2 else 3.0  # Student's t has this variance
    return known.mean(0), wider * known.var(0, ddof=1) / len(known)
