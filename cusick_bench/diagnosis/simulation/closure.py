"""Gap and closure: base model and cause are fitted to some samples by simulation, and compared with the others.

The atlas' regressions are accurate enough to tell causes apart, but a drape at the best parameters is not exactly the
drape that they predict. So the fit is repeated with a corrected prediction,

    y(theta, cause) ~ emulated(theta, cause) + [ simulated - emulated ](last theta, last cause),

with common random numbers in the simulations of all rounds. Errors of the regressions then neither make the base model
worse than it is nor count as an effect's share of the gap.

What the atlas cannot tell apart, simulations may: a cause is exchanged for a look-alike where that brings simulated
samples nearer to the fitted ones. The fit with the look-alike begins with the correction of the model before it. The
base model is simulated as often: of more tries the nearest is nearer, whatever is tried.

References:
    Bandler, Biernacki, Chen, Grobelny, Hemmers. Space mapping technique for electromagnetic optimization. IEEE
    Transactions on Microwave Theory and Techniques 42(12), 1994. Kennedy, O'Hagan. Bayesian calibration of computer
    models. JRSS B 63(3), 2001 (an additive discrepancy).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.optimize import minimize

from cusick_bench.diagnosis.atlas.base_model import BaseModel
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.inference.residuals.feature_rows import MEANS
from cusick_bench.diagnosis.inference.residuals.noise import scatter_of
from cusick_bench.diagnosis.inference.residuals.residual import Residual, against_base
from cusick_bench.diagnosis.inference.residuals.samples import SampleStatistics, sample_statistics, to_atlas
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate, candidates, grid_at
from cusick_bench.diagnosis.inference.single_effects.hypotheses import shifts
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.diagnosis.measure.features import features
from cusick_bench.diagnosis.measure.gap import Fold, Gap, faces_of, fit_of, gap
from cusick_bench.diagnosis.simulation.samples import Simulated, simulate
from cusick_bench.sim.effects.effect_timing import acts_later
from cusick_bench.sim.setup import Simulators

CORRECTIONS = 1
"""Number of corrections before look-alikes are tried; of all rounds the one nearest to the fitted samples is used."""
_LEAST = 4  # least number of samples for two folds
_SEED = 20
_SWEEPS = 3  # alternating fits of causes and base parameters in one round
_POLISH = 120  # largest number of evaluations for a cause's parameters between the points of its grid


@dataclass(frozen=True, eq=False)
class Closure:
    """Gap between a fabric and simulations of it, and how far causes close it.

    Attributes:
        gap: Gap, floor and closure; None with fewer than four samples, or where a fold has fewer than two with the
            faces to compare.
        base, effect: Simulated samples of the last fold's base model, and with the cause.
    """

    gap: Gap | None
    base: Simulated
    effect: Simulated | None


@dataclass(frozen=True)
class Draping:
    """How models are simulated.

    Attributes:
        samples: Simulated samples of each model and fold.
        seed: Same seed, same samples.
        simulators: Simulators that are reused from fabric to fabric.
    """

    samples: int
    seed: int = 0
    simulators: Simulators = field(default_factory=lambda: Simulators(most=20))


def closures(
    emulator: Emulator,
    samples: SampleStatistics,
    residual: Residual,
    alternatives: Sequence[tuple[Candidate, ...]],
    draping: Draping,
    *,
    look_alikes: Mapping[str, Candidate] | None = None,
    refit: bool = True,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Closure]:
    """Gap and closure over two folds: each is fitted to one half of the samples and scored on the other.

    With fewer than four samples there are no folds: models are fitted to all samples, and there is no gap.

    Args:
        emulator: The atlas, which knows how the cloth was turned over.
        samples: Statistics of a fabric's samples.
        residual: What the best base model leaves of all of them.
        alternatives: Sets of causes that act together; an empty set is the base model alone. Creep is left out: the gap
            compares drapes and not their drift from picture to picture, by which creep shows.
        draping: How models are simulated.
        look_alikes: What may act in place of a cause, by the name of that cause; each fold decides for itself.
        refit: Whether to fit the causes' parameters to each fold, too, instead of keeping them; look-alikes are fitted
            in any case.
        progress: Called with the share that is done.

    Returns:
        One for each alternative.
    """
    compared = [tuple(one for one in causes if not acts_later(one.hypothesis.effect)) for causes in alternatives]
    every = np.arange(len(samples.specimens))
    parts = [every] if len(every) < _LEAST else _halves(samples.specimens)
    instead = look_alikes or {}
    exchanges = [sum(one.hypothesis.name in instead for one in causes) for causes in compared]
    more = max(exchanges, default=0)
    done_after = _shares_of_work(compared, exchanges, more)
    held_out, base, with_causes = [], [], [[] for _ in compared]
    for number, held in enumerate(parts):
        fitted = every if len(parts) == 1 else np.setdiff1d(every, held)
        model = _Model(emulator, samples, fitted, residual, draping, (_SEED, draping.seed, number))
        held_out.append(samples.specimens[held])
        base.append(_simulated(model, (), refit, more=more).drapes)
        for drapes, causes, done in zip(with_causes, compared, done_after[:-1], strict=True):
            progress((number + done) / len(parts))
            if causes:
                drapes.append(_exchanged(model, _simulated(model, causes, refit), instead).drapes)
    if len(parts) == 1:
        return [Closure(None, base[-1], effect[-1] if effect else None) for effect in with_causes]
    return [
        _closure(held_out, base, effect, residual.sd, np.random.default_rng([_SEED, draping.seed]))
        for effect in with_causes
    ]


def _shares_of_work(
    compared: Sequence[tuple[Candidate, ...]], exchanges: Sequence[int], more: int
) -> Float[ndarray, "models"]:
    """Share of a fold that is done after the base model and after each alternative; an exchange is half a fit."""
    work = [1 + more / 2, *(bool(causes) + count / 2 for causes, count in zip(compared, exchanges, strict=True))]
    return np.cumsum(work) / sum(work)


def closure_by(captures: Captures, emulator: Emulator, causes: tuple[Candidate, ...], draping: Draping) -> Gap | None:
    """Gap and closure by causes whose parameters are known: the result of a perfect diagnosis.

    Args:
        captures: Silhouettes of a fabric.
        emulator: The atlas, for the base parameters.
        causes: With their true parameters, which are kept.
        draping: How models are simulated.

    Returns:
        The gap, or None where there are too few samples for it.

    Raises:
        DiagnosisError: Another geometry than the atlas', or no usable drape.
    """
    samples = sample_statistics(to_atlas(captures)[0])
    residual = against_base(emulator, samples.features(), scatter=scatter_of(samples.specimens), drift=samples.later)
    turned = replace(emulator, warp_seen_down=captures.warp_seen_down)
    return closures(turned, samples, residual, [causes], draping, refit=False)[0].gap


def _halves(specimens: Float[ndarray, "samples 2 statistics"]) -> list[ndarray]:
    """Places of every other sample, of those with the same faces."""
    shown = np.asarray(np.isfinite(specimens).all(2)) @ np.array([1, 2])  # 3 for both faces
    order = np.argsort(shown, kind="stable")
    return [np.sort(order[0::2]), np.sort(order[1::2])]


def _closure(
    held_out: list[ndarray],
    base: list[Simulated],
    effect: list[Simulated],
    sd: Float[ndarray, "statistics"],
    generator: np.random.Generator,
) -> Closure:
    changed = [one.specimens for one in effect] or [None] * len(base)
    folds = [Fold(data, one.specimens, other) for data, one, other in zip(held_out, base, changed, strict=True)]
    return Closure(gap(folds, sd, generator), base[-1], effect[-1] if effect else None)


class _Model:
    """The base model, emulated and simulated, compared with some of a fabric's samples.

    Args:
        emulator: The atlas.
        samples: Statistics of all samples.
        chosen: Those that it is fitted to.
        residual: Residual of all samples: where the search starts.
        draping: How it is simulated.
        seed: Seed of all its simulations.
    """

    def __init__(
        self, emulator: Emulator, samples: SampleStatistics, chosen: ndarray, residual: Residual, draping: Draping,
        seed: tuple[int, ...],
    ) -> None:  # fmt: skip
        self.emulator, self.draping, self.seed = emulator, draping, seed
        self.base_model = BaseModel()
        self.specimens, self.features = samples.specimens[chosen], samples.features(chosen)
        self.scatter, self.drift = scatter_of(self.specimens), samples.later
        self.start, self.sd, self.faces = residual.theta, residual.sd, faces_of(samples.specimens)
        self.nothing = np.zeros(len(residual.kept))

    def against(self, theta: ndarray, shift: ndarray, *, fixed: bool = False, exact: bool = True) -> Residual:
        """Residual at theta, or unless it is fixed at the best parameters that are found from there."""
        return against_base(
            self.emulator, self.features, scatter=self.scatter, drift=self.drift, start=theta, shift=shift,
            fixed=fixed, exact=exact,
        )  # fmt: skip

    def shift(self, at: Residual, causes: Sequence[Candidate]) -> Float[ndarray, "rows"]:
        """Emulated shift of the features by several causes, in sd."""
        total = self.nothing.copy()
        for one in causes:
            point = {name: np.array([value]) for name, value in one.value.items()}
            total += shifts(self.emulator, one.hypothesis, at.theta, at.sd, self.drift, point).features[0]
        return total

    def drape(self, theta: ndarray, causes: Sequence[Candidate]) -> Simulated:
        """Simulated samples."""
        return simulate(
            theta, causes, self.draping.samples, self.seed,
            drift=self.drift, model=self.base_model, simulators=self.draping.simulators,
            warp_seen_down=self.emulator.warp_seen_down,
        )  # fmt: skip

    def distance(self, drapes: Simulated) -> float:
        """G between simulated samples and those that the model is fitted to."""
        return fit_of(self.specimens, drapes.specimens, self.sd, self.faces)


@dataclass(frozen=True, eq=False)
class _Round:
    """A model as it was fitted and simulated.

    Attributes:
        theta: Base parameters.
        causes: Causes at their fitted parameters.
        drapes: Simulated samples.
        distance: G between these and the samples that it was fitted to.
    """

    theta: ndarray
    causes: list[Candidate]
    drapes: Simulated
    distance: float


def _round(model: _Model, theta: ndarray, causes: Sequence[Candidate], correction: ndarray, refit: bool) -> _Round:
    theta, fitted = _fit(model, theta, causes, correction, refit)
    drapes = model.drape(theta, fitted)
    return _Round(theta, fitted, drapes, model.distance(drapes))


def _simulated(model: _Model, causes: Sequence[Candidate], refit: bool, *, more: int = 0) -> _Round:
    """The base model with causes: of all rounds, `more` than without look-alikes, the one nearest to what is fitted."""
    placed = _at_grid_points(model, causes) if refit else causes
    rounds = [_round(model, model.start, placed, model.nothing, refit)]
    for _ in range(CORRECTIONS + more):
        last = rounds[-1]
        rounds.append(_round(model, last.theta, last.causes, _correction(model, last), refit))
    return min(rounds, key=lambda one: one.distance)


def _exchanged(model: _Model, found: _Round, look_alikes: Mapping[str, Candidate]) -> _Round:
    """The model with those causes exchanged for their look-alikes whose exchange brings it nearer."""
    for place, one in enumerate(found.causes):
        if one.hypothesis.name not in look_alikes:
            continue
        correction = _correction(model, found)
        others = [*found.causes[:place], *found.causes[place + 1 :]]
        at = model.against(found.theta, correction, fixed=True)
        without = model.against(found.theta, correction + model.shift(at, others), fixed=True)
        other = _at_grid_point(model, look_alikes[one.hypothesis.name], without)
        tried = [*found.causes[:place], other, *found.causes[place + 1 :]]
        found = min(found, _round(model, found.theta, tried, correction, True), key=lambda each: each.distance)
    return found


def _at_grid_points(model: _Model, causes: Sequence[Candidate]) -> list[Candidate]:
    """Causes at the likeliest points of their grids for these samples, one after the other."""
    placed, total = [], model.nothing
    for one in causes:
        plain = model.against(model.start, total, exact=False)
        placed.append(_at_grid_point(model, one, plain))
        total = model.shift(plain, placed)
    return placed


def _at_grid_point(model: _Model, one: Candidate, at: Residual) -> Candidate:
    """A cause at the likeliest point of its grid for what a residual leaves."""
    grid = grid_at(model.emulator, one.hypothesis, at, least=0.0)
    return candidates(at.white, [grid], law_difference=0.0)[0]


def _fit(
    model: _Model, theta: ndarray, causes: Sequence[Candidate], correction: ndarray, refit: bool
) -> tuple[ndarray, list[Candidate]]:
    """Fits base parameters and those of the causes in turn."""
    fitted = list(causes)
    for _ in range(_SWEEPS if causes else 1):
        at = model.against(theta, correction, fixed=True)
        for index in range(len(fitted) if refit else 0):
            others = fitted[:index] + fitted[index + 1 :]
            without = model.against(theta, correction + model.shift(at, others), fixed=True)
            fitted[index] = _refined(model, without, fitted[index])
        theta = model.against(theta, correction + model.shift(at, fitted)).theta
    return theta, fitted


def _refined(model: _Model, at: Residual, one: Candidate) -> Candidate:
    """A cause at its best parameters, searched between the points of its grid."""
    free = [p for p in one.hypothesis.effect.parameters if p.role in ("severity", "direction", "radius")]
    first = np.array([{"direction": 8.0, "radius": 0.008}.get(p.role, 0.3 * abs(one.value[p.name])) for p in free])

    def value(x: ndarray) -> dict[str, float]:
        moved = {p.name: one.value[p.name] + float(step) for p, step in zip(free, x * first, strict=True)}
        turned = {p.name: moved[p.name] % 360 for p in free if p.role == "direction"}
        within = {p.name: float(np.clip(moved[p.name], p.low, p.high)) for p in free if p.role != "direction"}
        return {**one.value, **turned, **within}

    def misfit(x: ndarray) -> float:
        left = at.white - at.whiten(model.shift(at, [replace(one, value=value(x))])[None])[0]
        return float(left @ left)

    simplex = np.vstack([np.zeros(len(free)), np.eye(len(free))])
    options = {"maxfev": _POLISH, "initial_simplex": simplex, "xatol": 0.02}
    return replace(one, value=value(minimize(misfit, simplex[0], method="Nelder-Mead", options=options).x))


def _correction(model: _Model, found: _Round) -> Float[ndarray, "rows"]:
    """Simulated minus emulated means [sd]; spreads and drifts are not corrected."""
    at = model.against(found.theta, model.nothing, fixed=True)
    mean = features(found.drapes.specimens).contrast / at.sd
    expected = np.stack([model.emulator.mean(found.theta) / at.sd, np.zeros_like(at.sd)])
    error = model.nothing.copy()
    error[MEANS] = np.nan_to_num((mean - expected).ravel() - model.shift(at, found.causes)[MEANS])
    return error
