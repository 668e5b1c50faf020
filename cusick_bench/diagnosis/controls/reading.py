"""What a diagnosis says, as the rules of the controls need it; no other module of the controls reads a `Diagnosis`."""

from collections.abc import Mapping, Set
from dataclasses import dataclass, field

from cusick_bench.diagnosis.diagnose import Diagnosis
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate

REFUSED = "refused"


@dataclass(frozen=True)
class Estimate:
    """An effect's estimated strength.

    Attributes:
        severity: Value of its severity, in the unit of its parameter.
        direction: Its direction [deg]; None for an effect without one.
    """

    severity: float
    direction: float | None = None


@dataclass(frozen=True)
class Reading:
    """What a diagnosis says.

    Attributes:
        verdict: Its verdict, or `refused`.
        p: p-value of the base model; None where refused.
        named: The effects that it names, and look-alikes of which one acts.
        posterior: Probability of every set of listed effects; the empty set stands for no effect.
        estimates: Estimated strength of every effect, named or not.
        notes: What was left out or is in doubt; the reason where it is refused.
    """

    verdict: str
    p: float | None = None
    named: frozenset[str] = frozenset()
    posterior: Mapping[frozenset[str], float] = field(default_factory=dict)
    estimates: Mapping[str, Estimate] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def probability(self, effects: Set[str]) -> float:
        """Probability that at least one of some effects acts.

        Args:
            effects: Their names.

        Returns:
            The probability.
        """
        return sum((share for acting, share in self.posterior.items() if acting & effects), start=0.0)


def read(diagnosis: Diagnosis) -> Reading:
    """Reads a diagnosis.

    Args:
        diagnosis: The diagnosis.

    Returns:
        What it says.
    """
    return Reading(
        diagnosis.verdict,
        diagnosis.p,
        frozenset(diagnosis.effects).union(*diagnosis.groups),
        {frozenset(names): share for names, share in diagnosis.sets.items()},
        {name: _estimate(one) for name, one in diagnosis.best.items()},
        diagnosis.notes,
    )


def refused(why: str) -> Reading:
    """A fabric that is not diagnosed.

    Args:
        why: The reason.

    Returns:
        A reading that names nothing.
    """
    return Reading(REFUSED, notes=(why,))


def _estimate(candidate: Candidate) -> Estimate:
    effect, value = candidate.hypothesis.effect, candidate.value
    direction = next((value[p.name] for p in effect.parameters if p.role == "direction"), None)
    return Estimate(value[effect.severity.name], direction)
