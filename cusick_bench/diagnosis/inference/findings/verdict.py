"""From the posterior over sets to a verdict: none, one effect, several, one of several, or something else."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from cusick_bench.diagnosis.inference.findings.detection import ALPHA
from cusick_bench.diagnosis.inference.findings.novelty import Novelty
from cusick_bench.diagnosis.inference.sets.set_sampler import SetPosterior
from cusick_bench.diagnosis.inference.single_effects.evidence import NONE, UNKNOWN

Verdict = Literal["none", "effect", "several", "ambiguous", "unknown", "refused"]
"""No effect, one, several together, one of some, something that is not on the list, or no diagnosis at all."""
SET_LEVEL = 0.9
NAMED = 0.6
"""Probability from which an effect is named, or a group of look-alikes out of which one acts."""
_TOGETHER = 0.5  # largest probability that two look-alikes act together, over that of independent effects
_LIKELY = 0.05  # least probability of a member of a group
_CARRIES = 0.5  # least share explained by a set that accounts for most, of what no base model explains
_LEAST_NONE = 0.75  # least probability of `none` where it is the verdict; effects too weak to detect count as none
_LEAST_UNKNOWN = 0.6  # least probability of `unknown` where it is the verdict


@dataclass(frozen=True)
class Finding:
    """The verdict on a fabric, and what is named.

    Attributes:
        verdict: The verdict.
        effects: The named set, the likeliest first.
        groups: Look-alikes of which one acts, beside the named set.
        set90: The fewest causes that hold 90 % of the probability, and the named ones.
        leading: Probability that each effect, `none` or `unknown` accounts for most; they add up to 1. All effects of
            the laboratory are included.
        notes: Remarks for the reader.
    """

    verdict: Verdict
    effects: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]
    set90: tuple[str, ...]
    leading: Mapping[str, float]
    notes: tuple[str, ...] = ()


def set90(probability: Mapping[str, float]) -> tuple[str, ...]:
    """The fewest causes that hold 90 % of the probability.

    Args:
        probability: Probabilities that add up to 1.

    Returns:
        Their names, the likeliest first.
    """
    names: list[str] = []
    for name in sorted(probability, key=lambda n: -probability[n]):
        names.append(name)
        if sum(probability[n] for n in names) >= SET_LEVEL:
            break
    return tuple(names)


def finding(
    p: float,
    posterior: SetPosterior,
    test: Novelty,
    shared: Sequence[str] = (),
    alike: Sequence[tuple[str, ...]] = (),
) -> Finding:
    """The verdict.

    Args:
        p: p-value of the base model together with the laboratory's effects.
        posterior: Posterior over sets.
        test: Whether the likeliest set is all that acts.
        shared: Effects of the laboratory that all its fabrics show, the likeliest first; they are named in each.
        alike: Groups of look-alikes of which all fabrics show one; the first of each is among the shared effects, and
            stands for the group instead of being named.

    Returns:
        What is found.
    """
    leading = _with_shared(posterior.leading, shared)
    standing = {group[0] for group in alike}
    certain = tuple(name for name in shared if name not in standing)
    members_of_groups = tuple(name for group in alike for name in group)
    if p > ALPHA:
        leading = _at_least(leading, shared[0] if shared else NONE, _LEAST_NONE)
        members = _members_with_named(leading, (*certain, *members_of_groups) or (NONE,))
        return Finding(_verdict(certain, tuple(alike)), certain, tuple(alike), members, leading)
    acting = {**dict.fromkeys(certain, 1.0), **posterior.effects}
    named = tuple(sorted((n for n, p in acting.items() if p >= NAMED), key=lambda n: -acting[n]))
    groups = (*alike, *look_alikes(posterior, named))
    unlisted = test.rejected
    leading = _with_unlisted(leading, test.probability)
    if unlisted and (not (named or groups) or test.explained < _CARRIES):
        leading = _at_least(leading, UNKNOWN, _LEAST_UNKNOWN)
        members = _members_with_named(leading, (*named, *members_of_groups, UNKNOWN))
        return Finding(UNKNOWN, named, groups, members, leading, _mimicry_note(named))
    members = _members_with_named(leading, (*named, *members_of_groups, *((UNKNOWN,) if unlisted else ())))
    notes = (f"something that is not on the list acts too (p = {test.p:.2g})",) if unlisted else ()
    notes += tuple(f"beside the named effects one of {', '.join(group)} acts" for group in groups if named)
    return Finding("ambiguous" if not named else _verdict(named, groups), named, groups, members, leading, notes)


def _verdict(named: Sequence[str], groups: Sequence[tuple[str, ...]]) -> Verdict:
    """The verdict on named effects and groups, of which there may be none."""
    if len(named) + len(groups) > 1:
        return "several" if named else "ambiguous"
    return "effect" if named else "ambiguous" if groups else NONE


def look_alikes(posterior: SetPosterior, named: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Groups of effects of which one acts, though it cannot be told which.

    Args:
        posterior: Posterior over sets.
        named: Effects that are named.

    Returns:
        The groups, each with a probability of at least `NAMED` that one of it acts.
    """
    left = [n for n, p in sorted(posterior.effects.items(), key=lambda i: -i[1]) if n not in named and p >= _LIKELY]
    groups = []
    while left:
        group = [left.pop(0)]
        for name in list(left):
            if all(_exclude(posterior, name, other) for other in group):
                group.append(name)
                left.remove(name)
        if len(group) > 1 and _any_of(posterior, group) >= NAMED:
            groups.append(tuple(group))
        elif len(group) > 1:
            left = group[1:] + left
    return tuple(groups)


def _exclude(posterior: SetPosterior, first: str, second: str) -> bool:
    """Whether two effects act together much more rarely than if they were independent: they explain the same thing."""
    both = sum(share for names, share in posterior.sets.items() if first in names and second in names)
    return both <= _TOGETHER * posterior.effects[first] * posterior.effects[second]


def _any_of(posterior: SetPosterior, group: Sequence[str]) -> float:
    return sum(share for names, share in posterior.sets.items() if set(group) & set(names))


def _with_shared(leading: Mapping[str, float], shared: Sequence[str]) -> dict[str, float]:
    """Probabilities in which the likeliest effect of the laboratory takes the place of `none`."""
    if not shared:
        return dict(leading)
    return {**leading, **dict.fromkeys(shared, 0.0), shared[0]: leading[NONE], NONE: 0.0}


def _with_unlisted(leading: Mapping[str, float], probability: float) -> dict[str, float]:
    """Probabilities with a further probability of something unlisted, from goodness of fit."""
    mixed = {name: (1 - probability) * value for name, value in leading.items()}
    return {**mixed, UNKNOWN: mixed[UNKNOWN] + probability}


def _at_least(leading: Mapping[str, float], name: str, least: float) -> dict[str, float]:
    """Probabilities scaled such that one of them has at least a given value."""
    if leading[name] >= least:
        return dict(leading)
    scale = (1 - least) / (1 - leading[name])
    return {other: least if other == name else value * scale for other, value in leading.items()}


def _members_with_named(leading: Mapping[str, float], named: Sequence[str]) -> tuple[str, ...]:
    """The 90 % set, with what is named."""
    return tuple(dict.fromkeys((*set90(leading), *named)))


def _mimicry_note(named: Sequence[str]) -> tuple[str, ...]:
    """Note on the effects that imitate an unlisted cause."""
    return (f"an unlisted cause is taken for it in part by {', '.join(named)}",) if named else ()
