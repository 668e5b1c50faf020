"""Effects of the laboratory, which all fabrics of a data set share: camera, plate, cut, order of captures.

A camera that stands off its place does so for every fabric. So an effect of the laboratory has one severity and one
direction, in the camera's frame, for all fabrics; those of the cloth are each fabric's own. Both are sampled together:
the shared set given the fabrics' own sets, by the sum of the fabrics' log likelihoods at every point of the shared
grid, and each fabric's own set given what is shared. What one fabric cannot decide, several may.

Two effects that look alike (a camera beside its place, a plate out of level) are not exchanged in one step once every
fabric's own set has settled about one of them. So short chains start from no shared effect and from each single one;
those that get furthest go on, and count by the mean joint probability of what they visit.
"""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.special import gammaln, logsumexp

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.errors import Refused
from cusick_bench.diagnosis.inference.effect_points import EffectPoints, effect_points
from cusick_bench.diagnosis.inference.evidence import LEAST_SIZE, Candidate, grid_at
from cusick_bench.diagnosis.inference.fabric_data import FabricData, fabric_data
from cusick_bench.diagnosis.inference.fabric_sets import FabricSets, candidate_at, fabric_sets
from cusick_bench.diagnosis.inference.hypotheses import Hypothesis, hypotheses
from cusick_bench.diagnosis.inference.intervals import ParameterInterval, point_intervals
from cusick_bench.diagnosis.inference.refined import shared_set
from cusick_bench.diagnosis.inference.refusal import domain_doubts
from cusick_bench.diagnosis.inference.set_model import MOST, SharedShift, likelihoods_of
from cusick_bench.diagnosis.inference.set_sampler import conditional, draw_option
from cusick_bench.diagnosis.inference.verdict import NAMED
from cusick_bench.diagnosis.measure.captures import Captures

SHARED: Final = (
    "camera-scale", "camera-offset", "camera-tilt", "perspective", "threshold", "plate-tilt", "plate-radius",
    "off-centre", "cut-size",
)  # fmt: skip
"""Effects that all fabrics of a laboratory may share, in the laboratory's frame."""
_MOST = 3  # effects of the shared set
_COUNT_PRIOR = np.array([0.5, 0.3, 0.15, 0.05])  # probability of so many
STEPS: Final = 40
"""Of every chain that goes on."""
_SCREENED = 8  # steps of every chain, after which only the likeliest go on
_CHAINS = 2
_OWN_STEPS = 30  # of each fabric's own chains before, which give a start only
_LEAST_FABRICS = 2
_SPREAD = 1.0  # of ln severity about the typical one, in laboratories that work with care


@dataclass(frozen=True, eq=False)
class SharedEffect:
    """An effect that the fabrics of a laboratory may share.

    Attributes:
        name: Name of the effect.
        probability: That all fabrics show it, with one severity and direction.
        cause: The effect at its likeliest shared parameters.
        intervals: 90 % intervals of these.
        evidence: By fabric, ln of its likelihood with the effect over that without, the other effects being the same
            [nat].
    """

    name: str
    probability: float
    cause: Candidate
    intervals: Mapping[str, ParameterInterval]
    evidence: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Laboratory:
    """What the fabrics of a data set share.

    Attributes:
        fabrics: Their names.
        effects: Every effect that may be shared, the likeliest first.
        sets: Probability of each set of them.
    """

    fabrics: tuple[str, ...]
    effects: tuple[SharedEffect, ...]
    sets: Mapping[tuple[str, ...], float]

    @property
    def named(self) -> tuple[Candidate, ...]:
        """Effects that are taken to act in every fabric."""
        return tuple(one.cause for one in self.effects if one.probability >= NAMED)


@dataclass(frozen=True, eq=False)
class LaboratoryFabric:
    """A fabric of a laboratory.

    Attributes:
        name: Its name.
        data: Its features.
        sets: Sets of effects, weighed for it alone.
    """

    name: str
    data: FabricData
    sets: FabricSets


def laboratory(
    fabrics: Sequence[LaboratoryFabric],
    generator: np.random.Generator,
    *,
    steps: int = STEPS,
    progress: Callable[[float], None] = lambda share: None,
) -> Laboratory | None:
    """Weighs effects that all fabrics share.

    Args:
        fabrics: The fabrics of one data set.
        generator: Generator of the sampler.
        steps: Steps of each chain that goes on.
        progress: Called with the share that is over.

    Returns:
        The laboratory; None of fewer than two fabrics.
    """
    if len(fabrics) < _LEAST_FABRICS:
        return None
    points = [_shared_points(fabric) for fabric in fabrics]
    tried = [_Chain(fabrics, points, generator, start) for start in ([], *_starts(fabrics, points))]
    total, done = len(tried) * _SCREENED + _CHAINS * steps, 0
    for chain in tried:
        for _ in range(_SCREENED):
            chain.step(counts=False)
            done += 1
            progress(done / total)
    chains = sorted(tried, key=lambda chain: -chain.log_joint())[:_CHAINS]
    for chain in chains:
        for _ in range(steps):
            chain.step(counts=True)
            done += 1
            progress(done / total)
    mean = np.array([np.mean(chain.log_joints) for chain in chains])
    found = _pooled(chains, np.exp(mean - float(np.logaddexp.reduce(mean))))
    own = chains[int(np.argmax(mean))].own
    named = shared_set([(fabric.data, fabric.sets) for fabric in fabrics], own, found.named)
    return _with_causes(found, named)


def laboratory_of(
    captures: Sequence[Captures],
    emulator: Emulator,
    calibration: Calibration,
    generator: np.random.Generator,
    *,
    without: Sequence[str] = (),
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Laboratory | None:
    """Weighs what the fabrics of a data set share; fabrics that are refused take no part.

    Args:
        captures: Silhouettes of each fabric.
        emulator: The atlas.
        calibration: Calibration of its probabilities.
        generator: Generator of the samplers.
        without: Effects that are not to be considered.
        progress: Called to tell what is being done, and the share that is over.

    Returns:
        The laboratory; None of fewer than two fabrics.
    """
    if len(captures) < _LEAST_FABRICS:
        return None
    fabrics = []
    for number, one in enumerate(captures):
        progress(f"{one.fabric}: sets of effects", number / (2 * len(captures)))
        try:
            _, data, _ = fabric_data(one, emulator, calibration, without)
            sets = fabric_sets(data, data.against(), generator, steps=_OWN_STEPS)
            domain_doubts(emulator, data.features, sets.residual)
        except Refused:
            continue
        fabrics.append(LaboratoryFabric(one.fabric, data, sets))
    return laboratory(fabrics, generator, progress=lambda share: progress("what they share", (1 + share) / 2))


def _starts(fabrics: Sequence[LaboratoryFabric], points: Sequence[EffectPoints]) -> list[list[int]]:
    """The best shared point of each effect that may be shared."""
    chain = _Chain(fabrics, points, np.random.default_rng(0), [])
    own = np.sum([chain.given(fabric, ()) for fabric in range(len(fabrics))], axis=0)
    gained = own[:-1] - own[-1] + chain.log_prior
    effect = chain.points[0].effect
    of_effect = [np.flatnonzero(effect == number) for number in np.unique(effect)]
    best = [int(points[np.argmax(gained[points])]) for points in of_effect]
    return [[point] for point in best if np.isfinite(gained[point])]


class _Chain:
    """Walk over the shared set and the fabrics' own.

    Args:
        fabrics: The fabrics.
        points: Points of the effects that may be shared, in the rows of each fabric.
        generator: Generator of the walk.
        start: Shared points to start from.
    """

    def __init__(
        self,
        fabrics: Sequence[LaboratoryFabric],
        points: Sequence[EffectPoints],
        generator: np.random.Generator,
        start: Sequence[int],
    ) -> None:
        self.fabrics, self.points, self.generator = fabrics, points, generator
        first = self.points[0]
        self.log_prior = _log_prior(self.points)
        self.own = [list(fabric.sets.posterior.best) for fabric in fabrics]
        for place, fabric in enumerate(fabrics):  # what may be shared is found anew
            own = fabric.sets.model.points
            self.own[place] = [point for point in self.own[place] if own.name(point) not in SHARED]
        self.shared: list[int] = list(start)
        self.weight, self.effects = np.zeros(len(first)), np.zeros(len(first.names))
        self.evidence = np.zeros((len(fabrics), len(first.names)))
        self.compared = np.zeros(len(first.names))
        self.visited: list[tuple[int, ...]] = []
        self.log_joints: list[float] = []
        self.counted = 0

    def step(self, *, counts: bool) -> None:
        """Every place of the shared set, then one or two of each fabric's own."""
        for _ in range(_MOST):
            place = int(self.generator.integers(_MOST))
            others = self.shared[:place] + self.shared[place + 1 :]
            own = np.stack([self.given(fabric, others) for fabric in range(len(self.fabrics))])
            options = self._options(own.sum(0), others)
            chosen = draw_option(options, self.generator)
            self.shared = others + ([chosen] if chosen < len(self.points[0]) else [])
            if counts:
                self._count(options, others, own)
        for fabric in range(len(self.fabrics)):
            self._renew(fabric)
        if counts:
            self.log_joints.append(self.log_joint())

    def log_joint(self) -> float:
        """Log joint probability of the shared set and all fabrics' own."""
        shared = float(self.log_prior[self.shared].sum()) + _log_count(len(self.shared), len(self.points[0].names))
        for fabric, own in enumerate(self.own):
            model, points = self.fabrics[fabric].sets.model, self.points[fabric]
            more = SharedShift(points.shift[self.shared].sum(0), points.variance[self.shared].sum(0))
            shared += model.log_joint(own, more)
        return shared

    def given(self, fabric: int, others: Sequence[int]) -> Float[ndarray, "options"]:
        """Log likelihoods of one fabric with each shared point added, given its own set, and last without."""
        model, points = self.fabrics[fabric].sets.model, self.points[fabric]
        own = model.points
        left = model.white - own.shift[self.own[fabric]].sum(0) - points.shift[others].sum(0)
        variance = 1 + own.variance[self.own[fabric]].sum(0) + points.variance[others].sum(0)
        return likelihoods_of(model.misfit, left, variance, points).total

    def _options(self, total: ndarray, others: Sequence[int]) -> Float[ndarray, "options"]:
        """Probability of each shared point in a place, and last of none."""
        points, count = self.points[0], len(others)
        taken = np.isin(points.effect, points.effect[list(others)])
        prior = np.where(taken, -np.inf, self.log_prior) + _log_count(count + 1, len(points.names))
        prior -= np.log(_MOST - count)
        weighed = total + np.append(prior, _log_count(count, len(points.names)))
        return np.exp(weighed - logsumexp(weighed))

    def _count(self, options: ndarray, others: Sequence[int], own: ndarray) -> None:
        points = self.points[0]
        self.counted += 1
        self.weight += options[:-1]
        effects = np.bincount(points.effect, options[:-1], minlength=len(points.names))
        effects[points.effect[list(others)]] = 1.0
        self.weight[list(others)] += 1
        self.effects += effects
        self.visited.append(tuple(sorted(self.shared)))
        gained = own[:, :-1] - own[:, -1:]
        for number in set(range(len(points.names))) - {int(points.effect[point]) for point in others}:
            chosen = np.flatnonzero(points.effect == number)
            best = chosen[int(np.argmax(gained[:, chosen].sum(0) + self.log_prior[chosen]))]
            self.evidence[:, number] += gained[:, best]
            self.compared[number] += 1

    def _renew(self, fabric: int) -> None:
        """Empties and fills two places of a fabric's own set."""
        model, points = self.fabrics[fabric].sets.model, self.points[fabric]
        more = SharedShift(points.shift[self.shared].sum(0), points.variance[self.shared].sum(0))
        for _ in range(2):
            own = self.own[fabric]
            place = int(self.generator.integers(MOST))
            others = own[:place] + own[place + 1 :]
            chosen = draw_option(conditional(model, others, more).options, self.generator)
            self.own[fabric] = others + ([chosen] if chosen < len(model.points) else [])


def _pooled(chains: Sequence[_Chain], share: Float[ndarray, "chains"]) -> Laboratory:
    """What the walks have seen, each counted by its share."""
    points, fabrics = chains[0].points[0], chains[0].fabrics
    weight = np.sum([p * chain.weight / chain.counted for p, chain in zip(share, chains, strict=True)], axis=0)
    effects = np.sum([p * chain.effects / chain.counted for p, chain in zip(share, chains, strict=True)], axis=0)
    evidence = np.sum([p * chain.evidence for p, chain in zip(share, chains, strict=True)], axis=0)
    compared = np.sum([p * chain.compared for p, chain in zip(share, chains, strict=True)], axis=0)
    names = tuple(fabric.name for fabric in fabrics)
    found = []
    for number, name in enumerate(points.names):
        own = np.flatnonzero(points.effect == number)
        cause = candidate_at(points, int(own[np.argmax(weight[own])]))
        intervals = point_intervals(points, own, weight[own])
        mean = evidence[:, number] / max(float(compared[number]), 1e-9)
        found.append(
            SharedEffect(name, float(effects[number]), cause, intervals, dict(zip(names, mean.tolist(), strict=True)))
        )
    sets: dict[tuple[str, ...], float] = defaultdict(float)
    for p, chain in zip(share, chains, strict=True):
        for one in chain.visited:
            sets[tuple(sorted(points.name(point) for point in one))] += float(p) / len(chain.visited)
    return Laboratory(
        names,
        tuple(sorted(found, key=lambda one: -one.probability)),
        dict(sorted(sets.items(), key=lambda item: -item[1])),
    )


def _with_causes(found: Laboratory, causes: Sequence[Candidate]) -> Laboratory:
    """The laboratory with other parameters of some effects."""
    by_name = {one.hypothesis.name: one for one in causes}
    return replace(found, effects=tuple(replace(one, cause=by_name.get(one.name, one.cause)) for one in found.effects))


def _shared_points(fabric: LaboratoryFabric) -> EffectPoints:
    """All points of the effects that may be shared, the same in every fabric."""
    data, sets = fabric.data, fabric.sets
    listed = [one for one in hypotheses(data.emulator) if _may_be_shared(one) and one.name not in data.without]
    grids = [grid_at(data.emulator, one, sets.residual) for one in listed]
    return effect_points(grids, sets.model.misfit, data.calibration.mismatch, weak=True)


def _may_be_shared(one: Hypothesis) -> bool:
    return one.name in SHARED and one.frame in ("", "lab")


def _log_prior(points: Sequence[EffectPoints]) -> Float[ndarray, "points"]:
    """Within each effect, over the points that some fabric shows."""
    first = points[0]
    strong = np.max([one.size() for one in points], axis=0) >= LEAST_SIZE
    prior = np.full(len(first), -np.inf)
    by_grid = [np.exp(-0.5 * (np.log(np.abs(g.hypothesis.severity())) / _SPREAD) ** 2) for g in first.grids]
    weight = np.array([by_grid[grid][row] for grid, row in zip(first.grid, first.row, strict=True)])
    for number in range(len(first.names)):
        own = np.logical_and(first.effect == number, strong)
        prior[own] = np.log(weight[own] / max(float(weight[own].sum()), 1e-9))
    return prior


def _log_count(count: int, listed: int) -> float:
    """Log prior of any one shared set of a size."""
    if count > _MOST:
        return -np.inf
    choices = gammaln(listed + 1) - gammaln(count + 1) - gammaln(listed - count + 1)
    return float(np.log(_COUNT_PRIOR[count]) - choices)
