"""Diagnosis of one fabric: where simulation and data differ, which effect explains it, how far the gap shrinks.

    features -> residual of the best base model -> evidence of every cause -> probabilities and verdict
             -> place, measurements to make next -> simulation of base and cause -> gap, closure on unseen samples

The first line is linear algebra on the atlas (seconds); only the last simulates. Nothing but the captures, their
protocol and the atlas is looked at.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cusick_bench.diagnosis.atlas.effect_timing import acts_later
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.inference.baselines import largest_marginal_score, lasso_without_projection
from cusick_bench.diagnosis.inference.evidence import Candidate, Grid
from cusick_bench.diagnosis.inference.fabric_evidence import ALPHA, SampleStatistics, fabric_evidence
from cusick_bench.diagnosis.inference.feature_rows import as_seen
from cusick_bench.diagnosis.inference.hypotheses import shifts
from cusick_bench.diagnosis.inference.localise import Place, place
from cusick_bench.diagnosis.inference.next_measurement import Advice, advise
from cusick_bench.diagnosis.inference.residual import Residual, base_vector, feature_vector, noise, scatter_of
from cusick_bench.diagnosis.inference.stepwise import Step, forward_selection
from cusick_bench.diagnosis.inference.verdict import Verdict, named_cause, set90, single_causes, verdict_of
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.diagnosis.measure.features import Features
from cusick_bench.diagnosis.measure.gap import Gap
from cusick_bench.diagnosis.options import Options
from cusick_bench.diagnosis.simulation.closure import Closure, Draping, closures
from cusick_bench.sim.setup import Simulators

_SEED = 20


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Which effects a fabric's drapes show, how surely, and how far they close the gap.

    Attributes:
        fabric: Name of the fabric.
        verdict: No effect, one (or a pair), one of several, or something that is not on the list.
        p: p-value of the base model: that so much evidence for anything arises where no effect acts.
        probability: Probability of `none`, every effect, pairs (`a + b`) and `unknown`.
        set90: The fewest of effects, `none` and `unknown` that hold 90 % of the probability.
        best: Every effect at its best parameters, the likeliest first.
        cause: The named cause, if any (two for a pair).
        place: Where the named cause acts.
        advice: What to measure next.
        residual: What the best base model leaves of the data's features.
        features: Features of the data.
        baselines: Probabilities by simpler methods.
        notes: What was left out or is in doubt.
        without: Effects that were not considered.
        steps: Causes taken off one after the other, until no further one shows.
        simulated: Gap, and closure by the named cause; None where nothing was simulated.
        together: Gap, and closure by all steps; None where they are the named cause, or nothing was simulated.
    """

    fabric: str
    verdict: Verdict
    p: float
    probability: dict[str, float]
    set90: tuple[str, ...]
    best: tuple[Candidate, ...]
    cause: tuple[Candidate, ...]
    place: Place
    advice: list[Advice]
    residual: Residual
    features: Features
    baselines: Mapping[str, dict[str, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    steps: tuple[Step, ...] = ()
    simulated: Closure | None = None
    together: Closure | None = None

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
    simulators: Simulators | None = None,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Diagnosis:
    """Diagnoses one fabric.

    Args:
        captures: Its silhouettes.
        emulator: The atlas.
        calibration: Calibration of the probabilities; theory by default.
        options: How to diagnose.
        simulators: Kept from fabric to fabric.
        progress: Called to tell what is being done, and the share that is over.

    Returns:
        The diagnosis.

    Raises:
        DiagnosisError: Another geometry than the atlas', or no usable drape.
    """
    calibrated, chosen = calibration or Calibration(), options or Options()
    generator = np.random.default_rng([_SEED, chosen.seed])
    progress("statistics, base model, evidence", 0.0)
    evidence = fabric_evidence(captures, emulator, calibrated.inflation, generator, without=chosen.without)
    samples, residual, grids, p = evidence.samples, evidence.residual, evidence.grids, evidence.causes.p
    notes = list(evidence.notes)
    probability = evidence.causes.probability(calibrated.tempering)
    single = single_causes(probability)
    best = sorted(evidence.causes.best.values(), key=lambda one: -probability[one.hypothesis.name])
    verdict, leading = verdict_of(p, probability)
    cause = named_cause(leading, best, evidence.causes.together, single)
    drifting = any(acts_later(one.hypothesis.effect) for one in cause)
    if drifting:
        notes.append("the gap compares drapes, not their drift from picture to picture: for creep no closure is given")
    selected = tuple(forward_selection(residual.white, grids)) if p <= ALPHA else ()
    simulated: list[Closure] = []
    if chosen.samples and (cause or chosen.always):
        alternatives = [() if drifting else cause]
        if chosen.always and len(selected) > len(cause):
            alternatives.append(tuple(step.candidate for step in selected))
        draping = Draping(chosen.samples, chosen.seed, simulators or Simulators(most=20))
        simulated = closures(
            emulator, samples, residual, alternatives, draping, progress=lambda share: progress("simulating", share)
        )
    progress("done", 1.0)
    return Diagnosis(
        fabric=captures.fabric,
        verdict=verdict,
        p=p,
        probability=probability,
        set90=set90(single),
        best=tuple(best),
        cause=cause,
        place=place(cause[0] if len(cause) == 1 else None, residual.white, grids),
        advice=advise(single),
        residual=residual,
        features=evidence.features,
        baselines=_baselines(emulator, evidence.features, samples, residual, grids),
        notes=tuple(notes),
        without=chosen.without,
        steps=selected,
        simulated=simulated[0] if simulated else None,
        together=simulated[1] if len(simulated) > 1 else None,
    )


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
