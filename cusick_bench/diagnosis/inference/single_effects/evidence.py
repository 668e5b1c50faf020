"""How well each effect alone explains what the base model leaves, point by point of its grid.

With w white noise where the base model holds, and d the shift of w by an effect at one point of its grid,

    log p(w | point) = -1/2 sum_k [ (w_k - d_k)^2 / v_k + ln v_k ],   v_k = 1 + e^2 d_k^2 + u

where e is the relative difference of another law for the same effect from ours, and u the atlas' own uncertainty. Only
points with |d| of at least `LEAST_SIZE`, half of what can be detected, have a prior. A weaker effect counts as none in
this fabric, and a cause without any such point is undetectable here and is left out.

References:
    MacKay. Information theory, inference, and learning algorithms, 2003, Chapter 28 (Occam's razor in the evidence).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.inference.residuals.residual import Residual
from cusick_bench.diagnosis.inference.single_effects.hypotheses import Hypothesis, hypotheses, shifts

NONE: Final = "none"
UNKNOWN: Final = "unknown"
LAW_DIFFERENCE = 0.3
"""e, how far another law for the same effect may differ from ours, as a share of its shift."""
LEAST_SIZE = 2.2
"""|d| of the weakest points that have a prior [standard deviations of noise]."""
_USUAL = 4.0  # [typical severities] from which on severities become less and less likely
_TOO_WEAK = 0.15  # share of a grid that is too weak in every fabric; effects that only extremes show are less likely


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
        values: Parameters of every point, by name.
        cell: Share of a cell of the hypothesis' own grid that every point stands for.
        shift: Shift of w at every point.
        variance: u of every point, in units of noise.
        log_prior: Log prior of every point, -inf for those too weak to detect; they add up to the hypothesis' share of
            its effect's prior.
    """

    hypothesis: Hypothesis
    values: Mapping[str, Float[ndarray, "points"]]
    cell: Float[ndarray, "points"]
    shift: Float[ndarray, "points kept"]
    variance: Float[ndarray, "points"]
    log_prior: Float[ndarray, "points"]

    def severity(self) -> Float[ndarray, "points"]:
        """Severities, in typical ones."""
        severity = self.hypothesis.effect.severity
        return self.values[severity.name] / severity.typical

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
    weight = severity_weight(hypothesis)
    total = weight[strong].sum() + _TOO_WEAK * weight.sum()
    log_prior = np.where(strong, np.log(hypothesis.prior * weight / total), -np.inf)
    variance = moved.variance * residual.variance_of_unit
    return Grid(hypothesis, hypothesis.values, np.ones(len(shift)), shift, variance, log_prior)


def severity_weight(hypothesis: Hypothesis) -> Float[ndarray, "points"]:
    """Prior weight of the severities of a grid: uniform in their logarithm, and smaller for unusual ones.

    Args:
        hypothesis: The effect and its frame.

    Returns:
        Weight of every point, at most 1.
    """
    return np.minimum(1.0, (_USUAL / np.maximum(np.abs(hypothesis.severity()), 1e-9)) ** 2)


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
    log_likelihood: float = 0.0
    log_evidence: float = 0.0
    size: float = 0.0


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
        value = {name: float(column[best]) for name, column in grid.values.items()}
        size = float(np.linalg.norm(grid.shift[best]))
        best_points.append(Candidate(grid.hypothesis, value, float(likelihood[best]), evidence, size))
    return sorted(best_points, key=lambda one: -one.log_evidence)
