"""Probabilities of causes that silhouettes hardly tell apart, spread over those alike.

What tells one of `EQUIVALENTS` from the others in the atlas is less than what base models differ by: of such causes in
other simulators most were taken for one of their likes, and with confidence. A posterior knows nothing of that.
"""

from collections import defaultdict
from collections.abc import Collection, Mapping
from dataclasses import replace

from cusick_bench.diagnosis.inference.sets.set_sampler import SetPosterior
from cusick_bench.diagnosis.inference.single_effects.equivalents import EQUIVALENTS

UNSURE = 0.6
"""Share of a cause's probability that is spread evenly over the group."""


def evened_out(posterior: SetPosterior) -> SetPosterior:
    """Probabilities that do not claim to tell apart what silhouettes hardly tell apart.

    Args:
        posterior: Posterior over sets of effects of one fabric.

    Returns:
        The same, with a share of the probability of every such cause spread over those like it that may act here.
    """
    effects, leading, sets = dict(posterior.effects), dict(posterior.leading), dict(posterior.sets)
    for group in EQUIVALENTS:
        members = sorted(group.effects & effects.keys())
        if len(members) > 1:
            effects, leading, sets = _evened(effects, members), _evened(leading, members), _evened_sets(sets, members)
    return replace(posterior, effects=effects, leading=leading, sets=dict(sorted(sets.items(), key=lambda s: -s[1])))


def _evened(probability: Mapping[str, float], members: Collection[str]) -> dict[str, float]:
    mean = sum(probability[name] for name in members) / len(members)
    return {n: (1 - UNSURE) * p + UNSURE * mean if n in members else p for n, p in probability.items()}


def _evened_sets(sets: Mapping[tuple[str, ...], float], members: Collection[str]) -> dict[tuple[str, ...], float]:
    """Where one of them acts alone, any of them may; where several act together, they do."""
    found: dict[tuple[str, ...], float] = defaultdict(float)
    for names, share in sets.items():
        if sum(name in members for name in names) != 1:
            found[names] += share
            continue
        found[names] += (1 - UNSURE) * share
        others = [name for name in names if name not in members]
        for name in members:
            found[tuple(sorted([*others, name]))] += UNSURE * share / len(members)
    return dict(found)
