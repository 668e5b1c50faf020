"""Budget of the gap: the share of it that each named effect explains, and the share that stays unexplained.

Here the gap is the sum of squares of the whitened residual beyond noise, |w|^2 - K with K rows. A set with shifts d_e
explains v(Z) = |w|^2 - |w - sum d_e|^2 of it. The share of an effect is its Shapley value: what it adds to v, averaged
over all orders in which the effects may be added; v is quadratic, so this is exactly d_e . (2 w - sum d). The samples
are split at random into halves; severities are fitted to one half, and shares are computed on the other. A share is the
ratio of sums over all splits: the mean of their ratios would be that of the few splits with hardly any gap.

References:
    Shapley. A value for n-person games. Contributions to the Theory of Games II, 1953. Owen. Sobol' indices and Shapley
    value. SIAM/ASA Journal on Uncertainty Quantification 2, 2014.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.inference.residuals.noise import scatter_of
from cusick_bench.diagnosis.inference.residuals.residual import Residual
from cusick_bench.diagnosis.inference.residuals.samples import SampleStatistics
from cusick_bench.diagnosis.inference.sets.fabric_data import FabricData
from cusick_bench.diagnosis.inference.sets.fabric_sets import FabricSets
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate
from cusick_bench.diagnosis.inference.single_effects.hypotheses import shifts

_SPLITS = 20
_LEAST_SAMPLES = 4
_LEAST_GAP = 2.0  # least gap that is shared out, in standard deviations of |w|^2 under noise
_SEVERITIES = np.geomspace(0.5, 2.0, 15)  # around the fitted one


@dataclass(frozen=True)
class Share:
    """A share of the gap.

    Attributes:
        value: The share; below 0 where the effect makes unseen samples fit worse.
        interval: Its 90 % interval.
    """

    value: float
    interval: tuple[float, float]


@dataclass(frozen=True)
class Budget:
    """Shares of the gap.

    Attributes:
        effects: Share of each named effect.
        unexplained: What they leave.
    """

    effects: dict[str, Share]
    unexplained: Share


def budget(
    fabric: FabricData,
    sets: FabricSets,
    samples: SampleStatistics,
    causes: Sequence[Candidate],
    generator: np.random.Generator,
) -> Budget | None:
    """Shares of the gap on samples that the effects' severities were not fitted to.

    Args:
        fabric: The fabric.
        sets: Its sets.
        samples: Statistics of its samples.
        causes: The effects that are named, at their best parameters.
        generator: Generator of the halves.

    Returns:
        The budget; None where there is no gap, or too few samples.
    """
    count, white = len(samples.specimens), sets.residual.white
    if count < _LEAST_SAMPLES or white @ white - len(white) < _LEAST_GAP * np.sqrt(2 * len(white)):
        return None
    rows = []
    for _ in range(_SPLITS if causes else 1):
        half = generator.permutation(count)[: count // 2]
        other = np.setdiff1d(np.arange(count), half)
        for fitted, unseen in ((half, other), (other, half)):
            row = _parts(fabric, sets.residual, samples, causes, fitted, unseen)
            if row is not None:
                rows.append(row)
    if not rows:
        return None
    gap = np.sum(rows, axis=1)
    shares = [_share(part, gap) for part in np.transpose(rows)]
    of_effects = {one.hypothesis.name: share for one, share in zip(causes, shares[:-1], strict=True)}
    return Budget(of_effects, shares[-1])


def _share(part: Float[ndarray, "splits"], gap: Float[ndarray, "splits"]) -> Share:
    low, high = np.quantile(part / gap, [0.05, 0.95])
    return Share(float(part.sum() / gap.sum()), (float(low), float(high)))


def _parts(
    fabric: FabricData,
    at: Residual,
    samples: SampleStatistics,
    causes: Sequence[Candidate],
    fitted: ndarray,
    unseen: ndarray,
) -> Float[ndarray, "causes_and_rest"] | None:
    """Parts of the gap of unseen samples: of each cause, and last the unexplained one; None where there is no gap."""
    seen_half, unseen_half = (_half(fabric, samples, chosen) for chosen in (fitted, unseen))
    seen = seen_half.against(start=at.theta, fixed=True)
    test = unseen_half.against(start=at.theta, fixed=True)
    gap = float(test.white @ test.white) - len(test.white)
    if gap <= 0:
        return None
    refitted = _severities(seen_half, seen, causes)
    moved = np.array([test.whiten(unseen_half.shift([one], test)[None])[0] for one in refitted])
    moved = moved.reshape(len(refitted), len(test.white))
    values = moved @ (2 * test.white - moved.sum(0))
    return np.append(values, gap - values.sum())


def _half(fabric: FabricData, samples: SampleStatistics, chosen: ndarray) -> FabricData:
    """The fabric with some of its samples."""
    return replace(fabric, features=samples.features(chosen), scatter=scatter_of(samples.specimens[chosen]))


def _severities(fabric: FabricData, at: Residual, causes: Sequence[Candidate]) -> list[Candidate]:
    """Causes with the severities that fit these samples best, found one after the other in two rounds."""
    chosen = list(causes)
    for _ in range(2 if len(chosen) > 1 else 1):
        for place, one in enumerate(chosen):
            others = chosen[:place] + chosen[place + 1 :]
            left = at.white - at.whiten(fabric.shift(others, at)[None])[0]
            name = one.hypothesis.effect.severity.name
            values = {key: np.full(len(_SEVERITIES), value) for key, value in one.value.items()}
            values[name] = one.value[name] * _SEVERITIES
            moved = shifts(fabric.emulator, one.hypothesis, at.theta, at.sd, fabric.drift, values).features
            best = int(np.argmin(((left - at.whiten(moved)) ** 2).sum(1)))
            chosen[place] = replace(one, value={**one.value, name: float(values[name][best])})
    return chosen
