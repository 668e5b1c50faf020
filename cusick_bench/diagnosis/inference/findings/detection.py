"""Detection: the evidence for any single effect, or for something unlisted, against the base model alone.

The base model may be wrong in statistics that its symmetry leaves free. The null hypothesis is the base model with such
a misfit, of the size that the data have; p is the share of draws from it whose evidence is at least as large. The level
of the test therefore holds over all effects together.
"""

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.special import logsumexp
from scipy.stats.qmc import LatinHypercube

from cusick_bench.diagnosis.inference.sets.misfit import ANY_PRIOR, ANY_SIZES, MISFIT_PRIOR, MISFIT_SIZES
from cusick_bench.diagnosis.inference.sets.set_model import SetModel

ALPHA = 0.05
"""Level of the detection test, over all effects together."""
_AT_ONCE = 400  # draws in memory


def detection_statistic(model: SetModel, white: Float[ndarray, "fabrics kept"]) -> Float[ndarray, "fabrics"]:
    """ln of the evidence for anything over that of the base model with its misfit.

    Args:
        model: A fabric, for its rows and points.
        white: One or many residuals in the turned rows.

    Returns:
        The statistic of each.
    """
    misfit, points = model.misfit, model.points
    split = misfit.forbidden
    first = [np.broadcast_to(t**2, split) for t in ANY_SIZES]
    last = [s**2 * misfit.pattern for s in MISFIT_SIZES]
    nothing = np.zeros((1, white.shape[1]))
    base_any = _log_densities(white[:, :split], nothing[:, :split], nothing[:, :split], first)[..., 0]
    base_allowed = _mixed(_log_densities(white[:, split:], nothing[:, split:], nothing[:, split:], last), MISFIT_PRIOR)
    none = base_any[0] + base_allowed[:, 0]
    unlisted = logsumexp(base_any[1:], axis=0, b=ANY_PRIOR[1:, None]) + base_allowed[:, 0]
    if not len(points):
        return unlisted - none
    shift, added = points.shift, points.variance
    forbidden = _log_densities(white[:, :split], shift[:, :split], added[:, :split], first[:1])[0]
    allowed = _mixed(_log_densities(white[:, split:], shift[:, split:], added[:, split:], last), MISFIT_PRIOR)
    single = logsumexp(forbidden + allowed + points.log_prior, axis=1) - np.log(max(model.listed, 1))
    return np.logaddexp(single, unlisted) - none


def _log_densities(
    white: Float[ndarray, "fabrics rows"],
    shift: Float[ndarray, "points rows"],
    added: Float[ndarray, "points rows"],
    misfit: list[ndarray],
) -> Float[ndarray, "sizes fabrics points"]:
    """Log densities of every residual at every point, for each size of the misfit."""
    squares, result = white**2, []
    for own in misfit:
        v = 1 + added + own
        fixed = (shift**2 / v + np.log(v)).sum(1)
        result.append(-0.5 * (squares @ (1 / v).T - 2 * white @ (shift / v).T + fixed))
    return np.array(result)


def _mixed(log_densities: Float[ndarray, "sizes fabrics points"], prior: ndarray) -> Float[ndarray, "fabrics points"]:
    largest = log_densities.max(0)
    return largest + np.log(np.einsum("sfp,s->fp", np.exp(log_densities - largest), prior))


def detection_p_value(
    model: SetModel, generator: np.random.Generator, *, draws: int = 2000, most: int = 50_000
) -> float:
    """Probability of so much evidence for anything where the base model holds but for its misfit.

    While the estimate is within three binomial standard errors of the test's level, more draws are made, so that chance
    does not decide what is detected. Stratified draws (`SetModel.null_noise`) have about .7 of the binomial standard
    error: .0007 at the level with 50,000 draws.

    Args:
        model: The fabric, linearised at the best base model.
        generator: Generator of the bootstrap.
        draws: Number of draws, where they tell on which side of the level the p-value is.
        most: Largest number of draws.

    Returns:
        The p-value; never 0.
    """
    observed = detection_statistic(model, model.white[None])[0]
    allowed = model.likelihoods(()).symmetric[-1]
    shares = np.exp(allowed - logsumexp(allowed))
    made = as_large = 0
    spread = np.sqrt(ALPHA * (1 - ALPHA))
    while made < draws or (made < most and abs(as_large / made - ALPHA) < 3 * spread / np.sqrt(made)):
        batch = min(_AT_ONCE, (draws if made < draws else most) - made)
        as_large += int((_null_statistics(model, shares, generator, batch) >= observed).sum())
        made += batch
    return (1 + as_large) / (1 + made)


def _null_statistics(
    model: SetModel, shares: Float[ndarray, "sizes"], generator: np.random.Generator, draws: int
) -> Float[ndarray, "draws"]:
    """Statistics of fabrics for which the base model holds but for its misfit, whose sizes have these probabilities."""
    stratified = LatinHypercube(1, rng=generator).random(draws)[:, 0]
    scales = np.stack([np.sqrt(model.misfit.variance(size, 0.0)) for size in MISFIT_SIZES])
    scale = scales[np.searchsorted(shares.cumsum()[:-1], stratified)]
    return detection_statistic(model, scale * model.null_noise(draws, generator))
