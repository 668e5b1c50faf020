"""Effects of the laboratory, which all fabrics of a data set share: camera, plate, cut.

A camera that stands off its place does so for every fabric. So an effect of the laboratory has one severity and one
direction, in the camera's frame, for all fabrics; effects of the cloth differ from fabric to fabric. Both are sampled
in turn: the shared set given each fabric's own set, by the sum of the fabrics' log likelihoods at every point of the
shared grid, and each fabric's own set given the shared one. Several fabrics may decide what one cannot.

Once the fabrics' own sets have adapted to one of two shared look-alikes (a camera off its place, a plate out of level),
a single step no longer exchanges it for the other. So short chains start from no shared effect and from each single
one, and exchanges of the effects of the likeliest set are tried (`look_alikes`). The likeliest chains with the
likeliest set go on, on grids with finer steps around their points, and are weighted by the geometric mean of the joint
probabilities of what they visit. The finer steps matter: over a dozen fabrics, half a step of a grid costs tens of
nats, and another effect would be added to make up for it.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from threadpoolctl import threadpool_limits

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.errors import Refused
from cusick_bench.diagnosis.inference.laboratory.look_alikes import Exchanges
from cusick_bench.diagnosis.inference.laboratory.shared_effects import (
    Laboratory,
    LaboratoryFabric,
    finer_shared_points,
    shared_points,
    shares,
)
from cusick_bench.diagnosis.inference.laboratory.shared_walk import SharedWalk, pooled
from cusick_bench.diagnosis.inference.residuals.refusal import domain_doubts
from cusick_bench.diagnosis.inference.sets.effect_points import EffectPoints
from cusick_bench.diagnosis.inference.sets.fabric_data import fabric_data
from cusick_bench.diagnosis.inference.sets.fabric_sets import fabric_sets, named_causes
from cusick_bench.diagnosis.inference.sets.refined import shared_set
from cusick_bench.diagnosis.inference.single_effects.evidence import NONE
from cusick_bench.diagnosis.measure.captures import Captures

STEPS: Final = 40
"""Steps of every chain that goes on after the screening."""
_SCREENED = 8  # steps of every chain, after which only the likeliest go on
_SETTLED = 4  # first steps on the finer grids, which do not count
_CHAINS = 2
_OWN_STEPS = 30  # steps of the chains of each fabric alone, which only give a starting point
_LEAST_FABRICS = 2


def laboratory(
    fabrics: Sequence[LaboratoryFabric],
    generator: np.random.Generator,
    *,
    steps: int = STEPS,
    progress: Callable[[float], None] = lambda share: None,
) -> Laboratory | None:
    """Samples the effects that all fabrics share.

    Args:
        fabrics: The fabrics of one data set.
        generator: Generator of the sampler.
        steps: Steps of each chain that goes on.
        progress: Called with the share that is done.

    Returns:
        The laboratory; None of fewer than two fabrics.
    """
    if len(fabrics) < _LEAST_FABRICS:
        return None
    points = [shared_points(fabric) for fabric in fabrics]
    tried = [SharedWalk(fabrics, points, generator, start) for start in ([], *_starts(fabrics, points))]
    for number, chain in enumerate(tried):
        for _ in range(_SCREENED):
            chain.step(counts=False)
        progress(0.3 * (number + 1) / len(tried))
    exchanges = Exchanges(fabrics, generator, progress=lambda share: progress(0.3 + 0.4 * share))
    exchanges.search(max(tried, key=lambda chain: chain.log_joint()))
    likeliest = exchanges.sets[exchanges.likeliest].walk.on(points)
    same = [likeliest, *(chain for chain in tried if chain.names == exchanges.likeliest)]
    chains = sorted(same, key=lambda chain: -chain.log_joint())[:_CHAINS]
    near = {point for chain in chains for point in chain.shared}
    points = [finer_shared_points(fabric, one, near) for fabric, one in zip(fabrics, points, strict=True)]
    chains = [chain.on(points) for chain in chains]
    for number, chain in enumerate(chains):
        for step in range(_SETTLED + steps):
            chain.step(counts=step >= _SETTLED)
        progress(0.7 + 0.3 * (number + 1) / len(chains))
    mean = np.array([np.mean(chain.log_joints) for chain in chains])
    share = np.exp(mean - float(np.logaddexp.reduce(mean)))
    own = chains[int(np.argmax(mean))].own
    named = shared_set([(fabric.data, fabric.sets) for fabric in fabrics], own, pooled(chains, share).named)
    return _with_look_alikes(pooled(chains, share, named), exchanges)


@threadpool_limits.wrap(limits=1, user_api="blas")  # of matrices so small, threads only wait for each other
def laboratory_of(
    captures: Sequence[Captures],
    emulator: Emulator,
    calibration: Calibration,
    generator: np.random.Generator,
    *,
    without: Sequence[str] = (),
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Laboratory | None:
    """Samples the effects that the fabrics of a data set share; fabrics that are refused are left out.

    Args:
        captures: Silhouettes of each fabric.
        emulator: The atlas.
        calibration: Calibration of its probabilities.
        generator: Generator of the samplers.
        without: Effects that are not to be considered.
        progress: Called with what is being done and the share that is done.

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
            likely = named_causes(data, sets, next(iter(sets.posterior.sets)))
            domain_doubts(emulator, data.features, sets.residual, data.shift(likely, sets.residual))
        except Refused:
            continue
        fabrics.append(LaboratoryFabric(one.fabric, data, sets))
    return laboratory(fabrics, generator, progress=lambda share: progress("what they share", (1 + share) / 2))


def _starts(fabrics: Sequence[LaboratoryFabric], points: Sequence[EffectPoints]) -> list[list[int]]:
    """Starting points of chains: the likeliest shared point of each effect that may be shared."""
    chain = SharedWalk(fabrics, points, np.random.default_rng(0), [])
    own = np.sum([chain.given(fabric, ()) for fabric in range(len(fabrics))], axis=0)
    gained = own[:-1] - own[-1] + chain.log_prior
    effect = chain.points[0].effect
    of_effect = [np.flatnonzero(effect == number) for number in np.unique(effect)]
    best = [int(points[np.argmax(gained[points])]) for points in of_effect]
    return [[point] for point in best if np.isfinite(gained[point])]


def _with_look_alikes(found: Laboratory, exchanges: Exchanges) -> Laboratory:
    """The laboratory with what may act in place of the named effects."""
    named = {one.hypothesis.name for one in found.named}
    effects = []
    for one in found.effects:
        if one.name in named:
            look_alikes, without = exchanges.look_alikes(one.name), exchanges.without(one.name)
            nothing = shares({"": 0.0, **look_alikes, NONE: without}, len(found.fabrics))[NONE]
            one = replace(
                one,
                look_alikes=look_alikes,
                in_its_place={other: exchanges.in_place_of(one.name, other) for other in look_alikes},
                probability=one.probability * (1 - nothing),
            )
        effects.append(one)
    return replace(found, effects=tuple(sorted(effects, key=lambda one: -one.probability)))
