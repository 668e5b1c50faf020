"""Parameters of causes between the points of their grids, of one fabric or of several that share them."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.optimize import minimize

from cusick_bench.diagnosis.inference.sets.effect_points import EffectPoints, law_variance
from cusick_bench.diagnosis.inference.sets.fabric_data import FabricData
from cusick_bench.diagnosis.inference.sets.fabric_sets import FabricSets
from cusick_bench.diagnosis.inference.sets.set_model import likelihoods_of
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate

_STEPS = {"direction": 5.0, "radius": 0.006}
"""First steps of the search [deg, m]; that of a severity is a fifth of its value."""
_RANGE = 2.0  # factor on a severity, either way
_EVALUATIONS = 60  # largest number of evaluations for each cause and sweep
_SWEEPS = 2


@dataclass(frozen=True, eq=False)
class NamedSet:
    """Causes that are named together, at their best parameters.

    Attributes:
        causes: The causes.
        variance: Variance that other laws for them add to each row.
        left: Residual: w minus their shifts.
        tangent: Change of the shift with each free parameter, one a row.
    """

    causes: tuple[Candidate, ...]
    variance: Float[ndarray, "kept"]
    left: Float[ndarray, "kept"]
    tangent: Float[ndarray, "parameters kept"]


def named_set(fabric: FabricData, sets: FabricSets, causes: Sequence[Candidate]) -> NamedSet:
    """Fits the parameters of causes together.

    Args:
        fabric: The fabric.
        sets: Its sets.
        causes: The causes at points of their grids; those of the laboratory are kept as they are.

    Returns:
        The causes, refined.
    """
    fit = _Fit(fabric, sets)
    known = {one.hypothesis.name for one in sets.shared}
    fitted = _fitted([fit], causes, known)
    shifts = np.stack([fit.shift(one) for one in fitted]) if fitted else np.zeros((0, len(sets.model.white)))
    sized = tuple(replace(one, size=float(np.linalg.norm(d))) for one, d in zip(fitted, shifts, strict=True))
    tangent = [row for one in fitted if one.hypothesis.name not in known for row in fit.tangent(one)]
    return NamedSet(
        sized,
        fit.variance(sized, shifts),
        sets.model.white - shifts.sum(0),
        np.array(tangent).reshape(len(tangent), shifts.shape[1]),
    )


@dataclass(frozen=True, eq=False)
class _Fit:
    """A fabric at its joint optimum, to which parameters of causes are fitted, and points of its further effects."""

    fabric: FabricData
    sets: FabricSets
    own: Sequence[int] = ()

    def shift(self, one: Candidate) -> Float[ndarray, "kept"]:
        """Shift of the turned rows."""
        at = self.sets.residual
        return self.sets.model.misfit.turned(at.whiten(self.fabric.shift([one], at)[None]))[0]

    def variance(self, causes: Sequence[Candidate], shifts: ndarray) -> Float[ndarray, "kept"]:
        """Variance that other laws add."""
        total, misfit = np.zeros(shifts.shape[1]), self.sets.model.misfit
        for one, shift in zip(causes, shifts, strict=True):
            total += law_variance(misfit, self.fabric.calibration.mismatch(one.hypothesis.name), shift)
        return total

    def given(self, others: Sequence[Candidate]) -> tuple[Float[ndarray, "kept"], Float[ndarray, "kept"]]:
        """Residual of w after other causes, and the variance with them."""
        model, own = self.sets.model, list(self.own)
        left, variance = model.white - model.points.shift[own].sum(0), 1 + model.points.variance[own].sum(0)
        shifts = np.array([self.shift(other) for other in others]).reshape(len(others), len(left))
        return left - shifts.sum(0), variance + self.variance(others, shifts)

    def log_likelihood(self, one: Candidate, left: Float[ndarray, "kept"], variance: Float[ndarray, "kept"]) -> float:
        """Log likelihood of a cause, given what others leave and the variance with them."""
        shift = self.shift(one)[None]
        own = self.variance([one], shift)[None]
        return float(likelihoods_of(self.sets.model.misfit, left, variance, _point(shift, own)).total[0])

    def tangent(self, one: Candidate) -> list[Float[ndarray, "kept"]]:
        """Change of the shift with each free parameter, by differences."""
        free, step = _free(one), 0.2
        rows = []
        for place in range(len(free)):
            x = np.zeros(len(free))
            x[place] = step
            rows.append((self.shift(_moved(one, free, x)) - self.shift(_moved(one, free, -x))) / (2 * step))
        return rows


def shared_set(
    fabrics: Sequence[tuple[FabricData, FabricSets]], own: Sequence[Sequence[int]], causes: Sequence[Candidate]
) -> tuple[Candidate, ...]:
    """Fits the parameters of causes that several fabrics share.

    Args:
        fabrics: The fabrics, weighed without what they share.
        own: Points of the further effects of each fabric.
        causes: The causes at points of their grids.

    Returns:
        The causes, refined.
    """
    return tuple(_fitted([_Fit(*fabric, beside) for fabric, beside in zip(fabrics, own, strict=True)], causes))


def _fitted(fits: Sequence[_Fit], causes: Sequence[Candidate], known: Collection[str] = ()) -> list[Candidate]:
    """Causes at the parameters that are likeliest over all fabrics, one after the other; known causes are kept."""
    fitted = list(causes)
    for _ in range(_SWEEPS):
        for place, one in enumerate(fitted):
            if one.hypothesis.name not in known:
                others = fitted[:place] + fitted[place + 1 :]
                fitted[place] = _likeliest(one, partial(_summed, [(fit, *fit.given(others)) for fit in fits]))
    return fitted


def _summed(given: Sequence[tuple[_Fit, ndarray, ndarray]], one: Candidate) -> float:
    """Log likelihood of a cause over fabrics, each with what others leave and its variance."""
    return sum(fit.log_likelihood(one, left, variance) for fit, left, variance in given)


def _likeliest(one: Candidate, log_likelihood: Callable[[Candidate], float]) -> Candidate:
    """A cause at its likeliest parameters."""
    free = _free(one)
    simplex = np.vstack([np.zeros(len(free)), np.eye(len(free))])
    options = {"maxfev": _EVALUATIONS, "initial_simplex": simplex, "xatol": 0.02, "fatol": 0.01}
    found = minimize(lambda x: -log_likelihood(_moved(one, free, x)), simplex[0], method="Nelder-Mead", options=options)
    return _moved(one, free, found.x)


def _free(one: Candidate) -> Mapping[str, float]:
    """Free parameters with their first steps."""
    steps = {}
    for p in one.hypothesis.effect.parameters:
        if p.role == "severity":
            steps[p.name] = 0.2 * abs(one.value[p.name])
        elif p.role in _STEPS:
            steps[p.name] = _STEPS[p.role]
    return steps


def _moved(one: Candidate, free: Mapping[str, float], x: ndarray) -> Candidate:
    """A cause with other parameters, within their bounds."""
    value = dict(one.value)
    for (name, step), amount in zip(free.items(), x, strict=True):
        p = next(p for p in one.hypothesis.effect.parameters if p.name == name)
        moved = one.value[name] + step * float(amount)
        if p.role == "severity":
            size = abs(one.value[name])
            least, most = size / _RANGE, min(size * _RANGE, max(abs(p.low), abs(p.high)))
            moved = float(np.copysign(np.clip(moved * np.sign(one.value[name]), least, most), one.value[name]))
        value[name] = moved % 360 if p.role == "direction" else float(np.clip(moved, *_bounds(one, p.low, p.high)))
    return replace(one, value=value)


def _bounds(one: Candidate, low: float, high: float) -> tuple[float, float]:
    """Bounds of a parameter; a loss may be negative, where captures were taken in the other order."""
    backwards = one.value[one.hypothesis.effect.severity.name] < 0 <= low
    return (-high, high) if backwards else (low, high)


def _point(shift: ndarray, variance: ndarray) -> EffectPoints:
    nothing = np.zeros(len(shift), dtype=int)
    return EffectPoints((), (), nothing, nothing, nothing, shift, variance, np.zeros(len(shift)))
