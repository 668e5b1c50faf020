"""Diagnosis of one fabric: where simulation and data differ, which effect explains it, how far the gap shrinks.

    features -> residual of the best base model -> evidence of every cause -> probabilities and verdict
             -> place, measurements to make next -> simulation of base and cause -> gap, closure on unseen samples

The first line is linear algebra on the atlas (seconds); only the last simulates. Nothing but the captures, their
protocol and the atlas is looked at.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy import ndarray

from cusick_bench.diagnosis.baselines import largest_marginal_score, lasso_without_projection
from cusick_bench.diagnosis.captures import Captures
from cusick_bench.diagnosis.emulator import Emulator, acts_later
from cusick_bench.diagnosis.evidence import DENSITY_BIAS, NONE, UNKNOWN, Candidate, Grid, candidates, grid_at
from cusick_bench.diagnosis.examine import ALPHA, Data, data_of, examine, to_atlas
from cusick_bench.diagnosis.features import Features
from cusick_bench.diagnosis.gap import Fold, Gap, gap
from cusick_bench.diagnosis.hypotheses import shifts
from cusick_bench.diagnosis.localise import Place, place
from cusick_bench.diagnosis.next_measurement import Advice, advise
from cusick_bench.diagnosis.residual import Residual, against_base, base_rows, noise, rows, scatter_of
from cusick_bench.diagnosis.simulate import Simulated, simulate
from cusick_bench.diagnosis.steps import Step, steps
from cusick_bench.diagnosis.store import Calibration
from cusick_bench.sim.setup import Simulators

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

    samples: int = 12
    always: bool = True
    without: tuple[str, ...] = ()
    seed: int = 0


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What was found.

    Attributes:
        fabric: Name.
        verdict: `none`, `effect`, `ambiguous` or `unknown`.
        p: Of the base model: that so much evidence for anything arises where no effect acts.
        probability: Of `none`, every effect, pairs (`a + b`) and `unknown`.
        set90: Effects, `none` or `unknown` that hold 90 % of it.
        best: Parameters of every effect at its best, likeliest first.
        cause: The named one, if any (two for a pair).
        place: Where it acts.
        advice: What to measure next.
        gap: Gap, floor and closure; None where nothing was simulated or could be.
        residual: What the base model leaves.
        features: Of the data.
        base, effect: Simulated samples of the base model, and with the cause.
        baselines: Probabilities by simpler methods.
        notes: What was left out or is in doubt.
        without: Effects that were not considered.
        steps: Causes taken off one after the other, until nothing more shows.
        together: Gap and closure with all of them; None where they are the named cause, or nothing was simulated.
    """

    fabric: str
    verdict: str
    p: float
    probability: dict[str, float]
    set90: tuple[str, ...]
    best: tuple[Candidate, ...]
    cause: tuple[Candidate, ...]
    place: Place
    advice: list[Advice]
    gap: Gap | None
    residual: Residual
    features: Features
    base: Simulated | None
    effect: Simulated | None
    baselines: Mapping[str, dict[str, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    steps: tuple[Step, ...] = ()
    together: Gap | None = None


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
    if any(acts_later(one.hypothesis.effect) for one in cause):
        notes.append("the gap compares drapes, not their drift from picture to picture: for creep no closure is given")
    spot = place(cause[0] if len(cause) == 1 else None, residual.white, made)
    advice = advise(single_causes(probability))
    difference, base, effect = None, None, None
    if chosen.samples and (cause or chosen.always):
        progress("simulating", 0.2)
        kept = simulators or Simulators(most=20)
        difference, base, effect = _simulated(emulator, data, residual, cause, chosen, kept, generator, progress)
    taken = tuple(steps(residual.white, made)) if p <= ALPHA else ()
    together = None
    if chosen.samples and chosen.always and len(taken) > len(cause):
        every = tuple(step.candidate for step in taken)
        kept = simulators or Simulators(most=20)
        together = _simulated(emulator, data, residual, every, chosen, kept, generator, lambda what, share: None)[0]
    progress("done", 1.0)
    return Diagnosis(
        captures.fabric, verdict, p, probability, set90(single_causes(probability)), tuple(best), cause, spot, advice,
        difference, residual, found, base, effect, _baselines(emulator, found, data, residual, made), tuple(notes),
        chosen.without, taken, together,
    )  # fmt: skip


def closure_by(
    captures: Captures,
    emulator: Emulator,
    causes: tuple[Candidate, ...],
    options: Options,
    *,
    simulators: Simulators | None = None,
) -> Gap | None:
    """Gap and closure by causes whose parameters are known: what a perfect diagnosis would reach.

    Args:
        captures: Silhouettes of a fabric.
        emulator: The atlas, for the base parameters.
        causes: With their true parameters, which are kept.
        options: Samples and seed of the simulations.
        simulators: Kept from fabric to fabric.

    Raises:
        DiagnosisError: Another geometry than the atlas', or no usable drape.
    """
    data = data_of(to_atlas(captures)[0])
    residual = against_base(emulator, data.features(), scatter=scatter_of(data.specimens), drift=data.later)
    generator = np.random.default_rng([_SEED, options.seed])
    kept = simulators or Simulators(most=20)
    return _simulated(
        emulator, data, residual, causes, options, kept, generator, lambda what, share: None, refit=False
    )[0]


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


def _verdict(p: float, probability: Mapping[str, float]) -> tuple[str, str]:
    """Verdict and the name of the cause or pair, if one is named."""
    if p > ALPHA:
        return NONE, ""
    acting = {name: value for name, value in probability.items() if name not in (NONE, DENSITY_BIAS)}
    single = single_causes(acting)
    total = sum(acting.values())
    if acting[UNKNOWN] >= 0.5 * total or len(acting) == 1:
        return UNKNOWN, ""
    top = max((name for name in single if name != UNKNOWN), key=lambda name: single[name])
    if single[top] < NAMED * total:
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


def _simulated(
    emulator: Emulator,
    data: Data,
    residual: Residual,
    cause: tuple[Candidate, ...],
    options: Options,
    simulators: Simulators,
    generator: np.random.Generator,
    progress: Callable[[str, float], None],
    *,
    refit: bool = True,
) -> tuple[Gap | None, Simulated | None, Simulated | None]:
    """Gap and closure over two folds, and the last fold's drapes."""
    cause = () if any(acts_later(one.hypothesis.effect) for one in cause) else cause
    every = np.arange(len(data.specimens))
    parts = [every] if len(every) < 4 else [every[0::2], every[1::2]]
    folds, base, effect = [], None, None
    for number, held in enumerate(parts):
        fitted = every if len(parts) == 1 else np.setdiff1d(every, held)
        theta, causes = _fitted(emulator, data, fitted, residual, cause, refit)
        seed = (_SEED, options.seed, number)
        progress("simulating the base model", 0.2 + 0.4 * number)
        base = simulate(theta[0], (), options.samples, seed, drift=data.later, simulators=simulators)
        if cause:
            progress("simulating the cause", 0.4 + 0.4 * number)
            effect = simulate(theta[1], causes, options.samples, seed, drift=data.later, simulators=simulators)
        folds.append(Fold(data.specimens[held], base.specimens, None if effect is None else effect.specimens))
    return gap(folds, residual.sd, generator), base, effect


def _fitted(
    emulator: Emulator, data: Data, chosen: ndarray, residual: Residual, cause: tuple[Candidate, ...],
    refit: bool,
) -> tuple[tuple[ndarray, ndarray], tuple[Candidate, ...]]:  # fmt: skip
    """Base parameters without and with the cause, and its parameters, from some samples alone."""
    own = data.features(chosen)
    scatter = scatter_of(data.specimens[chosen])
    plain = against_base(emulator, own, scatter=scatter, drift=data.later, start=residual.theta)
    joint, causes, total = plain, [], np.zeros(len(plain.kept))
    for one in cause:
        again = one
        if refit:
            again = candidates(joint.white, [grid_at(emulator, one.hypothesis, joint, least=0.0)])[0]
        point = {name: np.array([value]) for name, value in again.value.items()}
        total = total + shifts(emulator, one.hypothesis, joint.theta, joint.sd, data.later, point).rows[0]
        joint = against_base(emulator, own, scatter=scatter, drift=data.later, start=joint.theta, shift=total)
        causes.append(again)
    return (plain.theta, joint.theta), tuple(causes)


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
