"""Probabilities of causes that silhouettes hardly tell apart, made more even within each group.

In the atlas the members of a group of `EQUIVALENTS` differ by less than base models differ from one another: in cases
from other simulators most such causes were taken for another member of their group, and with confidence. The posterior
cannot know that. Creep shows as a drift from capture to capture; without repeated captures nothing tells it from
friction.

What another member of its group does in a cause's place says nothing of where it would stand in that place: beside the
true cause, a look-alike is drawn only to mend details, often with the wrong sign. So the probability that a cause takes
over from its group is spread over its points in the place of the group.
"""

from collections import defaultdict
from collections.abc import Collection, Mapping
from dataclasses import replace

from jaxtyping import Float
from numpy import ndarray
from scipy.special import softmax

from cusick_bench.diagnosis.inference.sets.fabric_sets import FabricSets
from cusick_bench.diagnosis.inference.sets.set_sampler import SetPosterior
from cusick_bench.diagnosis.inference.single_effects.equivalents import EQUIVALENTS
from cusick_bench.sim.effects import registered
from cusick_bench.sim.effects.effect_timing import acts_later

UNSURE = 0.6
"""Share of a cause's probability that is spread evenly over the group."""


def evened_out(posterior: SetPosterior, *, drift_known: bool = True) -> SetPosterior:
    """The posterior with probabilities made more even among causes that silhouettes hardly tell apart.

    Args:
        posterior: Posterior over sets of effects of one fabric.
        drift_known: Whether repeated captures show how drapes drift. If not, a cause that acts on later captures shares
            all of its probability with its group, and comes last in it, since the others can be simulated.

    Returns:
        The posterior in which a share of each such cause's probability is spread evenly over its group, as far as the
        members may act in this fabric.
    """
    effects, leading, sets = dict(posterior.effects), dict(posterior.leading), dict(posterior.sets)
    for group in EQUIVALENTS:
        members = sorted(group.effects & effects.keys())
        if len(members) > 1:
            drifting = [] if drift_known else [name for name in members if acts_later(registered()[name])]
            share = 1.0 if drifting else UNSURE
            members.sort(key=lambda name: name in drifting)
            effects, leading = (
                _moved_to_end(_evened_probabilities(one, members, share), drifting) for one in (effects, leading)
            )
            sets = _evened_sets(sets, members, share)
    return replace(posterior, effects=effects, leading=leading, sets=dict(sorted(sets.items(), key=lambda s: -s[1])))


def evened_weights(sets: FabricSets, evened: SetPosterior) -> Float[ndarray, "points"]:
    """Probability of each point after probabilities have been made more even.

    Args:
        sets: Sets of effects of a fabric, as they were sampled.
        evened: Their posterior from `evened_out`.

    Returns:
        The probabilities; those of an effect's points add up to its own.
    """
    points, before = sets.model.points, sets.posterior
    weight = before.weight.copy()
    for group in EQUIVALENTS:
        members = sorted(group.effects & before.effects.keys())
        gains = {name: evened.effects[name] - before.effects[name] for name in members}
        if not any(gain > 0 for gain in gains.values()):
            continue
        others = [point for point in before.best if points.name(point) not in members]
        in_place = sets.model.likelihoods(others, more=sets.more).total[:-1] + points.log_prior
        for name, gain in gains.items():
            own = points.effect == points.names.index(name)
            if gain > 0:
                weight[own] += gain * softmax(in_place[own])
            elif gain < 0:
                weight[own] *= evened.effects[name] / before.effects[name]
    return weight


def _evened_probabilities(
    probability: Mapping[str, float], members: Collection[str], unsure: float
) -> dict[str, float]:
    mean = sum(probability[name] for name in members) / len(members)
    return {n: (1 - unsure) * p + unsure * mean if n in members else p for n, p in probability.items()}


def _moved_to_end(probability: dict[str, float], names: Collection[str]) -> dict[str, float]:
    """The same probabilities, with some names moved to the end: of equally likely effects the first one is named."""
    return {**{n: p for n, p in probability.items() if n not in names}, **{n: probability[n] for n in names}}


def _evened_sets(
    sets: Mapping[tuple[str, ...], float], members: Collection[str], unsure: float
) -> dict[tuple[str, ...], float]:
    """Probabilities of sets: one that holds a single member of the group shares with those that hold another member.

    Sets with several members stay as they are.
    """
    found: dict[tuple[str, ...], float] = defaultdict(float)
    for names, share in sets.items():
        if sum(name in members for name in names) != 1:
            found[names] += share
            continue
        others = [name for name in names if name not in members]
        if unsure < 1:
            found[names] += (1 - unsure) * share
        for name in members:
            found[tuple(sorted([*others, name]))] += unsure * share / len(members)
    return dict(found)
