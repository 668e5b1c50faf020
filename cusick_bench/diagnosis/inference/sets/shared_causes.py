"""What the fabrics of a laboratory share, as the diagnosis of one of them takes it.

Which of its look-alikes acts in the place of a shared effect is known for the laboratory as a whole. A fabric may show
one of them besides, for itself alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate


@dataclass(frozen=True, eq=False)
class SharedCauses:
    """Effects that all fabrics of a laboratory show, and what may act in their place.

    Attributes:
        causes: The effects, at their shared parameters.
        probability: For each of them the probability that it acts, and that each of its look-alikes does instead; one
            that is not in it acts for certain.
        look_alikes: These look-alikes, at the parameters that all fabrics would share.
    """

    causes: tuple[Candidate, ...] = ()
    probability: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    look_alikes: Mapping[str, Candidate] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(one.hypothesis.name for one in self.causes)

    @property
    def acting(self) -> Mapping[str, Mapping[str, float]]:
        """For every effect, the probability that it acts, and that each of its look-alikes does instead."""
        return {name: self.probability.get(name, {name: 1.0}) for name in self.names}

    @property
    def groups(self) -> Sequence[tuple[str, ...]]:
        """Groups of look-alikes; the first of each is the effect."""
        return [tuple(group) for group in self.acting.values() if len(group) > 1]

    def acting_beside(self, own: Mapping[str, float]) -> dict[str, float]:
        """Probability that each effect acts, for all fabrics or for one alone.

        Args:
            own: That it acts for the one alone.

        Returns:
            By effect, the larger of the two probabilities; of the shared effects themselves the first.
        """
        for_all = self._for_all()
        larger = {name: max(p, own.get(name, 0.0)) for name, p in for_all.items()}
        return {**own, **larger, **{name: for_all[name] for name in self.names}}

    def likelier_than(self, own: Mapping[str, float]) -> dict[str, Candidate]:
        """Look-alikes that act for all fabrics sooner than for one alone.

        Args:
            own: Probability that each effect acts for the one alone.

        Returns:
            By name, at the parameters that all would share.
        """
        for_all = self._for_all()
        return {name: one for name, one in self.look_alikes.items() if for_all.get(name, 0.0) >= own.get(name, 0.0)}

    def _for_all(self) -> dict[str, float]:
        """Probability that an effect acts for all fabrics; that of a look-alike of two is the larger one."""
        found: dict[str, float] = {}
        for group in self.acting.values():
            for name, p in group.items():
                found[name] = max(p, found.get(name, 0.0))
        return found
