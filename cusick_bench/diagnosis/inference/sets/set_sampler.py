"""Posterior over sets of effects by Gibbs sampling of one effect at a time, out of all points of all effects.

A set has up to `MOST` places. One place at a time is emptied and drawn again given the others: nothing, or any point of
any effect that is not in the set. So look-alikes are exchanged in one step. Every step gives the conditional
probabilities of all effects, and these are averaged (Rao-Blackwell) instead of the effects that were drawn. Chains
start from the empty set and from forward selection; a chain whose sets are far less likely than another's is left out.

References:
    Gelfand, Smith. Sampling-based approaches to calculating marginal densities. JASA 85(410), 1990.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.special import logsumexp

from cusick_bench.diagnosis.inference.sets.misfit import ANY_SIZES, MISFIT_SIZES
from cusick_bench.diagnosis.inference.sets.set_model import MOST, SetModel, SharedShift
from cusick_bench.diagnosis.inference.single_effects.evidence import NONE, UNKNOWN

STEPS: Final = 120
"""Steps of each chain, after a fifth as many that are not counted."""
_CHAINS = 3
_FAR = 8.0  # [nat] distance below the likeliest chain's mean from which a chain is left out
_KEPT = 200  # largest number of conditionals in memory


@dataclass(frozen=True, eq=False)
class Conditional:
    """One place of a set, given the others.

    Attributes:
        options: Probability of each point, and last of nothing.
        log_joint: Log joint probability of the set with each of them.
        effects: Probability that each effect is in the set.
        leading: Probability that each effect, then `none`, then `unknown` accounts for most.
        symmetric: Probability of each of `MISFIT_SIZES`.
    """

    options: Float[ndarray, "options"]
    log_joint: Float[ndarray, "options"]
    effects: Float[ndarray, "effects"]
    leading: Float[ndarray, "causes"]
    symmetric: Float[ndarray, "symmetric"]


@dataclass(frozen=True, eq=False)
class SetPosterior:
    """Posterior over sets of effects.

    Attributes:
        effects: Probability that each effect acts.
        leading: Probability that an effect, `none` or `unknown` accounts for most; these add up to 1.
        sets: Probability of each set, the likeliest first.
        best: The likeliest set of points of all that were drawn.
        weight: Probability of each point.
        misfit: Mean size s of the base model's misfit.
    """

    effects: Mapping[str, float]
    leading: Mapping[str, float]
    sets: Mapping[tuple[str, ...], float]
    best: tuple[int, ...]
    weight: Float[ndarray, "points"]
    misfit: float


def conditional(model: SetModel, others: Sequence[int], more: SharedShift | None = None) -> Conditional:
    """Probabilities of one place of a set.

    Args:
        model: The fabric.
        others: Points in the other places.
        more: A shift beside that of the set.

    Returns:
        The probabilities.
    """
    points, count = model.points, len(others)
    likelihoods = model.likelihoods(others, more=more)
    taken = np.isin(points.effect, points.effect[list(others)])
    prior = np.where(taken, -np.inf, points.log_prior) + model.log_prior(min(count + 1, MOST))
    own = float(points.log_prior[list(others)].sum())
    log_joint = likelihoods.total + own + np.append(prior, model.log_prior(count))
    # Places are distinguishable: one effect more can stand in any of the free places, which share its prior.
    weighed = log_joint - np.append(np.full(len(points), np.log(MOST - count)), 0.0)
    options = np.exp(weighed - float(np.logaddexp.reduce(weighed)))
    effects = np.bincount(points.effect, options[:-1], minlength=len(points.names)).astype(np.float64)
    effects[points.effect[list(others)]] = 1.0
    sizes = np.exp(likelihoods.symmetric - logsumexp(likelihoods.symmetric, axis=1, keepdims=True))
    beyond = np.exp(likelihoods.anything - logsumexp(likelihoods.anything, axis=1, keepdims=True))
    leading = _leading(model, others, options, beyond)
    return Conditional(options, log_joint, effects, leading, options @ sizes)


def _leading(model: SetModel, others: Sequence[int], options: ndarray, beyond: ndarray) -> Float[ndarray, "causes"]:
    """Probability of what accounts for most: the effect with the largest shift, or unlisted causes if larger.

    Args:
        model: The fabric.
        others: Points in the other places.
        options: Probability of each point in the place that is filled, and last of nothing.
        beyond: Probability of each of `ANY_SIZES`, for each option.
    """
    points = model.points
    none = len(points.names)
    unknown = none + 1  # causes are numbered: effects, `none`, `unknown`
    size = np.append(points.size(), 0.0)
    largest_other = max(others, key=lambda point: size[point], default=None)
    least = 0.0 if largest_other is None else float(size[largest_other])
    of_others = none if largest_other is None else int(points.effect[largest_other])
    leader = np.append(np.where(size[:-1] > least, points.effect, of_others), of_others)
    unlisted_size = ANY_SIZES * np.sqrt(model.misfit.forbidden)
    unlisted_leads = np.minimum((beyond * (unlisted_size > np.maximum(size, least)[:, None])).sum(1), 1.0)
    leading = np.bincount(leader, options * (1 - unlisted_leads), minlength=unknown + 1)
    leading[unknown] = float(options @ unlisted_leads)
    return leading


@dataclass(eq=False)
class _Chain:
    """A walk over sets, and the sums that its probabilities are made of."""

    model: SetModel
    more: SharedShift | None
    known: dict[tuple[int, ...], Conditional]
    state: list[int] = field(default_factory=list)
    log_joints: list[float] = field(default_factory=list)
    visited: list[tuple[int, ...]] = field(default_factory=list)
    seen: list[tuple[tuple[int, ...], Conditional]] = field(default_factory=list)

    def given(self, others: tuple[int, ...]) -> Conditional:
        """The conditional, which may have been made before."""
        key = tuple(sorted(others))
        if key not in self.known:
            if len(self.known) >= _KEPT:
                self.known.pop(next(iter(self.known)))
            self.known[key] = conditional(self.model, key, self.more)
        return self.known[key]

    def step(self, generator: np.random.Generator, *, counts: bool) -> None:
        """Empties a place and fills it anew."""
        place = int(generator.integers(MOST))
        others = tuple(self.state[:place] + self.state[place + 1 :])
        given = self.given(others)
        option = draw_option(given.options, generator)
        self.state = list(others) + ([option] if option < len(self.model.points) else [])
        if counts:
            self.seen.append((others, given))
            self.visited.append(tuple(sorted(self.state)))
            self.log_joints.append(float(given.log_joint[option]))


def draw_option(options: Float[ndarray, "options"], generator: np.random.Generator) -> int:
    """One of several options.

    Args:
        options: Their probabilities.
        generator: Generator of the draw.

    Returns:
        Its index.
    """
    place = int(np.searchsorted(np.cumsum(options), generator.random() * options.sum()))
    return min(place, len(options) - 1)


def forward_selection(model: SetModel, more: SharedShift | None = None) -> list[int]:
    """Adds the likeliest effect again and again, as long as that makes the set likelier.

    Args:
        model: The fabric.
        more: A shift beside that of the set.

    Returns:
        Points of the selected effects.
    """
    chosen: list[int] = []
    while len(chosen) < MOST:
        given = conditional(model, chosen, more)
        if given.options[-1] > 0.5:
            break
        by_effect = np.bincount(model.points.effect, given.options[:-1], minlength=len(model.points.names))
        added = model.points.densest(int(np.argmax(by_effect)), given.options[:-1])
        chosen = _settled(model, [*chosen, added], more)
    return chosen


def _settled(model: SetModel, chosen: list[int], more: SharedShift | None) -> list[int]:
    """Each effect of a set at its likeliest point given the others."""
    for place in range(len(chosen) - 1):
        others = chosen[:place] + chosen[place + 1 :]
        options = conditional(model, others, more).options[:-1]
        best = model.points.densest(int(model.points.effect[chosen[place]]), options)
        if options[best] > 0:
            chosen[place] = best
    return chosen


def sample_sets(
    model: SetModel, generator: np.random.Generator, *, steps: int = STEPS, more: SharedShift | None = None
) -> SetPosterior:
    """Posterior over sets.

    Args:
        model: The fabric.
        generator: Generator of the chains.
        steps: Steps of each chain.
        more: A shift beside that of the set.

    Returns:
        The posterior.
    """
    known: dict[tuple[int, ...], Conditional] = {}
    selected = forward_selection(model, more)
    chains = []
    for number in range(_CHAINS):
        chain = _Chain(model, more, known, list(selected) if number % 2 else [])
        for step in range(steps + steps // 5):
            chain.step(generator, counts=step >= steps // 5)
        chains.append(chain)
    likeliest = max(float(np.mean(chain.log_joints)) for chain in chains)
    return _pooled(model, [chain for chain in chains if np.mean(chain.log_joints) > likeliest - _FAR])


def _pooled(model: SetModel, chains: Sequence[_Chain]) -> SetPosterior:
    points = model.points
    steps = [one for chain in chains for one in chain.seen]
    effects, leading = (np.mean([getattr(c, part) for _, c in steps], axis=0) for part in ("effects", "leading"))
    weight = np.zeros(len(points))
    for others, given in steps:
        weight += given.options[:-1] / len(steps)
        weight[list(others)] += 1 / len(steps)
    draws = [draw for chain in chains for draw in chain.visited]
    joint = [value for chain in chains for value in chain.log_joints]
    sets = Counter(tuple(sorted(points.name(point) for point in draw)) for draw in draws)
    return SetPosterior(
        dict(zip(points.names, effects.tolist(), strict=True)),
        dict(zip((*points.names, NONE, UNKNOWN), leading.tolist(), strict=True)),
        {names: count / len(draws) for names, count in sets.most_common()},
        draws[int(np.argmax(joint))],
        weight,
        float(np.mean([c.symmetric @ MISFIT_SIZES for _, c in steps])),
    )
