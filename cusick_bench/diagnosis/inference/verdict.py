"""From probabilities of causes to a verdict: none, one effect or a pair, one of several, or something else."""

from collections.abc import Mapping, Sequence
from typing import Literal

from cusick_bench.diagnosis.inference.equivalents import partners
from cusick_bench.diagnosis.inference.evidence import DENSITY_BIAS, NONE, UNKNOWN, Candidate
from cusick_bench.diagnosis.inference.fabric_evidence import ALPHA

Verdict = Literal["none", "effect", "ambiguous", "unknown"]
"""No effect, one (or a pair), one of several, or something that is not on the list."""
SET_LEVEL = 0.9
NAMED = 0.6  # from this probability on one effect is named, below several


def single_causes(probability: Mapping[str, float]) -> dict[str, float]:
    """Probabilities of single causes: a pair's is given to its likelier half, so that all still add up to 1.

    Args:
        probability: Probability of `none`, every effect, pairs (`a + b`) and `unknown`.

    Returns:
        Of `none`, every effect and `unknown`.
    """
    single = {name: value for name, value in probability.items() if " + " not in name}
    for name, value in probability.items():
        if " + " in name:
            leading = max(name.split(" + "), key=lambda part: single.get(part, 0.0))
            single[leading] = single.get(leading, 0.0) + value
    return single


def set90(probability: Mapping[str, float]) -> tuple[str, ...]:
    """The fewest causes that hold 90 % of the probability.

    Args:
        probability: Probability of single causes.

    Returns:
        Their names, the likeliest first.
    """
    names: list[str] = []
    for name in sorted(probability, key=lambda n: -probability[n]):
        names.append(name)
        if sum(probability[n] for n in names) >= SET_LEVEL:
            break
    return tuple(names)


def verdict_of(p: float, probability: Mapping[str, float]) -> tuple[Verdict, str]:
    """The verdict, and what it names.

    No cause is named while the 90 % set also holds one that no silhouette tells from it.

    Args:
        p: p-value of the base model.
        probability: Probability of `none`, every effect, pairs (`a + b`) and `unknown`.

    Returns:
        The verdict; the name of the leading cause or pair, "" if there is none.
    """
    if p > ALPHA:
        return NONE, ""
    causes = {name: value for name, value in probability.items() if name not in (NONE, DENSITY_BIAS)}
    single = single_causes(causes)
    total = sum(causes.values())
    if causes[UNKNOWN] >= 0.5 * total or len(causes) == 1:
        return UNKNOWN, ""
    top = max((name for name in single if name != UNKNOWN), key=lambda name: single[name])
    if single[top] < NAMED * total or partners(top, set90(single_causes(probability))):
        return "ambiguous", top
    with_top = [top, *(name for name in causes if top in name.split(" + ") and name != top)]
    return "effect", max(with_top, key=lambda name: causes[name])


def named_cause(
    name: str,
    best: Sequence[Candidate],
    together: Mapping[str, tuple[Candidate, Candidate]],
    single: Mapping[str, float],
) -> tuple[Candidate, ...]:
    """The named cause at its best parameters.

    Args:
        name: Name of a cause or pair, as `verdict_of` gives it.
        best: Every effect at its best.
        together: Every pair at its best.
        single: Probabilities of single causes.

    Returns:
        The cause; of a pair the half first that its probability is given to; nothing where none is named.
    """
    if not name:
        return ()
    if name in together:
        return tuple(sorted(together[name], key=lambda one: -single.get(one.hypothesis.name, 0.0)))
    return tuple(one for one in best if one.hypothesis.name == name)[:1]
