"""Diagnosis of one fabric: where simulation and data differ, which effects explain it, how far the gap shrinks.

    features -> residual of the best base model -> posterior over sets of effects -> verdict, named set, budget
             -> place, measurements to make next -> simulation of base and set -> gap, closure on unseen samples

The first line is linear algebra on the atlas (seconds); only the last step simulates. The only inputs are the captures,
their protocol and the atlas, and optionally effects of the laboratory that other fabrics of the same data set show.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.inference.fabric_evidence import FabricEvidence, fabric_evidence
from cusick_bench.diagnosis.inference.findings.budget import Budget
from cusick_bench.diagnosis.inference.findings.intervals import ParameterInterval, parameter_intervals
from cusick_bench.diagnosis.inference.findings.novelty import Novelty
from cusick_bench.diagnosis.inference.findings.one_face import FacesShown
from cusick_bench.diagnosis.inference.findings.verdict import Verdict
from cusick_bench.diagnosis.inference.residuals.feature_rows import as_seen
from cusick_bench.diagnosis.inference.residuals.noise import noise, scatter_of
from cusick_bench.diagnosis.inference.residuals.residual import Residual, base_vector, feature_vector
from cusick_bench.diagnosis.inference.residuals.samples import SampleStatistics
from cusick_bench.diagnosis.inference.sets.shared_causes import SharedCauses
from cusick_bench.diagnosis.inference.single_effects.baselines import largest_marginal_score, lasso_without_projection
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate, Grid
from cusick_bench.diagnosis.inference.single_effects.hypotheses import shifts
from cusick_bench.diagnosis.inference.single_effects.localise import Place, place
from cusick_bench.diagnosis.inference.single_effects.next_measurement import TURN_OVER, Advice, advise
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.diagnosis.measure.features import Features
from cusick_bench.diagnosis.measure.gap import Gap
from cusick_bench.diagnosis.options import ONE_SAMPLE, Options
from cusick_bench.diagnosis.simulation.closure import Closure, Draping, closures
from cusick_bench.sim.effects.effect_timing import acts_later
from cusick_bench.sim.setup import Simulators

_SEED = 20
_MOST_EXCHANGES = 2  # look-alikes that are simulated, too: each takes half as long as the named set


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Which effects a fabric's drapes show, how surely, and how far they close the gap.

    Attributes:
        fabric: Name of the fabric.
        verdict: No effect, one, several, one of a group of look-alikes, or something that is not on the list.
        p: p-value of the base model: probability of at least so much evidence for any effect where none acts.
        probability: Probability that each effect, `none` or `unknown` accounts for most; these add up to 1.
        acting: Probability that each effect acts, alone or with others.
        sets: Probability of each set of effects, those of the laboratory included, the likeliest first.
        set90: The fewest of effects, `none` and `unknown` that hold 90 % of `probability`, and the named ones.
        effects: The named set, the likeliest first.
        groups: Look-alikes of which one acts beside the named set.
        causes: The named effects at their best parameters with the likeliest of each group, the largest shift first;
            the likeliest set where there is neither though something acts.
        intervals: 90 % intervals of the parameters of every effect that may act; none of a look-alike of what the
            laboratory's fabrics share.
        best: Every effect that may act, at its likeliest parameters, by its name; such a look-alike at those that all
            fabrics would share.
        shared: The effects of the named set that belong to the laboratory, found from all its fabrics.
        budget: Share of the gap that each cause takes; None where there is no gap to share.
        novelty: Whether the likeliest set is all that acts.
        misfit: Size of the base model's error in statistics that symmetry allows it to get wrong, in standard
            deviations of the noise.
        place: Where the named cause with a place acts.
        advice: What to measure next.
        plain: Residual of the data's features after the best base model without effects.
        residual: Residual linearised at the joint optimum with the likeliest set; `plain` where nothing is named.
        features: Features of the data.
        emulator: The atlas, with the fabric's own outlines.
        baselines: Probability of each effect by simpler methods, by their names.
        notes: What was left out or is in doubt.
        without: Effects that were not considered.
        simulated: Gap, and closure by the causes together; None where nothing was simulated.
    """

    fabric: str
    verdict: Verdict
    p: float
    probability: Mapping[str, float]
    acting: Mapping[str, float]
    sets: Mapping[tuple[str, ...], float]
    set90: tuple[str, ...]
    effects: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]
    causes: tuple[Candidate, ...]
    intervals: Mapping[str, Mapping[str, ParameterInterval]]
    best: Mapping[str, Candidate]
    shared: tuple[str, ...]
    budget: Budget | None
    novelty: Novelty
    misfit: float
    place: Place
    advice: list[Advice]
    plain: Residual
    residual: Residual
    features: Features
    emulator: Emulator
    baselines: Mapping[str, dict[str, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    simulated: Closure | None = None

    @property
    def gap(self) -> Gap | None:
        """Gap, floor and closure; None where nothing was simulated or could be."""
        return None if self.simulated is None else self.simulated.gap


def diagnose(
    captures: Captures,
    emulator: Emulator,
    calibration: Calibration | None = None,
    options: Options | None = None,
    *,
    shared: SharedCauses | None = None,
    simulators: Simulators | None = None,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Diagnosis:
    """Diagnoses one fabric.

    Args:
        captures: Its silhouettes.
        emulator: The atlas, calibrated.
        calibration: Calibration of the probabilities; theory by default.
        options: How to diagnose.
        shared: What all fabrics of its laboratory show; nothing by default.
        simulators: Simulators that are reused from fabric to fabric.
        progress: Called with what is being done and the share that is done.

    Returns:
        The diagnosis.

    Raises:
        Refused: Another geometry than the atlas', one sample only, or a cloth beyond the atlas.
        DiagnosisError: No usable drape, or a single sample to simulate.
    """
    chosen, known = options or Options(), calibration or Calibration()
    if chosen.samples == 1:
        raise DiagnosisError(ONE_SAMPLE)
    generator = np.random.default_rng([_SEED, chosen.seed])
    progress("statistics, base model, sets of effects", 0.0)
    common = shared or SharedCauses()
    evidence = fabric_evidence(captures, emulator, known, generator, without=chosen.without, shared=common)
    found, sets, notes = evidence.finding, evidence.sets, list(evidence.notes)
    if any(acts_later(one.hypothesis.effect) for one in evidence.causes):
        notes.append("the gap compares drapes, not their drift from picture to picture: creep takes no part in closure")
    own = sets.posterior.effects
    stand_ins = common.likelier_than(own)
    best, acting = {**evidence.best, **stand_ins}, common.acting_beside(own)
    simulated = None
    if chosen.samples and (evidence.causes or chosen.always):
        simulated = closures(
            replace(emulator, warp_seen_down=captures.warp_seen_down), evidence.samples, sets.residual,
            [evidence.causes], Draping(chosen.samples, chosen.seed, simulators or Simulators(most=20)),
            look_alikes=_exchanges(found.groups, evidence.causes, best, acting),
            progress=lambda share: progress("simulating", share),
        )[0]  # fmt: skip
    progress("done", 1.0)
    shown = FacesShown(evidence.features.single, captures.warp_seen_down)
    of_this_fabric = {name: one for name, one in best.items() if name not in stand_ins}
    return Diagnosis(
        fabric=captures.fabric,
        verdict=found.verdict,
        p=evidence.p,
        probability=found.leading,
        acting=acting,
        sets={tuple(sorted({*common.names, *names})): p for names, p in sets.posterior.sets.items()},
        set90=found.set90,
        effects=found.effects,
        groups=found.groups,
        causes=tuple(map(shown.on_the_bench, evidence.causes)),
        intervals=parameter_intervals(sets.model.points, sets.posterior, of_this_fabric, shown),
        best={name: shown.on_the_bench(one) for name, one in best.items()},
        shared=common.names,
        budget=evidence.budget,
        novelty=evidence.novelty,
        misfit=sets.posterior.misfit,
        place=_place(evidence),
        advice=advise(
            found.leading,
            shared=common.acting,
            made=(TURN_OVER,) if {"up", "down"} <= set(captures.side) else (),
        ),
        plain=evidence.plain,
        residual=sets.residual if evidence.causes else evidence.plain,
        features=evidence.features,
        emulator=evidence.data.emulator,
        baselines=_baselines(
            evidence.data.emulator,
            evidence.features,
            evidence.samples,
            evidence.plain,
            evidence.data.grids(evidence.plain),
        ),
        notes=tuple(notes),
        without=chosen.without,
        simulated=simulated,
    )


def _exchanges(
    groups: Sequence[tuple[str, ...]],
    causes: Sequence[Candidate],
    best: Mapping[str, Candidate],
    acting: Mapping[str, float],
) -> dict[str, Candidate]:
    """Of the groups of which a cause stands for one, the likeliest others to simulate in its place, by the cause."""
    simulated = {one.hypothesis.name for one in causes}
    stand_for = [(first, group) for group in groups if (first := next((n for n in group if n in simulated), ""))]
    pairs = [(first, name) for first, group in stand_for for name in group if name in best and name not in simulated]
    chosen: dict[str, Candidate] = {}
    for first, name in sorted(pairs, key=lambda pair: -acting.get(pair[1], 0.0)):
        if first not in chosen and best[name] not in chosen.values() and len(chosen) < _MOST_EXCHANGES:
            chosen[first] = best[name]
    return chosen


def _place(evidence: FabricEvidence) -> Place:
    """Place of the named cause that has one, after the shifts of the others are subtracted."""
    data, at = evidence.data, evidence.sets.residual
    named = [one for one in evidence.causes if one.hypothesis.name in evidence.finding.effects]
    local = [one for one in named if one.hypothesis.effect.located in ("patch", "ring")]
    one = next(iter([*local, *named]), None)
    others = [other for other in evidence.causes if other is not one]
    left = at.white - at.whiten(data.shift(others, at)[None])[0]
    shift = None if one is None else at.whiten(data.shift([one], at)[None])[0]
    return place(one, left, data.grids(at), shift)


def _baselines(
    emulator: Emulator, features: Features, samples: SampleStatistics, residual: Residual, grids: Sequence[Grid]
) -> dict[str, dict[str, float]]:
    """Simpler methods, on data minus the best base model as it stands."""
    unprojected = noise(emulator, residual.theta, features, scatter_of(samples.specimens))
    sd, kept = unprojected.sd, residual.kept
    scale = np.sqrt(np.diag(unprojected.covariance))[kept]
    value = (feature_vector(features, sd) - base_vector(emulator, residual.theta, sd))[kept] / scale
    moved = [
        as_seen(shifts(emulator, grid.hypothesis, residual.theta, sd, samples.later).features, features.single)[:, kept]
        / scale
        for grid in grids
    ]
    return {
        "largest-marginal-score": largest_marginal_score(value, grids, moved),
        "lasso-without-projection": lasso_without_projection(value, grids, moved),
    }
