"""Diagnosis of one fabric: where simulation and data differ, which effect explains it, how far the gap shrinks.

    features -> residual of the best base model -> evidence of every cause -> probabilities and verdict
             -> place, measurements to make next -> simulation of base and cause -> gap, closure on unseen samples

The first line is linear algebra on the atlas (seconds); only the last simulates. Nothing but the captures, their
protocol and the atlas is looked at.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.baselines import largest_marginal_score, lasso_without_projection
from cusick_bench.diagnosis.captures import Captures
from cusick_bench.diagnosis.emulator import Emulator, acts_later
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.evidence import (
    DENSITY_BIAS,
    NONE,
    UNKNOWN,
    Candidate,
    Grid,
    by_effect,
    candidates,
    detection_p_value,
    grids,
    log_sum,
    posterior,
    unknown_evidence,
)
from cusick_bench.diagnosis.features import Features, features
from cusick_bench.diagnosis.gap import Fold, Gap, gap
from cusick_bench.diagnosis.hypotheses import shifts
from cusick_bench.diagnosis.localise import Place, place
from cusick_bench.diagnosis.next_measurement import Advice, advise
from cusick_bench.diagnosis.pairs import pairs
from cusick_bench.diagnosis.residual import Residual, against_base, base_rows, inflated, noise, rows, scatter_of
from cusick_bench.diagnosis.simulate import Simulated, simulate
from cusick_bench.diagnosis.statistics import specimen_statistics
from cusick_bench.diagnosis.steps import Step, steps
from cusick_bench.diagnosis.store import Calibration
from cusick_bench.sim.mesh import CLOTH_RADIUS, PLATE_RADIUS
from cusick_bench.sim.setup import Simulators

ALPHA = 0.05  # level of the detection test, over all causes together
SET_LEVEL = 0.9
NAMED = 0.6  # from this probability on one effect is named, below several
_REFINED = 4  # effects whose base parameters are fitted again with them
_RATIO_TOLERANCE = 0.02
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


@dataclass(frozen=True, eq=False)
class _Data:
    """Statistics of a fabric's samples.

    Attributes:
        specimens: By sample and side.
        drift: Last minus first capture.
        later: Share of later captures.
    """

    specimens: Float[ndarray, "samples 2 statistics"]
    drift: Float[ndarray, "samples statistics"]
    later: float

    def features(self, chosen: ndarray | None = None) -> Features:
        """Of all samples, or of some."""
        if chosen is None:
            return features(self.specimens, self.drift)
        return features(self.specimens[chosen], self.drift[chosen])


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
    progress("statistics of the drapes", 0.0)
    scaled, notes = _to_atlas(captures)
    data = _data(scaled)
    found = data.features()
    notes += _doubts(found)
    if chosen.without:
        kept = {name: r for name, r in emulator.responses.items() if name not in chosen.without}
        emulator = replace(emulator, responses=kept)
    progress("base model", 0.05)
    residual = against_base(emulator, found, scatter=scatter_of(data.specimens), drift=data.later)
    residual = inflated(residual, calibrated.inflation)
    made = _without(grids(emulator, residual), chosen.without)
    progress("evidence", 0.1)
    p = detection_p_value(residual, made, generator)
    singles = candidates(residual.white, made)
    probability, best, together = _weigh(
        emulator, found, data, residual, made, singles, calibrated, detected=p <= ALPHA
    )
    verdict, named = _verdict(p, probability)
    cause = _named(named, best, together)
    if any(acts_later(one.hypothesis.effect) for one in cause):
        notes.append("the gap compares drapes, not their drift from picture to picture: for creep no closure is given")
    spot = place(cause[0] if len(cause) == 1 else None, residual.white, made)
    advice = advise(single_causes(probability))
    seen, base, effect = None, None, None
    if chosen.samples and (cause or chosen.always):
        progress("simulating", 0.2)
        kept = simulators or Simulators(most=20)
        seen, base, effect = _simulated(emulator, data, residual, cause, chosen, kept, generator, progress)
    taken = tuple(steps(residual.white, made)) if p <= ALPHA else ()
    together = None
    if chosen.samples and chosen.always and len(taken) > len(cause):
        every = tuple(step.candidate for step in taken)
        kept = simulators or Simulators(most=20)
        together = _simulated(emulator, data, residual, every, chosen, kept, generator, lambda what, share: None)[0]
    progress("done", 1.0)
    return Diagnosis(
        captures.fabric, verdict, p, probability, set90(single_causes(probability)), tuple(best), cause, spot, advice,
        seen, residual, found, base, effect, _baselines(emulator, found, data, residual, made), tuple(notes),
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
    scaled, _ = _to_atlas(captures)
    data = _data(scaled)
    residual = against_base(emulator, data.features(), scatter=scatter_of(data.specimens), drift=data.later)
    generator = np.random.default_rng([_SEED, options.seed])
    kept = simulators or Simulators(most=20)
    return _simulated(
        emulator, data, residual, causes, options, kept, generator, lambda what, share: None, refit=False
    )[0]


def _to_atlas(captures: Captures) -> tuple[Captures, list[str]]:
    """Lengths in units of the atlas' cloth.

    Raises:
        DiagnosisError: Plate and cloth are not in the atlas' ratio.
    """
    protocol = captures.protocol
    ratio, own = protocol.plate_radius_m / protocol.cloth_radius_m, PLATE_RADIUS / CLOTH_RADIUS
    if abs(ratio / own - 1) > _RATIO_TOLERANCE:
        raise DiagnosisError(
            f"the atlas is for plate over cloth = {own:g}, this protocol has {protocol.plate_radius_m:g} m over "
            f"{protocol.cloth_radius_m:g} m = {ratio:.3g}; drape samples of {2 * protocol.plate_radius_m / own:.3g} m, "
            "or correct protocol.json"
        )
    factor = CLOTH_RADIUS / protocol.cloth_radius_m
    nominal = replace(protocol, cloth_radius_m=CLOTH_RADIUS, plate_radius_m=PLATE_RADIUS)
    return replace(captures, radii=captures.radii * factor, protocol=nominal), list(captures.notes)


def _data(captures: Captures) -> _Data:
    table = specimen_statistics(captures)
    mean = table.mean.copy()
    unknown = np.isfinite(mean[:, 2, 0]) & ~np.isfinite(mean[:, 0, 0])
    mean[unknown, 0] = mean[unknown, 2]
    several = np.maximum(table.count.max(1), 1)
    later = float(np.mean((several - 1) / several))
    return _Data(mean[:, :2], table.order_odd, later)


def _doubts(found: Features) -> list[str]:
    """What the data cannot show."""
    notes = []
    number = int(found.samples.max())
    if number < 4:
        notes.append(f"only {number} samples: natural variability is the model's, and only strong effects show")
    if found.both == 0:
        notes.append("one face only: what belongs to the cloth and what to the laboratory cannot be told apart")
    if not np.isfinite(found.order).any():
        notes.append("no repeated captures: creep cannot be seen")
    return notes


def _without(made: list[Grid], names: Sequence[str]) -> list[Grid]:
    return [grid for grid in made if grid.hypothesis.name not in names]


def _weigh(
    emulator: Emulator,
    found: Features,
    data: _Data,
    residual: Residual,
    made: Sequence[Grid],
    singles: Sequence[Candidate],
    calibrated: Calibration,
    *,
    detected: bool,
) -> tuple[dict[str, float], list[Candidate], dict[str, tuple[Candidate, Candidate]]]:
    """Probabilities, the best point of every effect, and that of every pair."""
    effects = by_effect(singles)
    best = {name: next(one for one in singles if one.hypothesis.name == name) for name in effects}
    together: dict[str, tuple[Candidate, Candidate]] = {}
    extra: dict[str, float] = {}
    if detected and len(effects) > 1:
        for name in sorted(effects, key=lambda n: -effects[n])[:_REFINED]:
            refined = _refined(emulator, found, data, residual, best[name], made, calibrated)
            if refined is not None:
                effects[name], best[name] = refined
        for (first, second), (evidence, both) in pairs(residual.white, made, singles).items():
            together[f"{first} + {second}"], extra[f"{first} + {second}"] = both, evidence
    unknown = unknown_evidence(residual.white)
    probability = posterior(effects, unknown, tempering=calibrated.tempering, extra=extra)
    order = sorted(best.values(), key=lambda one: -probability[one.hypothesis.name])
    return probability, order, together


def _refined(
    emulator: Emulator,
    found: Features,
    data: _Data,
    residual: Residual,
    candidate: Candidate,
    made: Sequence[Grid],
    calibrated: Calibration,
) -> tuple[float, Candidate] | None:
    """Evidence of an effect with base parameters that were fitted together with it.

    A strong effect pulls the base parameters away from the truth, where its own shift is another; the evidence is
    then taken at the parameters that are best with it, against that of no effect at those that are best without.
    """
    hypothesis = candidate.hypothesis
    point = {name: np.array([value]) for name, value in candidate.value.items()}
    moved = shifts(emulator, hypothesis, residual.theta, residual.sd, data.later, point).rows[0]
    scatter = scatter_of(data.specimens)
    try:
        joint = against_base(emulator, found, scatter=scatter, drift=data.later, start=residual.theta, shift=moved)
        there = against_base(emulator, found, scatter=scatter, drift=data.later, start=joint.theta, fixed=True)
    except np.linalg.LinAlgError:
        return None
    there = inflated(there, calibrated.inflation)
    own = [grid for grid in made if grid.hypothesis.name == hypothesis.name]
    again = shifts(emulator, hypothesis, there.theta, there.sd, data.later)
    fresh = Grid(hypothesis, there.whiten(again.rows), again.variance)
    likelihood = fresh.log_likelihood(there.white) + 0.5 * residual.misfit + _volume(residual) - _volume(there)
    row = int(np.argmax(likelihood))
    evidence = log_sum(likelihood) - float(np.log(len(likelihood) / hypothesis.prior))
    others = [candidates(residual.white, [g])[0].log_evidence for g in own if g.hypothesis != hypothesis]
    value = {name: float(column[row]) for name, column in hypothesis.values.items()}
    size = float(np.linalg.norm(fresh.shift[row]))
    better = Candidate(hypothesis, value, float(likelihood[row]), evidence, size)
    total = log_sum([evidence, *others])
    return max(total, candidate.log_evidence), better if evidence >= candidate.log_evidence else candidate


def _volume(residual: Residual) -> float:
    """Half the log determinant of the covariance that whitened it."""
    return float(np.log(np.diag(residual.root)).sum())


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
    leading = max(acting, key=lambda name: acting[name])
    single = single_causes(acting)
    total = sum(acting.values())
    if acting[UNKNOWN] >= 0.5 * total or len(acting) == 1:
        return UNKNOWN, ""
    top = max((name for name in single if name != UNKNOWN), key=lambda name: single[name])
    if single[top] >= NAMED * total:
        return "effect", leading if " + " in leading else top
    return "ambiguous", top


def _named(
    name: str, best: Sequence[Candidate], together: Mapping[str, tuple[Candidate, Candidate]]
) -> tuple[Candidate, ...]:
    if not name:
        return ()
    if name in together:
        return together[name]
    return tuple(one for one in best if one.hypothesis.name == name)[:1]


def _simulated(
    emulator: Emulator,
    data: _Data,
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
    emulator: Emulator, data: _Data, chosen: ndarray, residual: Residual, cause: tuple[Candidate, ...],
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
            moved = shifts(emulator, one.hypothesis, joint.theta, joint.sd, data.later)
            grid = Grid(one.hypothesis, joint.whiten(moved.rows), moved.variance)
            again = candidates(joint.white, [grid])[0]
        point = {name: np.array([value]) for name, value in again.value.items()}
        total = total + shifts(emulator, one.hypothesis, joint.theta, joint.sd, data.later, point).rows[0]
        joint = against_base(emulator, own, scatter=scatter, drift=data.later, start=joint.theta, shift=total)
        causes.append(again)
    return (plain.theta, joint.theta), tuple(causes)


def _baselines(
    emulator: Emulator, found: Features, data: _Data, residual: Residual, made: Sequence[Grid]
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
