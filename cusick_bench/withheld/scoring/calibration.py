"""Calibration of probabilities, intervals of shares and means, and how well a score separates two kinds of cases.

References:
    Student. The probable error of a mean. Biometrika 6 (1908), 1-25.
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
from functools import lru_cache
from math import inf, log, nan

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.stats import binomtest, mannwhitneyu, sem
from scipy.stats import t as student

BINS = 10
PER_BIN = 15  # least number of cases in a bin
LEAST_PROBABILITY = 1e-4  # least probability in the logarithmic score
_ALIKE = 1e-9  # relative difference of values that are alike but for rounding


@lru_cache(maxsize=4096)
def wilson_interval(successes: int, cases: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share, which stays honest at 0 and 100 %.

    Args:
        successes: Cases that count.
        cases: All cases.

    Returns:
        Lower and upper bound; NaN without cases.
    """
    if cases == 0:
        return nan, nan
    interval = binomtest(successes, cases).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def alike(values: Float[ndarray, " values"]) -> bool:
    """Whether values tell nothing of how they scatter.

    Args:
        values: Of cases, or of resamples of them.

    Returns:
        True where none differ but for rounding, or there are fewer than two.
    """
    return len(values) < 2 or bool(np.ptp(values) <= _ALIKE * np.abs(values).max())


def mean_interval(values: Float[ndarray, " cases"], least: float = -inf, greatest: float = inf) -> tuple[float, float]:
    """95 % interval of a mean by Student's t, which holds it for few cases, too.

    Args:
        values: Value of each case.
        least, greatest: Between which the mean is whatever the cases are.

    Returns:
        Lower and upper bound, within what the mean can be; NaN where fewer than two cases, or none that differ, tell
        nothing of how they scatter.
    """
    if alike(values):
        return nan, nan
    low, high = student.interval(0.95, len(values) - 1, loc=values.mean(), scale=sem(values))
    return max(float(low), least), min(float(high), greatest)


def auroc(
    positives: Float[ndarray, "*batch positives"], negatives: Float[ndarray, "*batch negatives"]
) -> Float[ndarray, "*batch"]:
    """Area under the receiver operating characteristic: how often a positive has the larger score, ties half.

    It is the Mann-Whitney statistic over the number of pairs.

    Args:
        positives: Scores of the positive cases.
        negatives: Scores of the negative cases.

    Returns:
        The area, between 0 and 1; 0.5 where the scores tell nothing.
    """
    wins = mannwhitneyu(positives, negatives, axis=-1, method="asymptotic").statistic
    return np.asarray(wins / (positives.shape[-1] * negatives.shape[-1]))


def calibration_error(confidence: Float[ndarray, " cases"], right: Float[ndarray, " cases"]) -> float:
    """Expected calibration error: |confidence - share right|, averaged over bins of equal numbers of cases.

    Cases of one confidence stay in one bin, or the order in which they came would count.

    Args:
        confidence: Stated probability of each case.
        right: 1 where the statement was right, else 0.

    Returns:
        The error, between 0 and 1.
    """
    bins = _bins(confidence)
    return float(np.abs(np.bincount(bins, confidence - right)).sum() / len(confidence))


def reliability(
    confidence: Float[ndarray, " cases"], right: Float[ndarray, " cases"]
) -> list[tuple[float, float, int]]:
    """Points of a reliability diagram, in the bins of `calibration_error`.

    Args:
        confidence: Stated probability of each case.
        right: 1 where the statement was right, else 0.

    Returns:
        Mean confidence, share right and number of cases of each bin.
    """
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
        confidence: Stated probability of each case.
        generator: Source of the random outcomes.
        repeats: Number of sets of outcomes to draw.

    Returns:
        The mean error.
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
    """Sum of squared differences between probabilities and what came true: 0 is perfect, 2 is sure and wrong.

    Args:
        probabilities: Stated probability of each outcome.
        truth: The outcome that came true.

    Returns:
        The score.
    """
    return sum((p - (name == truth)) ** 2 for name, p in probabilities.items())


def log_score(probabilities: Mapping[str, float], truth: str) -> float:
    """Negative logarithm of the probability of what came true; a probability of 0 counts as `LEAST_PROBABILITY`.

    Args:
        probabilities: Stated probability of each outcome.
        truth: The outcome that came true.

    Returns:
        The score [nat].
    """
    return -log(max(probabilities.get(truth, 0.0), LEAST_PROBABILITY))
