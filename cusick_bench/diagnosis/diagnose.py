"""Diagnosis of one fabric: where simulation and data differ, which effect explains it, how far the gap shrinks.

    features -> residual of the best base model -> evidence of every cause -> probabilities and verdict
             -> place, measurements to make next -> simulation of base and cause -> gap, closure on unseen samples

The first line is linear algebra on the atlas (seconds); only the last simulates. Nothing but the captures, their
protocol and the atlas is looked at.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from cusick_bench.diagnosis.atlas.effect_timing import acts_later
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.inference.baselines import largest_marginal_score, lasso_without_projection
from cusick_bench.diagnosis.inference.equivalents import partners
from cusick_bench.diagnosis.inference.evidence import DENSITY_BIAS, NONE, UNKNOWN, Candidate, Grid
from cusick_bench.diagnosis.inference.fabric_evidence import ALPHA, Data, examine
from cusick_bench.diagnosis.inference.hypotheses import shifts
from cusick_bench.diagnosis.inference.localise import Place, place
from cusick_bench.diagnosis.inference.next_measurement import Advice, advise
from cusick_bench.diagnosis.inference.residual import Residual, base_rows, noise, rows, scatter_of
from cusick_bench.diagnosis.inference.stepwise import Step, steps
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.diagnosis.measure.features import Features
from cusick_bench.diagnosis.measure.gap import Gap
from cusick_bench.diagnosis.simulation.closure import Closure, Draping, closures
from cusick_bench.sim.setup import Simulators

Verdict = Literal["none", "effect", "ambiguous", "unknown"]
"""No effect, one (or a pair), one of several, or something that is not on the list."""
SET_LEVEL = 0.9
NAMED = 0.6  # from this probability on one effect is named, below several
_SEED = 20


@dataclass(frozen=True)
class Options:
    """How to diagnose.

    Attributes:
        samples: Simulated samples of each model and fold; 0 leaves the simulations, and so gap and closure, out.
        always: Simulate also where no effect shows.
        without: Effects that are not to be considered.
        seed: Of simulations and tests.
    """

    samples: int = 24
    always: bool = True
    without: tuple[str, ...] = ()
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What was found.

    Attributes:
        fabric: Name.
        verdict: What was found.
        p: Of the base model: that so much evidence for anything arises where no effect acts.
        probability: Of `none`, every effect, pairs (`a + b`) and `unknown`.
        set90: Effects, `none` or `unknown` that hold 90 % of it.
        best: Parameters of every effect at its best, likeliest first.
        cause: The named one, if any (two for a pair).
        place: Where it acts.
        advice: What to measure next.
        residual: What the base model leaves.
        features: Of the data.
        baselines: Probabilities by simpler methods.
        notes: What was left out or is in doubt.
        without: Effects that were not considered.
        steps: Causes taken off one after the other, until no further one shows.
        simulated: Gap, and closure by the cause; None where nothing was simulated.
        together: The same by all steps; None where they are the named cause, or nothing was simulated.
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
        calibration: Of the probabilities; theory by default.
        options: How.
        simulators: Kept from fabric to fabric.
        progress: Told what is being done, and the share that is over.

    Raises:
        DiagnosisError: Another geometry than the atlas', or no usable drape.
    """
    calibrated, chosen = calibration or Calibration(), options or Options()
    generator = np.random.default_rng([_SEED, chosen.seed])
    progress("statistics, base model, evidence", 0.0)
    seen = examine(captures, emulator, calibrated.inflation, generator, without=chosen.without)
    data, found, residual, made, weighed = seen.data, seen.features, seen.residual, seen.grids, seen.weighed
    notes, p = list(seen.notes), weighed.p
    probability = weighed.probability(calibrated.tempering)
    best = sorted(weighed.best.values(), key=lambda one: -probability[one.hypothesis.name])
    verdict, named = _verdict(p, probability)
    cause = _named(named, best, weighed.together, single_causes(probability))
    drifting = any(acts_later(one.hypothesis.effect) for one in cause)
    if drifting:
        notes.append("the gap compares drapes, not their drift from picture to picture: for creep no closure is given")
    spot = place(cause[0] if len(cause) == 1 else None, residual.white, made)
    advice = advise(single_causes(probability))
    taken = tuple(steps(residual.white, made)) if p <= ALPHA else ()
    simulated: list[Closure] = []
    if chosen.samples and (cause or chosen.always):
        alternatives = [() if drifting else cause]
        if chosen.always and len(taken) > len(cause):
            alternatives.append(tuple(step.candidate for step in taken))
        draping = Draping(chosen.samples, chosen.seed, simulators or Simulators(most=20))
        simulated = closures(
            emulator, data, residual, alternatives, draping, progress=lambda share: progress("simulating", share)
        )
    progress("done", 1.0)
    return Diagnosis(
        captures.fabric, verdict, p, probability, set90(single_causes(probability)), tuple(best), cause, spot, advice,
        residual, found, _baselines(emulator, found, data, residual, made), tuple(notes), chosen.without, taken,
        *simulated,
    )  # fmt: skip


def single_causes(probability: Mapping[str, float]) -> dict[str, float]:
    """A pair's probability given to its likelier half, so that all add up to 1."""
    single = {name: value for name, value in probability.items() if " + " not in name}
    for name, value in probability.items():
        if " + " in name:
            leading = max(name.split(" + "), key=lambda part: single.get(part, 0.0))
            single[leading] = single.get(leading, 0.0) + value
    return single


def set90(probability: Mapping[str, float]) -> tuple[str, ...]:
    """The fewest causes that hold 90 % of the probability."""
    names: list[str] = []
    for name in sorted(probability, key=lambda n: -probability[n]):
        names.append(name)
        if sum(probability[n] for n in names) >= SET_LEVEL:
            break
    return tuple(names)


def _verdict(p: float, probability: Mapping[str, float]) -> tuple[Verdict, str]:
    """Verdict and the name of the cause or pair, if one is named.

    None is named while the 90 % set also holds one that no silhouette tells from it.
    """
    if p > ALPHA:
        return NONE, ""
    acting = {name: value for name, value in probability.items() if name not in (NONE, DENSITY_BIAS)}
    single = single_causes(acting)
    total = sum(acting.values())
    if acting[UNKNOWN] >= 0.5 * total or len(acting) == 1:
        return UNKNOWN, ""
    top = max((name for name in single if name != UNKNOWN), key=lambda name: single[name])
    if single[top] < NAMED * total or partners(top, set90(single_causes(probability))):
        return "ambiguous", top
    with_top = [top, *(name for name in acting if top in name.split(" + ") and name != top)]
    return "effect", max(with_top, key=lambda name: acting[name])


def _named(
    name: str,
    best: Sequence[Candidate],
    together: Mapping[str, tuple[Candidate, Candidate]],
    single: Mapping[str, float],
) -> tuple[Candidate, ...]:
    """The named cause at its best; of a pair the half first that its probability is given to."""
    if not name:
        return ()
    if name in together:
        return tuple(sorted(together[name], key=lambda one: -single.get(one.hypothesis.name, 0.0)))
    return tuple(one for one in best if one.hypothesis.name == name)[:1]


def _baselines(
    emulator: Emulator, found: Features, data: Data, residual: Residual, made: Sequence[Grid]
) -> dict[str, dict[str, float]]:
    """Simpler methods, on data minus the best base model as it stands."""
    own = noise(emulator, residual.theta, found, scatter_of(data.specimens))
    scale = np.sqrt(np.diag(own.covariance))[residual.kept]
    value = (rows(found, own.sd) - base_rows(emulator, residual.theta, own.sd))[residual.kept] / scale
    moved = [
        shifts(emulator, grid.hypothesis, residual.theta, own.sd, data.later).rows[:, residual.kept] / scale
        for grid in made
    ]
    return {
        "largest-marginal-score": largest_marginal_score(value, made, moved),
        "lasso-without-projection": lasso_without_projection(value, made, moved),
    }
