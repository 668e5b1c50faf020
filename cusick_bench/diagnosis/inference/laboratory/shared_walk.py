"""Gibbs sampler over the set of effects that fabrics share and the sets that are each fabric's own."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.special import logsumexp

from cusick_bench.diagnosis.inference.findings.intervals import point_intervals
from cusick_bench.diagnosis.inference.laboratory.shared_effects import (
    MOST_SHARED,
    SHARED,
    Laboratory,
    LaboratoryFabric,
    SharedEffect,
    log_count,
    log_prior,
)
from cusick_bench.diagnosis.inference.sets.effect_points import EffectPoints
from cusick_bench.diagnosis.inference.sets.fabric_sets import candidate_at
from cusick_bench.diagnosis.inference.sets.set_model import MOST, SharedShift, likelihoods_of
from cusick_bench.diagnosis.inference.sets.set_sampler import conditional, draw_option
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate


class SharedWalk:
    """A Markov chain over the shared set and the fabrics' own sets.

    Args:
        fabrics: The fabrics.
        points: Points of the effects that may be shared, in the rows of each fabric.
        generator: Generator of the walk.
        start: Shared points to start from.
        complete: Whether the shared set holds every effect that has points, from the first steps on, instead of any of
            them.
        listed: Number of effects that may be shared; by default those that have points.
    """

    def __init__(
        self,
        fabrics: Sequence[LaboratoryFabric],
        points: Sequence[EffectPoints],
        generator: np.random.Generator,
        start: Sequence[int],
        *,
        complete: bool = False,
        listed: int | None = None,
    ) -> None:
        self.fabrics, self.points, self.generator, self.complete = fabrics, points, generator, complete
        first = self.points[0]
        self.listed = len(first.names) if listed is None else listed
        self.log_prior = log_prior(self.points)
        self.own = [list(fabric.sets.posterior.best) for fabric in fabrics]
        for place, fabric in enumerate(fabrics):  # effects that may be shared start in the shared set only
            own = fabric.sets.model.points
            self.own[place] = [point for point in self.own[place] if own.name(point) not in SHARED]
        self.shared: list[int] = list(start)
        self.weight, self.effects = np.zeros(len(first)), np.zeros(len(first.names))
        self.evidence = np.zeros((len(fabrics), len(first.names)))
        self.compared = np.zeros(len(first.names))
        self.visited: list[tuple[int, ...]] = []
        self.log_joints: list[float] = []
        self.counted = 0

    def on(self, points: Sequence[EffectPoints], *, complete: bool = False) -> "SharedWalk":
        """A walk that goes on from the present state of this one, over finer grids or more effects.

        Args:
            points: Points in whose grids those of the shared set are, too.
            complete: Whether its shared set holds every effect that has points.

        Returns:
            The walk, with all counts at 0.
        """
        start = [same_point(self.points[0], point, points[0]) for point in self.shared]
        walk = SharedWalk(self.fabrics, points, self.generator, start, complete=complete, listed=self.listed)
        walk.own = [list(own) for own in self.own]
        return walk

    @property
    def names(self) -> frozenset[str]:
        """Effects of the shared set."""
        return frozenset(self.points[0].name(point) for point in self.shared)

    def step(self, *, counts: bool) -> None:
        """Draws places of the shared set anew, then two of each fabric's own.

        Args:
            counts: Whether the step is counted in the results.
        """
        for _ in range(MOST_SHARED):
            place = int(self.generator.integers(MOST_SHARED))
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
        """Log joint probability of the shared set and all fabrics' own.

        Returns:
            The log probability, up to a constant.
        """
        shared = float(self.log_prior[self.shared].sum()) + log_count(len(self.shared), self.listed)
        for fabric, own in enumerate(self.own):
            model, points = self.fabrics[fabric].sets.model, self.points[fabric]
            more = SharedShift(points.shift[self.shared].sum(0), points.variance[self.shared].sum(0))
            shared += model.log_joint(own, more)
        return shared

    def given(self, fabric: int, others: Sequence[int]) -> Float[ndarray, "options"]:
        """Log likelihoods of one fabric with each shared point added, given its own set, and last without.

        Args:
            fabric: Number of the fabric.
            others: Points of the shared set, besides the one that is added.

        Returns:
            For each point, and last for none.
        """
        model, points, beside = self.fabrics[fabric].sets.model, self.points[fabric], list(others)
        own = model.points
        left = model.white - own.shift[self.own[fabric]].sum(0) - points.shift[beside].sum(0)
        variance = 1 + own.variance[self.own[fabric]].sum(0) + points.variance[beside].sum(0)
        return likelihoods_of(model.misfit, left, variance, points).total

    def _options(self, total: ndarray, others: Sequence[int]) -> Float[ndarray, "options"]:
        """Probability of each shared point in a place, and last of none."""
        points, count = self.points[0], len(others)
        taken = np.isin(points.effect, points.effect[list(others)])
        prior = np.where(taken, -np.inf, self.log_prior) + log_count(count + 1, self.listed)
        prior -= np.log(MOST_SHARED - count)
        weighed = total + np.append(prior, log_count(count, self.listed))
        if self.complete and np.isfinite(weighed[:-1]).any():
            weighed[-1] = -np.inf
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
            joint = gained[:, chosen].sum(0) + self.log_prior[chosen] - np.log(points.cell[chosen])
            best = chosen[int(np.argmax(joint))]
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


def same_point(points: EffectPoints, point: int, others: EffectPoints) -> int:
    """The point of other grids with the same parameters.

    Args:
        points: Points of grids.
        point: One of them.
        others: Points of other grids, among which the same effect at the same parameters is.

    Returns:
        Its index there.
    """
    value = points.value(point)
    of_effect = np.flatnonzero(others.effect == others.names.index(points.name(point)))
    return next(
        int(o) for o in of_effect if np.allclose([*others.value(int(o)).values()], [*value.values()], rtol=1e-9)
    )


def pooled(
    chains: Sequence[SharedWalk], share: Float[ndarray, "chains"], causes: Sequence[Candidate] = ()
) -> Laboratory:
    """Averages over the walks, each weighted by its share.

    Args:
        chains: The walks.
        share: Probability of each.
        causes: Effects with the parameters that are stated of them.

    Returns:
        The laboratory, every other effect at its likeliest point.
    """
    stated = {one.hypothesis.name: one for one in causes}
    points, fabrics = chains[0].points[0], chains[0].fabrics
    weight = np.sum([p * chain.weight / chain.counted for p, chain in zip(share, chains, strict=True)], axis=0)
    effects = np.sum([p * chain.effects / chain.counted for p, chain in zip(share, chains, strict=True)], axis=0)
    evidence = np.sum([p * chain.evidence for p, chain in zip(share, chains, strict=True)], axis=0)
    compared = np.sum([p * chain.compared for p, chain in zip(share, chains, strict=True)], axis=0)
    names = tuple(fabric.name for fabric in fabrics)
    found = []
    for number, name in enumerate(points.names):
        own = np.flatnonzero(points.effect == number)
        cause = stated.get(name) or candidate_at(points, points.densest(number, weight))
        intervals = point_intervals(points, own, weight[own], cause)
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
