"""Posterior over sets of effects of one fabric, with base parameters that are fitted together with the set.

Strong effects pull the base parameters away from their true values, and the shifts of effects depend on these. So the
likeliest set is selected, first on coarse grids and then on grids that are finer about it; its shift is subtracted; the
base parameters are fitted again, and the model is linearised there. This is repeated until the parameters stay. An
effect that looks nearly like another cloth could stay hidden in the base parameters, so the search is also started from
such effects, and the likeliest joint optimum is kept. The posterior is sampled there, with the base parameters
integrated out.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from cusick_bench.diagnosis.inference.residuals.residual import Residual
from cusick_bench.diagnosis.inference.sets.effect_points import EffectPoints
from cusick_bench.diagnosis.inference.sets.fabric_data import FabricData
from cusick_bench.diagnosis.inference.sets.set_model import SetModel, SharedShift
from cusick_bench.diagnosis.inference.sets.set_sampler import STEPS, SetPosterior, forward_selection, sample_sets
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate
from cusick_bench.diagnosis.inference.single_effects.hypotheses import hypotheses

HIDDEN: Final = {"perspective": (2.0,), "threshold": (2.0, -2.0)}
"""Effects that look nearly like another stiffness, and severities to start from, in typical ones."""
_REFITS = 2
_STAYS = 0.3  # change below which base parameters count as unchanged [posterior standard deviations]


@dataclass(frozen=True, eq=False)
class FabricSets:
    """Sets of effects of one fabric.

    Attributes:
        residual: What the base model leaves, linearised at the joint optimum with the likeliest set.
        model: Joint probability of sets there.
        posterior: Posterior over sets of the fabric's own effects.
        shared: Effects of the laboratory that are taken as known.
        more: Their shift.
    """

    residual: Residual
    model: SetModel
    posterior: SetPosterior
    shared: tuple[Candidate, ...] = ()
    more: SharedShift | None = None


def fabric_sets(
    fabric: FabricData,
    plain: Residual,
    generator: np.random.Generator,
    *,
    shared: tuple[Candidate, ...] = (),
    steps: int = STEPS,
    progress: Callable[[float], None] = lambda share: None,
) -> FabricSets:
    """Samples the posterior over sets of effects of one fabric.

    Args:
        fabric: The fabric.
        plain: What the best base model without effects leaves.
        generator: Generator of the sampler.
        shared: Effects of the laboratory that are taken as known.
        steps: Steps of each chain.
        progress: Called with the share of the fits that is over.

    Returns:
        The sets.
    """
    _, residual, model, more = _best_optimum(fabric, plain, shared, progress)
    return FabricSets(residual, model, sample_sets(model, generator, steps=steps, more=more), shared, more)


def best_log_joint(fabric: FabricData, plain: Residual) -> float:
    """Largest log joint density of any set of effects and base parameters: how well a fabric can be explained at all.

    Args:
        fabric: The fabric.
        plain: What the best base model without effects leaves.

    Returns:
        The log density [nat]; comparable between pictures of one fabric that are turned or mirrored.
    """
    return _best_optimum(fabric, plain, ())[0]


def _best_optimum(
    fabric: FabricData,
    plain: Residual,
    shared: tuple[Candidate, ...],
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[float, Residual, SetModel, SharedShift | None]:
    """The likeliest of the joint optima that are reached from all starting points."""
    known = [one.hypothesis.name for one in shared]
    beginnings = [plain, *_starts_with_hidden_effects(fabric, plain, known)]
    optima = []
    for number, beginning in enumerate(beginnings):
        optima.append(_joint_optimum(fabric, beginning, shared))
        progress((number + 1) / (len(beginnings) + 2))
    return max(optima, key=lambda one: one[0])


def _starts_with_hidden_effects(fabric: FabricData, plain: Residual, known: Collection[str]) -> Iterator[Residual]:
    """Starting points: the best base parameters if an effect acts that they could otherwise hide."""
    for one in hypotheses(fabric.emulator):
        if one.name not in known and one.name not in fabric.without:
            for severity in HIDDEN.get(one.name, ()):
                name = one.effect.severity.name
                cause = Candidate(one, {name: severity * one.effect.severity.typical})
                best = fabric.against(start=plain.theta, shift=fabric.shift([cause], plain))
                yield fabric.against(start=best.theta, fixed=True)


def _joint_optimum(
    fabric: FabricData, residual: Residual, shared: tuple[Candidate, ...]
) -> tuple[float, Residual, SetModel, SharedShift | None]:
    """Selects a set and fits the base parameters in turn; the log joint density that is reached comes first."""
    known = [one.hypothesis.name for one in shared]
    refits = 0
    while True:
        coarse = fabric.model(residual, without=known)
        more = fabric.shared_shift(shared, residual, coarse.misfit)
        model = fabric.finer(coarse, residual, forward_selection(coarse, more))
        points = forward_selection(model, more)
        reached = model.log_joint(points, more) - residual.log_unit, residual, model, more
        if refits == _REFITS:
            return reached
        selected = [candidate_at(model.points, point) for point in points]
        joint = fabric.against(start=residual.theta, shift=fabric.shift([*shared, *selected], residual))
        far = np.abs(joint.theta - residual.theta) / np.sqrt(np.diag(residual.theta_covariance))
        if far.max() < _STAYS:
            return reached
        residual, refits = fabric.against(start=joint.theta, fixed=True), refits + 1


def refitted(fabric: FabricData, sets: FabricSets, causes: Sequence[Candidate]) -> FabricSets:
    """Sets of a fabric, linearised anew where base parameters and given causes fit together.

    Args:
        fabric: The fabric.
        sets: Its sets.
        causes: Effects at their best parameters.

    Returns:
        The sets, with the posterior as it was sampled.
    """
    joint = fabric.against(start=sets.residual.theta, shift=fabric.shift(causes, sets.residual))
    residual = fabric.against(start=joint.theta, fixed=True)
    model = fabric.model(residual, without=[one.hypothesis.name for one in sets.shared])
    return replace(sets, residual=residual, model=model, more=fabric.shared_shift(sets.shared, residual, model.misfit))


def candidate_at(points: EffectPoints, point: int) -> Candidate:
    """A point as a cause.

    Args:
        points: All points.
        point: Index of the point.

    Returns:
        The cause.
    """
    hypothesis = points.grids[points.grid[point]].hypothesis
    return Candidate(hypothesis, points.value(point), size=float(np.linalg.norm(points.shift[point])))


def named_causes(fabric: FabricData, sets: FabricSets, names: Sequence[str]) -> tuple[Candidate, ...]:
    """Effects at their likeliest parameters, all of them acting.

    Args:
        fabric: The fabric.
        sets: Its sets.
        names: Effects that are named; those of the laboratory are as they are.

    Returns:
        The causes, the largest shift first.
    """
    own = [name for name in names if name in sets.model.points.names]
    chosen = _likeliest_points(sets, own)
    causes = [*(one for one in sets.shared if one.hypothesis.name in names)]
    causes += [candidate_at(sets.model.points, point) for point in chosen]
    causes = _with_sizes(fabric, sets, causes)
    return tuple(sorted(causes, key=lambda one: -one.size))


def likeliest_candidates(sets: FabricSets) -> dict[str, Candidate]:
    """Every effect at its likeliest point.

    Args:
        sets: Sets of effects of a fabric.

    Returns:
        By name of the effect.
    """
    points = sets.model.points
    found = {one.hypothesis.name: one for one in sets.shared}
    for number, name in enumerate(points.names):
        found[name] = candidate_at(points, points.densest(number, sets.posterior.weight))
    return found


def _likeliest_points(sets: FabricSets, names: Sequence[str]) -> list[int]:
    """A point for each effect: the likeliest by itself, then the likeliest given the others."""
    points, model = sets.model.points, sets.model
    chosen = [points.densest(points.names.index(name), sets.posterior.weight) for name in names]
    for _ in range(2 if len(chosen) > 1 else 1):
        for place, point in enumerate(chosen):
            others = chosen[:place] + chosen[place + 1 :]
            total = model.likelihoods(others, more=sets.more).total[:-1] + points.log_prior - np.log(points.cell)
            total[points.effect != points.effect[point]] = -np.inf
            chosen[place] = int(np.argmax(total))
    return chosen


def _with_sizes(fabric: FabricData, sets: FabricSets, causes: Sequence[Candidate]) -> list[Candidate]:
    """Causes with |d| at the present base parameters."""
    sized = []
    for one in causes:
        shift = sets.residual.whiten(fabric.shift([one], sets.residual)[None])[0]
        sized.append(replace(one, size=float(np.linalg.norm(shift))))
    return sized
