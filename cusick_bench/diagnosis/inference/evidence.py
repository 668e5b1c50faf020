"""How well each cause explains what the base model leaves: marginal likelihoods, and the probability that none acts.

With w white noise where the base model holds, and d the shift of w by an effect at one point of its grid,

    log p(w | point) = -1/2 sum_k [ (w_k - d_k)^2 / v_k + ln v_k ],   v_k = 1 + e^2 d_k^2 + u

where e is how far another law for the same effect may differ from ours, where it acts, and u the atlas' own
uncertainty. The evidence of a cause is the mean over its grid, which charges it for freedom that it does not need. Only
points with |d| of at least `LEAST_SIZE` belong to it: half of what can be detected. A weaker effect is none to whoever
looks at this fabric, and a cause without such a point is undetectable here and takes no part.

Two causes compete that claim nothing in particular: `none`, d = 0, and `unknown`, w ~ N(0, I + s^2 M) over a range of
sizes s. M, of trace 1, is for the most part the mean of the unit shifts' outer products over all effects: what is not
in the list will move the same statistics together as what is, but in other proportions; a small part of it is any
direction. The detection test compares the best evidence with that of white noise, so its level holds over all causes
together.

References:
    MacKay. Information theory, inference, and learning algorithms, 2003, Chapter 28 (Occam's razor in the evidence).
    Kass, Raftery. Bayes factors. JASA 90(430), 1995.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.inference.hypotheses import Hypothesis, hypotheses, shifts
from cusick_bench.diagnosis.inference.residual import Residual
from cusick_bench.sim.effects import registered

NONE: Final = "none"
UNKNOWN: Final = "unknown"
DENSITY_BIAS = "density-bias"
LAW_DIFFERENCE = 0.3
LEAST_SIZE = 2.2
_UNKNOWN_SIZES = np.geomspace(LEAST_SIZE, 40, 10)
_ANY_DIRECTION = 0.1  # share of M
_UNKNOWN_SHARE = 0.1  # of the detection statistic
PRIOR_NONE, PRIOR_UNKNOWN, PRIOR_PAIR = 0.5, 0.08, 0.02
"""The rest is shared evenly by all effects; those that are undetectable in a fabric leave theirs to `none`."""


def log_sum(values: Float[ndarray, "terms"] | Sequence[float]) -> float:
    """ln of the sum of exponentials.

    Args:
        values: Logarithms.

    Returns:
        ln sum exp; by numpy rather than scipy's logsumexp, whose last digit differs from that of frozen answers.
    """
    return float(np.logaddexp.reduce(np.asarray(values, dtype=np.float64)))


@dataclass(frozen=True, eq=False)
class Grid:
    """One hypothesis at one fabric.

    Attributes:
        hypothesis: The effect and its frame.
        shift: Shift of w at every point of the hypothesis' grid.
        variance: u of every point.
        log_prior: Log prior of every point, -inf for those too weak to detect; they add up to the hypothesis' share of
            its effect's prior.
    """

    hypothesis: Hypothesis
    shift: Float[ndarray, "points kept"]
    variance: Float[ndarray, "points"]
    log_prior: Float[ndarray, "points"]

    def log_likelihood(
        self, white: Float[ndarray, "kept"], law_difference: float = LAW_DIFFERENCE
    ) -> Float[ndarray, "points"]:
        """Log likelihood of every point.

        Args:
            white: What the base model leaves.
            law_difference: e, how far another law may differ from ours.

        Returns:
            Log likelihoods, but for a constant.
        """
        return log_likelihood(white, self.shift, self.variance, law_difference)

    def best(self, likelihood: Float[ndarray, "points"]) -> int:
        """The likeliest point of those that can be detected.

        Args:
            likelihood: Log likelihood of every point.

        Returns:
            Its index.
        """
        return int(np.argmax(np.where(np.isfinite(self.log_prior), likelihood, -np.inf)))


def log_likelihood(
    white: Float[ndarray, "kept"],
    shift: Float[ndarray, "points kept"],
    variance: Float[ndarray, "points"],
    law_difference: float = LAW_DIFFERENCE,
) -> Float[ndarray, "points"]:
    """log p(w | shift), but for a constant (see the module).

    Args:
        white: w, what the base model leaves.
        shift: d of every point.
        variance: u of every point.
        law_difference: e, how far another law may differ from ours.

    Returns:
        Log likelihoods.
    """
    v = _variance(shift, variance, law_difference)
    return -0.5 * ((white - shift) ** 2 / v + np.log(v)).sum(1)


def _variance(
    shift: Float[ndarray, "points kept"], variance: Float[ndarray, "points"], law_difference: float = LAW_DIFFERENCE
) -> Float[ndarray, "points kept"]:
    """v of every point (see the module)."""
    return 1 + law_difference**2 * shift**2 + variance[:, None]


def detectable_grids(emulator: Emulator, residual: Residual) -> list[Grid]:
    """All hypotheses that can be detected at a fabric's base parameters.

    Args:
        emulator: The atlas.
        residual: What the base model leaves of the fabric.

    Returns:
        Their grids.
    """
    grids = (grid_at(emulator, hypothesis, residual) for hypothesis in hypotheses(emulator))
    return [grid for grid in grids if np.isfinite(grid.log_prior).any()]


def grid_at(emulator: Emulator, hypothesis: Hypothesis, residual: Residual, *, least: float = LEAST_SIZE) -> Grid:
    """One hypothesis at a fabric's base parameters.

    Args:
        emulator: The atlas.
        hypothesis: The effect and its frame.
        residual: What the base model leaves of the fabric.
        least: Least |d| of its points.

    Returns:
        Its grid; points below `least` have no prior.
    """
    moved = shifts(emulator, hypothesis, residual.theta, residual.sd, residual.drift)
    shift = residual.whiten(moved.features)
    strong = np.linalg.norm(shift, axis=1) >= least
    log_prior = np.where(strong, np.log(hypothesis.prior / max(int(strong.sum()), 1)), -np.inf)
    return Grid(hypothesis, shift, moved.variance, log_prior)


@dataclass(frozen=True, eq=False)
class Candidate:
    """The best point of one hypothesis.

    Attributes:
        hypothesis: The effect and its frame.
        value: Its parameters.
        log_likelihood: Log likelihood at that point, less that of no effect.
        log_evidence: Log evidence of the hypothesis, less that of no effect; with its share of the effect's prior.
        size: |d| there: how many standard deviations of noise the effect moves w.
    """

    hypothesis: Hypothesis
    value: dict[str, float]
    log_likelihood: float
    log_evidence: float
    size: float


def candidates(
    white: Float[ndarray, "kept"], grids: Sequence[Grid], *, law_difference: float = LAW_DIFFERENCE
) -> list[Candidate]:
    """Every hypothesis, best evidence first.

    Args:
        white: What the base model leaves.
        grids: All hypotheses.
        law_difference: How far another law may differ, where the effect acts.

    Returns:
        The best point of each.
    """
    nothing = -0.5 * float(white @ white)
    best_points = []
    for grid in grids:
        likelihood = grid.log_likelihood(white, law_difference) - nothing
        best = grid.best(likelihood)
        evidence = log_sum(likelihood + grid.log_prior)
        value = {name: float(column[best]) for name, column in grid.hypothesis.values.items()}
        size = float(np.linalg.norm(grid.shift[best]))
        best_points.append(Candidate(grid.hypothesis, value, float(likelihood[best]), evidence, size))
    return sorted(best_points, key=lambda one: -one.log_evidence)


def unknown_evidence(white: Float[ndarray, "kept"], grids: Sequence[Grid]) -> float:
    """Log evidence of a shift that no effect makes, less that of no shift (see the module).

    Args:
        white: What the base model leaves.
        grids: All hypotheses.

    Returns:
        The log evidence.
    """
    return float(_free(white[None], grids)[0])


def _free(white: Float[ndarray, "fabrics kept"], grids: Sequence[Grid]) -> Float[ndarray, "fabrics"]:
    """Log evidence of `unknown` for one or many residuals, less that of no shift."""
    count = white.shape[1]
    mean = np.zeros((count, count))
    for grid in grids:
        strong = np.isfinite(grid.log_prior)
        unit = grid.shift[strong] / np.linalg.norm(grid.shift[strong], axis=1, keepdims=True)
        mean += (unit * np.exp(grid.log_prior[strong])[:, None]).T @ unit
    share = (1 - _ANY_DIRECTION) / np.trace(mean) if grids else 0.0
    value, vector = np.linalg.eigh(share * mean)
    scale = np.maximum(value, 0) + (_ANY_DIRECTION if grids else 1.0) / count
    squares = (white @ vector) ** 2
    terms = [
        -0.5 * (squares @ (1 / (1 + size**2 * scale) - 1) + np.log1p(size**2 * scale).sum()) for size in _UNKNOWN_SIZES
    ]
    return np.logaddexp.reduce(terms, axis=0) - np.log(len(terms))


def by_effect(singles: Sequence[Candidate]) -> dict[str, float]:
    """Log evidence of every effect, its frames added up.

    Args:
        singles: Every hypothesis.

    Returns:
        By effect.
    """
    names = dict.fromkeys(one.hypothesis.name for one in singles)
    return {name: log_sum([c.log_evidence for c in singles if c.hypothesis.name == name]) for name in names}


def posterior(
    effects: Mapping[str, float], unknown: float, *, tempering: float = 1.0, extra: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Probabilities of all causes.

    A wrong density changes nothing but the unit of stiffness: its evidence is that of no effect.

    Args:
        effects: Log evidence by effect.
        unknown: Log evidence of an unknown shift.
        tempering: Power of the likelihoods, from calibration.
        extra: Log evidence of pairs.

    Returns:
        Of `none`, every effect (and pair, named with a plus sign) and `unknown`; they add up to 1.
    """
    share = (1 - PRIOR_NONE - PRIOR_UNKNOWN - PRIOR_PAIR) / len(registered())
    none = 1 - PRIOR_UNKNOWN - PRIOR_PAIR - share * (len(effects) + 1)
    log = {NONE: np.log(none), UNKNOWN: np.log(PRIOR_UNKNOWN) + tempering * unknown}
    log |= {name: np.log(share) + tempering * value for name, value in effects.items()}
    log[DENSITY_BIAS] = np.log(share)
    pairs = extra or {}
    log |= {name: np.log(PRIOR_PAIR / len(pairs)) + tempering * value for name, value in pairs.items()}
    total = log_sum(list(log.values()))
    return {name: float(np.exp(value - total)) for name, value in log.items()}


def detection_statistic(white: Float[ndarray, "fabrics kept"], grids: Sequence[Grid]) -> Float[ndarray, "fabrics"]:
    """Log of the prior-weighted evidence of anything against nothing.

    Args:
        white: One or many whitened residuals.
        grids: All hypotheses.

    Returns:
        The statistic of each.
    """
    squared, logs = (white**2).sum(1), []
    for grid in grids:
        v = _variance(grid.shift, grid.variance)
        fixed = (grid.shift**2 / v + np.log(v)).sum(1)
        terms = -0.5 * (white**2 @ (1 / v).T - 2 * white @ (grid.shift / v).T + fixed) + 0.5 * squared[:, None]
        logs.append(np.logaddexp.reduce(terms + grid.log_prior, axis=1))
    causes = np.logaddexp.reduce(np.array(logs), axis=0) - np.log(len(grids)) if grids else np.full(len(white), -np.inf)
    return np.logaddexp(causes, _free(white, grids) + np.log(_UNKNOWN_SHARE))


def detection_p_value(
    residual: Residual,
    grids: Sequence[Grid],
    generator: np.random.Generator,
    *,
    draws: int = 400,
) -> float:
    """Probability of so much evidence for anything where the base model holds, by parametric bootstrap of w.

    Args:
        residual: What the base model leaves of the fabric.
        grids: All hypotheses.
        generator: Generator of the bootstrap.
        draws: Number of draws.

    Returns:
        The p-value; never 0.
    """
    observed = detection_statistic(residual.white[None], grids)[0]
    null = detection_statistic(generator.standard_normal((draws, len(residual.white))), grids)
    return float((1 + (null >= observed).sum()) / (1 + draws))
