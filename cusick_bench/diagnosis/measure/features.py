"""Features of a fabric, from which it is diagnosed: means, scatter and drift of its drapes' statistics.

    contrast  even = (up + down)/2 and odd = (down - up)/2 of every statistic in the cloth's frame, mean over samples
    spread    ln of the standard deviation between samples, of the groups of statistics in `SPREADS`
    order     last capture of a face minus the first, of the statistics in `ORDERS`

Samples are the independent units: captures of a face are averaged before anything is compared, and faces are compared
within samples. With e and o the even and odd parts of a sample, its face up shows e - o, its face down e + o. Samples
of which only one face is known contribute to the even mean, corrected by the odd mean of the others.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
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
ORDERS = columns(
    "mean_radius",
    "area_dc",
    "quantile_05",
    "quantile_95",
    "fold_centroid",
    "fold_depth",
    "roughness",
    "skewness",
    "crest_radius",
    "valley_gap",
)
"""Statistics whose drift is a feature."""
_PAIRS = 2  # least number of samples with both faces from which the odd part is computed from these alone
_SHARED = 0.75  # degrees of freedom of a face over those of a sample: the two faces of a sample are correlated


@dataclass(frozen=True, eq=False)
class Features:
    """A fabric's features.

    Attributes:
        mean: Mean by face (up, down) and statistic; NaN where a face is missing.
        samples: Number of samples with each face.
        both: Number of samples with both faces.
        contrast: Mean even and odd part of every statistic. Where only one face is known, the even part is the mean of
            that face, and the odd part is NaN.
        share: The covariance of `contrast` is that of a sample's even parts times `share[0]` plus that of its odd parts
            times `share[1]`, each a matrix over even and odd.
        spread: Entries as in `SPREADS`; NaN where samples vary within faces with fewer than two degrees of freedom.
        spread_variance: Their sampling variance.
        order: Entries as in `ORDERS`; NaN without repeats.
        order_covariance: Their sampling covariance.
        order_freedom: Degrees of freedom of that.
    """

    mean: Float[ndarray, "2 statistics"]
    samples: Int[ndarray, "2"]
    both: int
    contrast: Float[ndarray, "2 statistics"]
    share: Float[ndarray, "2 2 2"]
    spread: Float[ndarray, "spreads"]
    spread_variance: Float[ndarray, "spreads"]
    order: Float[ndarray, "orders"]
    order_covariance: Float[ndarray, "orders orders"]
    order_freedom: int

    @property
    def single(self) -> int:
        """-1 where all samples lie face up, 1 where all lie face down, 0 where both faces are known."""
        return int(self.samples[0] == 0) - int(self.samples[1] == 0)


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
    weights = contrast_weights(known)
    contrast = np.einsum("rsf,sfk->rk", weights, np.where(known[..., None], specimens, 0.0))
    contrast[np.abs(weights).sum((1, 2)) == 0] = np.nan
    even, odd = weights.sum(2), weights[..., 1] - weights[..., 0]
    spread, spread_variance = _spread(specimens, known, mean)
    return Features(
        mean,
        count,
        int(np.all(known, axis=1).sum()),
        contrast,
        np.stack([even @ even.T, odd @ odd.T]),
        spread,
        spread_variance,
        *_order(drift),
    )


def contrast_weights(known: Bool[ndarray, "samples 2"]) -> Float[ndarray, "2 samples 2"]:
    """Weights of every sample's faces in the mean even and the mean odd part, unbiased whatever faces are missing.

    Args:
        known: Which faces of each sample are known.

    Returns:
        Weights of even and odd; 0 for what cannot be told.
    """
    weights = np.zeros((2, *known.shape))
    up, down = known.T
    both, count, total = up & down, known.sum(0), int(known.any(1).sum())
    if min(count) == 0:
        weights[0] = known / max(total, 1)
    elif both.sum() >= _PAIRS or not (both.sum() < count).all():
        weights[1] = np.where(both[:, None], [-0.5, 0.5], 0.0) / both.sum()
        weights[0] = np.where(both[:, None], 0.5, 1.0) * known / total
        weights[0] += (int((up & ~both).sum()) - int((down & ~both).sum())) / total * weights[1]
    else:  # hardly any sample has both faces
        face = known / count / 2
        weights[0], weights[1] = face, face * [-1, 1]
    return weights


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


def _order(drift: ndarray | None) -> tuple[ndarray, ndarray, int]:
    """Mean drift, its covariance from the scatter between samples, and the degrees of freedom of that."""
    count = len(ORDERS)
    known = np.empty((0, count)) if drift is None else drift[np.isfinite(drift).all(1)][:, list(ORDERS)]
    if len(known) < 3:
        return np.full(count, np.nan), np.diag(np.full(count, np.inf)), 0
    freedom = len(known) - 1
    wider = freedom / (freedom - 2) if freedom > 2 else 3.0  # variance of Student's t
    return known.mean(0), wider * np.cov(known.T) / len(known), freedom
