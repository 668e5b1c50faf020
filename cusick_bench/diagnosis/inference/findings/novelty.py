"""Whether something acts that is not on the list: goodness of fit of the named set, against a bootstrap of itself.

The residual of the set, r = V^-1/2 (w - sum_e d_e) with V the variance of noise, laws and the misfit that symmetry
allows, is projected onto what the set's own parameters cannot change; for draws of the fitted model that are fitted
again, it is N(0, I) projected likewise. Only rows that no base model may get wrong are used. Two statistics are
combined: |r|^2 over all of these rows, and |r|^2 over the few directions in which effects move them most. Each is
standardised by its mean and standard deviation over the draws, and the larger one is compared with that of the draws.

References:
    Davison, Hinkley. Bootstrap methods and their application, 1997, Section 4.4 (parametric tests). Sellke, Bayarri,
    Berger. Calibration of p values for testing precise null hypotheses. The American Statistician 55(1), 2001.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.inference.sets.effect_points import EffectPoints
from cusick_bench.diagnosis.inference.sets.fabric_sets import FabricSets
from cusick_bench.diagnosis.inference.sets.refined import NamedSet

LEVEL = 0.1
"""Share of fabrics with listed effects only for which an unlisted one is claimed."""
_PRIOR_ODDS = 0.3  # prior odds of a cause that is not on the list, where something acts
_FITS = 0.3  # Bayes factor for such a cause where the set fits
_DIRECTIONS = 10
_DRAWS = 1000


@dataclass(frozen=True)
class Novelty:
    """Goodness of fit of the named set.

    Attributes:
        p: Probability of at least so large a residual where the set is all that acts.
        explained: Sum of squares that the set explains, as a share of these and what it leaves in rows that no base
            model may get wrong.
    """

    p: float
    explained: float

    @property
    def rejected(self) -> bool:
        """Whether something acts that is not on the list."""
        return self.p <= LEVEL

    @property
    def probability(self) -> float:
        """Probability that what accounts for most is not on the list, as far as goodness of fit tells.

        The prior odds of something unlisted are multiplied by the largest Bayes factor against the set that a p-value
        of this size allows. It accounts for most in so far as the set does not.
        """
        favours = 1 / (-np.e * self.p * np.log(self.p)) if self.p < 1 / np.e else _FITS
        odds = _PRIOR_ODDS * favours
        return float(odds / (1 + odds) * (1 - self.explained))


def novelty(sets: FabricSets, named: NamedSet, generator: np.random.Generator) -> Novelty:
    """Tests whether a set of effects is all that acts.

    Args:
        sets: The fabric.
        named: The effects that are named, fitted.
        generator: Generator of the bootstrap.

    Returns:
        The test.
    """
    model = sets.model
    split = model.misfit.forbidden
    scale = np.sqrt(model.misfit.variance(sets.posterior.misfit, 0.0) + named.variance)
    own = np.linalg.qr((named.tangent / scale).T)[0] if len(named.tangent) else np.zeros((len(scale), 0))
    directions = _leading_directions(model.points, split)

    def statistics(left: Float[ndarray, "draws kept"]) -> Float[ndarray, "draws 2"]:
        rest = (left - (left @ own) @ own.T)[:, :split]
        return np.stack([(rest**2).sum(1), ((rest @ directions) ** 2).sum(1)], axis=1)

    null = statistics(model.null_noise(_DRAWS, generator))
    observed = statistics((named.left / scale)[None])[0]
    mean, sd = null.mean(0), null.std(0)
    excess, limit = ((observed - mean) / sd).max(), ((null - mean) / sd).max(1)
    p = (1 + int((limit >= excess).sum())) / (1 + _DRAWS)
    taken = float(model.white @ model.white) - float(named.left @ named.left)
    beyond = max(float((named.left[:split] ** 2).sum()) - split, 0.0)
    return Novelty(p, max(taken, 0.0) / max(taken + beyond, 1e-9) if taken > 0 else 0.0)


def _leading_directions(points: EffectPoints, split: int) -> Float[ndarray, "rows directions"]:
    """Directions in which effects move the forbidden rows most, every effect counting alike."""
    mean = np.zeros((split, split))
    for number in range(len(points.names)):
        shift = points.shift[points.effect == number, :split]
        size = np.linalg.norm(shift, axis=1, keepdims=True)
        unit = shift / np.maximum(size, 1e-9)
        mean += unit.T @ unit / max(len(unit), 1)
    vectors = np.linalg.eigh(mean)[1]
    return vectors[:, ::-1][:, :_DIRECTIONS]
