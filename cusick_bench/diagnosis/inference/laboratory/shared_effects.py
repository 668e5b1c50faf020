"""What fabrics of a laboratory may share: the effects, their points and prior, and what is found of them."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.special import gammaln

from cusick_bench.diagnosis.inference.findings.intervals import ParameterInterval
from cusick_bench.diagnosis.inference.findings.verdict import NAMED
from cusick_bench.diagnosis.inference.sets.effect_points import EffectPoints, effect_points, finer_points
from cusick_bench.diagnosis.inference.sets.fabric_data import FabricData
from cusick_bench.diagnosis.inference.sets.fabric_sets import FabricSets
from cusick_bench.diagnosis.inference.sets.shared_causes import SharedCauses
from cusick_bench.diagnosis.inference.single_effects.evidence import LEAST_SIZE, Candidate, grid_at
from cusick_bench.diagnosis.inference.single_effects.hypotheses import Hypothesis, hypotheses

SHARED: Final = (
    "camera-scale", "camera-offset", "camera-tilt", "perspective", "threshold", "plate-tilt", "plate-radius",
    "off-centre", "cut-size",
)  # fmt: skip
"""Effects that all fabrics of a laboratory may share, in the laboratory's frame."""
MOST_SHARED: Final = 3
"""Most effects in a shared set."""
_COUNT_PRIOR = np.array([0.5, 0.3, 0.15, 0.05])  # probability of a shared set of 0, 1, 2, 3 effects
_LEAST_LEAD = 10.0  # of one fabric [nat]
_SPREAD = 1.0  # standard deviation of ln severity about the typical one, in careful laboratories


@dataclass(frozen=True, eq=False)
class SharedEffect:
    """An effect that the fabrics of a laboratory may share.

    Attributes:
        name: Name of the effect.
        probability: That all fabrics show it, or one of its look-alikes, with one severity and direction.
        cause: The effect at its likeliest shared parameters.
        intervals: 90 % intervals of these.
        evidence: By fabric, ln of its likelihood with the effect over that without it, with the other effects unchanged
            [nat].
        look_alikes: Effects that may act instead of a named one, with how far the shared set with them stays behind
            [nat], the nearest first.
        in_its_place: These look-alikes at their likeliest shared parameters.
    """

    name: str
    probability: float
    cause: Candidate
    intervals: Mapping[str, ParameterInterval]
    evidence: Mapping[str, float]
    look_alikes: Mapping[str, float] = field(default_factory=dict)
    in_its_place: Mapping[str, Candidate] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Laboratory:
    """What the fabrics of a data set share.

    Attributes:
        fabrics: Names of the fabrics.
        effects: Every effect that may be shared, the likeliest first.
        sets: Probability of each set of them.
    """

    fabrics: tuple[str, ...]
    effects: tuple[SharedEffect, ...]
    sets: Mapping[tuple[str, ...], float]

    @property
    def named(self) -> tuple[Candidate, ...]:
        """Effects that are taken to act in every fabric; some may stand for a look-alike."""
        return tuple(one.cause for one in self.effects if one.probability >= NAMED)

    @property
    def acting(self) -> Mapping[str, Mapping[str, float]]:
        """For each effect of `named`, the probability that it acts, and that each of its look-alikes does instead."""
        found = {}
        for one in self.effects:
            if one.probability >= NAMED:
                share = shares({one.name: 0.0, **one.look_alikes}, len(self.fabrics))
                found[one.name] = {name: one.probability * each for name, each in share.items()}
        return found

    @property
    def look_alikes(self) -> Mapping[str, Candidate]:
        """What may act in place of an effect of `named`, by name; where two are possible, of the likelier."""
        found: dict[str, tuple[float, Candidate]] = {}
        acting = self.acting
        for one in self.effects:
            for name, cause in one.in_its_place.items():
                p = acting.get(one.name, {}).get(name, 0.0)
                if p > found.get(name, (0.0, cause))[0]:
                    found[name] = p, cause
        return {name: cause for name, (_, cause) in found.items()}

    @property
    def shared(self) -> SharedCauses:
        """All this, as the diagnosis of one fabric takes it."""
        return SharedCauses(self.named, self.acting, self.look_alikes)


@dataclass(frozen=True, eq=False)
class LaboratoryFabric:
    """A fabric of a laboratory.

    Attributes:
        name: Name of the fabric.
        data: Features of the fabric.
        sets: Sets of effects, weighed for it alone.
    """

    name: str
    data: FabricData
    sets: FabricSets


def least_lead(fabrics: int) -> float:
    """Least difference of log densities that counts, where several fabrics are explained in two ways.

    Because of errors of the base model, single fabrics prefer a wrong explanation, by up to six nats as a rule and in
    one of seven by fourteen (`docs/diagnosis-results.md`, *How samples were turned over*).

    Args:
        fabrics: Number of fabrics whose log densities are added.

    Returns:
        The lead [nat].
    """
    return _LEAST_LEAD * float(np.sqrt(max(fabrics, 1)))


def shares(behind: Mapping[str, float], fabrics: int) -> dict[str, float]:
    """Probabilities of several explanations of some fabrics.

    Errors of the base model are common to the fabrics, so evidence counts such that `least_lead` means 19 to 1.

    Args:
        behind: How far the log density of each is behind that of the likeliest [nat].
        fabrics: Number of fabrics whose log densities are added.

    Returns:
        Their probabilities, which add up to 1.
    """
    odds = {name: 19 ** (-nats / least_lead(fabrics)) for name, nats in behind.items()}
    return {name: each / sum(odds.values()) for name, each in odds.items()}


def shared_points(fabric: LaboratoryFabric, names: Collection[str] = SHARED) -> EffectPoints:
    """All points of the effects that may be shared, the same in every fabric.

    Args:
        fabric: A fabric of the laboratory.
        names: Effects of `SHARED`; by default all.

    Returns:
        The points, in the rows of this fabric's misfit.
    """
    data, sets = fabric.data, fabric.sets
    listed = [one for one in hypotheses(data.emulator) if _may_be_shared(one) and one.name in names]
    listed = [one for one in listed if one.name not in data.without]
    grids = [grid_at(data.emulator, one, sets.residual) for one in listed]
    return effect_points(grids, sets.model.misfit, data.calibration.mismatch, weak=True)


def finer_shared_points(fabric: LaboratoryFabric, points: EffectPoints, chosen: Collection[int]) -> EffectPoints:
    """Points of the effects that may be shared, with finer grids about some of them.

    Args:
        fabric: A fabric of the laboratory.
        points: Its points.
        chosen: Points about which grids are finer.

    Returns:
        The points, in the rows of this fabric's misfit.
    """
    data, sets = fabric.data, fabric.sets
    return finer_points(
        points, chosen, data.emulator, sets.residual, sets.model.misfit, data.calibration.mismatch, weak=True
    )


def log_prior(points: Sequence[EffectPoints]) -> Float[ndarray, "points"]:
    """Log prior of the points of each effect, over those that some fabric shows.

    Args:
        points: Points of the effects that may be shared, in the rows of each fabric.

    Returns:
        For each point, -inf where no fabric shows it.
    """
    first = points[0]
    strong = np.max([one.size() for one in points], axis=0) >= LEAST_SIZE
    prior = np.full(len(first), -np.inf)
    by_grid = [g.cell * np.exp(-0.5 * (np.log(np.abs(g.severity())) / _SPREAD) ** 2) for g in first.grids]
    weight = np.array([by_grid[grid][row] for grid, row in zip(first.grid, first.row, strict=True)])
    for number in range(len(first.names)):
        own = np.logical_and(first.effect == number, strong)
        prior[own] = np.log(weight[own] / max(float(weight[own].sum()), 1e-9))
    return prior


def log_count(count: int, listed: int) -> float:
    """Log prior of any one shared set of a size.

    Args:
        count: Number of effects in the set.
        listed: Number of effects that may be shared.

    Returns:
        The log probability.
    """
    if count > min(MOST_SHARED, listed):
        return -np.inf
    choices = gammaln(listed + 1) - gammaln(count + 1) - gammaln(listed - count + 1)
    return float(np.log(_COUNT_PRIOR[count]) - choices)


def _may_be_shared(one: Hypothesis) -> bool:
    return one.name in SHARED and one.frame in ("", "lab")
