"""Whether probabilities mean what they say, and how well a score tells two sorts of cases apart.

References:
    E. B. Wilson. Probable inference, the law of succession, and statistical inference. Journal of the American
        Statistical Association 22 (1927), 209-212.
    J. A. Hanley, B. J. McNeil. The meaning and use of the area under a receiver operating characteristic curve.
        Radiology 143 (1982), 29-36.
    C. Guo, G. Pleiss, Y. Sun, K. Q. Weinberger. On calibration of modern neural networks. ICML 2017.
    J. Bröcker, L. A. Smith. Increasing the reliability of reliability diagrams. Weather and Forecasting 22 (2007),
        651-661 (what calibrated forecasts look like in a sample this small).
    G. W. Brier. Verification of forecasts expressed in terms of probability. Monthly Weather Review 78 (1950), 1-3.
"""

from collections.abc import Mapping
from math import log, nan, sqrt

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.stats import rankdata

BINS = 10
PER_BIN = 15  # cases that a bin should have at least
LEAST_PROBABILITY = 1e-4  # what a probability of 0 counts for in the logarithmic score
_NORMAL_97_5 = 1.959963984540054


def wilson(successes: float, cases: int) -> tuple[float, float]:
    """Bounds of the 95 % interval of a share, which stay honest at 0 and 100 %; NaN without cases."""
    if cases == 0:
        return nan, nan
    share, z2 = successes / cases, _NORMAL_97_5**2 / cases
    centre = (share + z2 / 2) / (1 + z2)
    reach = sqrt(z2 * (share * (1 - share) + z2 / 4)) / (1 + z2)
    return max(0.0, centre - reach), min(1.0, centre + reach)


def separation(
    positives: Float[ndarray, "*batch positives"], negatives: Float[ndarray, "*batch negatives"]
) -> Float[ndarray, "*batch"] | float:
    """Area under the receiver operating characteristic: how often a positive has the larger score, ties half."""
    ranks = rankdata(np.concatenate([positives, negatives], axis=-1), axis=-1)
    number, rest = positives.shape[-1], negatives.shape[-1]
    return (ranks[..., :number].sum(-1) - number * (number + 1) / 2) / (number * rest)


def calibration_error(confidence: Float[ndarray, " cases"], right: Float[ndarray, " cases"]) -> float:
    """Expected calibration error: |confidence - share right|, averaged over bins of equal numbers of cases.

    Cases of one confidence stay in one bin, or the order in which they came would count.
    """
    bins = _bins(confidence)
    return float(np.abs(np.bincount(bins, confidence - right)).sum() / len(confidence))


def reliability(
    confidence: Float[ndarray, " cases"], right: Float[ndarray, " cases"]
) -> list[tuple[float, float, int]]:
    """Mean confidence, share right and cases of each bin: the points of a reliability diagram."""
    bins = _bins(confidence)
    return [
        (float(confidence[bins == place].mean()), float(right[bins == place].mean()), int((bins == place).sum()))
        for place in np.unique(bins)
    ]


def calibration_error_by_chance(
    confidence: Float[ndarray, " cases"], generator: np.random.Generator, repeats: int = 400
) -> float:
    """Mean calibration error that answers of these confidences show if they are calibrated: 0 only for endless cases.

    Args:
        confidence: Stated probabilities.
        generator: Of the outcomes.
        repeats: How many sets of outcomes to draw.
    """
    bins = _bins(confidence)
    outcomes = generator.random((repeats, len(confidence))) < confidence
    errors = [np.abs(np.bincount(bins, confidence - right)).sum() for right in outcomes]
    return float(np.mean(errors) / len(confidence))


def _bins(confidence: Float[ndarray, " cases"]) -> Int[ndarray, " cases"]:
    number = int(np.clip(len(confidence) // PER_BIN, 1, BINS))
    edges = np.quantile(confidence, np.arange(1, number) / number)
    return np.searchsorted(edges, confidence, side="left")


def brier_score(probabilities: Mapping[str, float], truth: str) -> float:
    """Sum of squared differences between probabilities and what came true: 0 is perfect, 2 is sure and wrong."""
    return sum((p - (name == truth)) ** 2 for name, p in probabilities.items())


def log_score(probabilities: Mapping[str, float], truth: str) -> float:
    """Surprise at the truth [nat]; a probability of 0 counts as `LEAST_PROBABILITY`."""
    return -log(max(probabilities.get(truth, 0.0), LEAST_PROBABILITY))
