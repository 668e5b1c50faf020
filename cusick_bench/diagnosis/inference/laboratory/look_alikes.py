"""Shared sets in which one effect is exchanged for another, and how far they stay behind.

Once the fabrics' own sets have adapted to one shared set, single steps of the sampler no longer exchange an effect for
a look-alike, even where the set with the look-alike is as likely: a plate that leans by 4 degrees and a camera that
leans by 1 degree leave other traces, which own effects of the fabrics take up. So every exchange of one effect gets a
walk of its own that holds its effects from the first steps on, and the fabrics' own sets adapt to it. If it becomes
likelier than the set it came from, its own exchanges are tried, too.

How far an exchange stays behind is compared with what errors of the base model can do. These are common to all fabrics,
so a lead does not become sure by the number of fabrics alone (`least_lead`).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cusick_bench.diagnosis.inference.laboratory.shared_effects import (
    SHARED,
    LaboratoryFabric,
    finer_shared_points,
    least_lead,
    shared_points,
)
from cusick_bench.diagnosis.inference.laboratory.shared_walk import SharedWalk, same_point
from cusick_bench.diagnosis.inference.sets.effect_points import EffectPoints
from cusick_bench.diagnosis.inference.sets.fabric_sets import candidate_at
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate

_ADAPTED: Final = 6  # steps on coarse grids
_SETTLED: Final = 2  # first steps on finer grids, which do not count
_COUNTED: Final = 8
_FAR: Final = 1.5  # least leads behind the likeliest set from which a set is not looked at on finer grids
_ROUNDS: Final = 3  # most sets whose exchanges are tried
_EXPLAINED: Final = 0.5  # least share of what an effect explains that a look-alike of it explains

Names = frozenset[str]


@dataclass(frozen=True, eq=False)
class AdaptedSet:
    """A shared set to which the fabrics' own sets have adapted.

    Attributes:
        walk: The walk on coarse grids, at its end.
        log_joint: Mean log joint probability on finer grids, on coarse ones where it is far behind.
        finer: The walk on finer grids; None where it is far behind.
    """

    walk: SharedWalk
    log_joint: float
    finer: SharedWalk | None = None


class Exchanges:
    """Shared sets around the likeliest one.

    Args:
        fabrics: The fabrics of a laboratory.
        generator: Generator of the walks.
        progress: Called with the share that is done.
    """

    def __init__(
        self,
        fabrics: Sequence[LaboratoryFabric],
        generator: np.random.Generator,
        progress: Callable[[float], None] = lambda share: None,
    ) -> None:
        self.fabrics, self.generator, self.progress = fabrics, generator, progress
        self.sets: dict[Names, AdaptedSet] = {}
        self.likeliest: Names = frozenset()
        """The set whose exchanges were tried last."""

    def search(self, start: SharedWalk) -> None:
        """Tries exchanges of a set, and again of a likelier set that is found.

        Args:
            start: A walk on the coarse grids of all effects.
        """
        self.likeliest = start.names
        self._adapt(self.likeliest, start)
        for round_ in range(_ROUNDS):
            before, walk = self.likeliest, self.sets[self.likeliest].walk
            tried = [names for names in _exchanged(before, start.points[0].names) if names not in self.sets]
            for number, names in enumerate(tried):
                self._adapt(names, walk)
                self.progress((round_ + (number + 1) / len(tried)) / _ROUNDS)
            best = max(self.sets, key=lambda names: self.sets[names].log_joint)
            if best == before or round_ == _ROUNDS - 1:
                break
            self.likeliest = best
        self.progress(1.0)

    def without(self, effect: str) -> float:
        """How far the set without an effect of the likeliest set stays behind it.

        Args:
            effect: Name of the effect.

        Returns:
            The difference [nat]; infinite for an effect that is not of the likeliest set.
        """
        return self._behind(self.likeliest - {effect}) if effect in self.likeliest else np.inf

    def look_alikes(self, effect: str) -> Mapping[str, float]:
        """Effects that explain what an effect of the likeliest set explains.

        Args:
            effect: Name of the effect.

        Returns:
            By name, how far the set with it in place of the effect stays behind [nat], the nearest first: less than
            errors of the base model can cause, and less than half as far as the set without either.
        """
        if effect not in self.likeliest:
            return {}
        rest = self.likeliest - {effect}
        most = min(least_lead(len(self.fabrics)), (1 - _EXPLAINED) * self._behind(rest))
        others = [name for name in SHARED if name not in self.likeliest and rest | {name} in self.sets]
        lost = {name: self._behind(rest | {name}) for name in others}
        return dict(sorted(((n, b) for n, b in lost.items() if b < most), key=lambda item: item[1]))

    def in_place_of(self, effect: str, other: str) -> Candidate:
        """What a look-alike would be in the laboratory.

        Args:
            effect: Name of an effect of the likeliest set.
            other: One of its look-alikes.

        Returns:
            The look-alike at its likeliest parameters in the set where it stands in place of the effect.
        """
        found = self.sets[self.likeliest - {effect} | {other}]
        walk = found.finer or found.walk
        points = walk.points[0]
        return candidate_at(points, points.densest(points.names.index(other), walk.weight))

    def _behind(self, names: Names) -> float:
        return self.sets[self.likeliest].log_joint - self.sets[names].log_joint

    def _adapt(self, names: Names, nearby: SharedWalk) -> None:
        """Lets the fabrics' own sets adapt to a shared set, from the parameters of the effects that a walk shares."""
        points = [shared_points(fabric, names) for fabric in self.fabrics]
        start = [
            same_point(nearby.points[0], point, points[0])
            for point in nearby.shared
            if nearby.points[0].name(point) in names
        ]
        walk = SharedWalk(self.fabrics, points, self.generator, start, complete=True, listed=nearby.listed)
        for _ in range(_ADAPTED):
            walk.step(counts=False)
        log_joint, on_finer_grids = walk.log_joint(), None
        best = max((one.log_joint for one in self.sets.values()), default=-np.inf)
        if log_joint > best - _FAR * least_lead(len(self.fabrics)):
            on_finer_grids = self._on_finer_grids(walk, points)
            log_joint = float(np.mean(on_finer_grids.log_joints))
        self.sets[names] = AdaptedSet(walk, log_joint, on_finer_grids)

    def _on_finer_grids(self, walk: SharedWalk, points: Sequence[EffectPoints]) -> SharedWalk:
        near = set(walk.shared)
        finer = [finer_shared_points(fabric, one, near) for fabric, one in zip(self.fabrics, points, strict=True)]
        walk = walk.on(finer, complete=True)
        for step in range(_SETTLED + _COUNTED):
            walk.step(counts=step >= _SETTLED)
        return walk


def _exchanged(names: Names, listed: Sequence[str]) -> Iterator[Names]:
    """The set without one effect, and with another in its place."""
    others = [name for name in listed if name not in names]
    for name in sorted(names):
        yield names - {name}
        for other in others:
            yield names - {name} | {other}
