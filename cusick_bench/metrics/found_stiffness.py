"""The stiffness that a solver found, with intervals if it has a posterior, and with the truth if that is known.

Without a posterior a value is that of the fitted parameters. With one it is the median over cloths drawn from it, and
the interval holds the middle 90 % of them. Draws are of the cloth: properties of one specimen only (the fields of the
space `field`) have their mean values. Where elements are drawn independently (`bdp`), the mean over thousands of them
hardly differs from draw to draw, so that the interval is narrow; the spread between elements is given as well.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.metrics.stiffness import (
    BENDING,
    GF_CM2_PER_CM,
    STRETCH,
    ClothStiffness,
    ElementWeights,
    cloth_stiffness,
    element_weights,
)
from cusick_bench.solvers.base import Prediction, Solver, SolverError

if TYPE_CHECKING:
    from cusick_bench.problem import DrapeProblem


LEVELS = (0.05, 0.95)  # of the interval
DRAWS = 400
"""Number of draws from the posterior: the bounds of the interval are then known to .11 standard deviations. Where a
solver has learned both faces, it draws each cloth for both: 400 draws are then 200 cloths, and bounds known to .15."""
_SPREAD_DRAWS = 8  # whose spread between elements is averaged
UNITS = {
    "stiffness": "N m",
    "stiffness_gf_cm2_cm": "gf cm2/cm",
    "stiffness_curve": "N m",
    "stiffness_spread": "standard deviation of the logarithm between elements",
    "stretch": "N/m",
    "truth_ratio": "found / true",
}
"""Units of the keys of the document."""


@dataclass(frozen=True)
class Quantity:
    """A number with its interval.

    Attributes:
        value: The number.
        ci90: 5 % and 95 % quantiles of the posterior, None without one.
    """

    value: float
    ci90: tuple[float, float] | None = None

    def times(self, factor: float) -> Quantity:
        """The number in another unit.

        Args:
            factor: What to multiply it with, > 0.

        Returns:
            The number and its interval.
        """
        return Quantity(factor * self.value, self.ci90 and (factor * self.ci90[0], factor * self.ci90[1]))

    def holds(self, truth: float) -> bool | None:
        """Whether the interval holds a number.

        Args:
            truth: The number.

        Returns:
            Whether it does; None without an interval.
        """
        return None if self.ci90 is None else self.ci90[0] <= truth <= self.ci90[1]


Quantities = Mapping[str, Quantity]


@dataclass(frozen=True)
class FoundStiffness:
    """Stiffness of a cloth found by a solver, by direction.

    Attributes:
        bending: Bending stiffness of warp, weft and bias [N m].
        stretch: Membrane stiffness of warp, weft and shear [N/m].
        curve: Bending stiffness at curvatures of 0, 10, 20, 30 and 40 /m [N m].
        spread: Standard deviation of log bending stiffness between elements; 0 where all have one table.
        true_bending: True bending stiffness [N m], None where it is not known.
        true_stretch: True membrane stiffness [N/m], None where it is not known.
    """

    bending: Quantities
    stretch: Quantities
    curve: Mapping[str, tuple[float, ...]]
    spread: Mapping[str, float]
    true_bending: Mapping[str, float] | None = None
    true_stretch: Mapping[str, float] | None = None

    @property
    def bending_ratio(self) -> Quantities:
        """Found over true bending stiffness; empty where the truth is not known."""
        return _ratios(self.bending, self.true_bending)

    @property
    def stretch_ratio(self) -> Quantities:
        """Found over true membrane stiffness; empty where the truth is not known."""
        return _ratios(self.stretch, self.true_stretch)

    def document(self) -> dict[str, Any]:
        """The keys that `result.json` and `run --json` have of it; `UNITS` says in which unit each is."""
        kawabata = {name: one.times(1 / GF_CM2_PER_CM) for name, one in self.bending.items()}
        ratios = {"stiffness": _plain(self.bending_ratio), "stretch": _plain(self.stretch_ratio)}
        return {
            "stiffness": _plain(self.bending),
            "stiffness_gf_cm2_cm": _plain(kawabata),
            "stiffness_curve": {name: list(values) for name, values in self.curve.items()},
            "stiffness_spread": dict(self.spread),
            "stretch": _plain(self.stretch),
            "truth_ratio": ratios if self.true_bending else None,
            "units": dict(UNITS),
        }


def stiffness_document(found: FoundStiffness | None) -> dict[str, Any]:
    """The keys of a result that are about stiffness; null in all of them where a solver has none.

    Args:
        found: What was found, None of a row without physics.

    Returns:
        Values by key.
    """
    return dict.fromkeys(UNITS) | {"units": dict(UNITS)} if found is None else found.document()


def read_stiffness(result: Mapping[str, Any]) -> FoundStiffness | None:
    """Stiffness in the document of a result.

    Args:
        result: Contents of `result.json`.

    Returns:
        What was found; None where the solver has no stiffness, or the result is of before it was recorded.

    Raises:
        ValueError: It is malformed.
    """
    if result.get("stiffness") is None:
        return None
    bending, stretch = (_read(result, name, names) for name, names in (("stiffness", BENDING), ("stretch", STRETCH)))
    curve, spread, ratio = (result.get(name) for name in ("stiffness_curve", "stiffness_spread", "truth_ratio"))
    true_bending, true_stretch = None, None
    if ratio is not None:
        ratios = _mapping(ratio, "truth_ratio")
        true_bending = _truth(bending, _read(ratios, "stiffness", BENDING))
        true_stretch = _truth(stretch, _read(ratios, "stretch", STRETCH))
    return FoundStiffness(
        bending,
        stretch,
        {} if curve is None else {name: _row(_mapping(curve, "stiffness_curve").get(name)) for name in BENDING},
        {} if spread is None else {name: _number(_mapping(spread, "stiffness_spread").get(name)) for name in BENDING},
        true_bending,
        true_stretch,
    )


def find_stiffness(
    solver: Solver, problem: DrapeProblem, prediction: Prediction, true: ClothStiffness | None = None
) -> tuple[FoundStiffness | None, Float[ndarray, "draws bending"] | None]:
    """The stiffness behind a prediction.

    Args:
        solver: Who made it.
        problem: The problem that was answered.
        prediction: The answer.
        true: The cloth's true stiffness, where it is known.

    Returns:
        What was found, None where the answer has no parameters, and bending stiffness of the draws that it sums up
        [N m], in the order of `BENDING`, None without a posterior.

    Raises:
        SolverError: The solver redraws another number of parameters than the problem has.
    """
    import torch

    if prediction.tau is None:
        return None, None
    space, law = problem.space, problem.space.prior.law
    weights = element_weights(space.mesh, problem.simulator.settings.plate_radius)

    def stiffness(tau: Float[ndarray, " dimension"], weights: ElementWeights = weights) -> ClothStiffness:
        with torch.no_grad():
            material = space.specimen(torch.as_tensor(tau)).material
        return cloth_stiffness(material.stretch, material.bending, law, weights, float(material.poisson))

    known = _known(true)
    if prediction.posterior is None:
        fitted = stiffness(prediction.tau)
        return _summed_up([fitted], fitted.bending_spread, *known), None
    drawn, spreads = [], []
    for index in range(DRAWS):
        tau = np.array(solver.redraw(problem, prediction.posterior, index), dtype=np.float64)
        if tau.shape != (problem.dimension,):
            raise SolverError(
                f"`redraw` of {solver.name} must give {problem.dimension} numbers, got shape {tau.shape} for draw "
                f"{index}; mend the solver"
            )
        if index < _SPREAD_DRAWS:
            spreads.append(stiffness(tau).bending_spread)
        tau[space.specimen_level] = 0.0
        drawn.append(stiffness(tau))
    found = _summed_up(drawn, np.mean(spreads, axis=0), *known)
    return found, np.stack([one.bending for one in drawn])


def _known(true: ClothStiffness | None) -> tuple[dict[str, float] | None, dict[str, float] | None]:
    if true is None:
        return None, None
    bending = dict(zip(BENDING, true.bending.tolist(), strict=True))
    return bending, dict(zip(STRETCH, true.stretch.tolist(), strict=True))


def _summed_up(
    drawn: list[ClothStiffness],
    spread: Float[ndarray, " bending"],
    true_bending: dict[str, float] | None,
    true_stretch: dict[str, float] | None,
) -> FoundStiffness:
    curve = np.median([one.curve for one in drawn], axis=0)
    return FoundStiffness(
        _quantities(BENDING, np.stack([one.bending for one in drawn])),
        _quantities(STRETCH, np.stack([one.stretch for one in drawn])),
        {name: tuple(row.tolist()) for name, row in zip(BENDING, curve, strict=True)},
        dict(zip(BENDING, spread.tolist(), strict=True)),
        true_bending,
        true_stretch,
    )


def _quantities(names: Iterable[str], draws: Float[ndarray, "draws numbers"]) -> dict[str, Quantity]:
    """Medians with intervals over draws; a single draw is a fit, without interval."""
    if len(draws) == 1:
        return {name: Quantity(float(value)) for name, value in zip(names, draws[0], strict=True)}
    rows = zip(names, np.median(draws, axis=0), *np.quantile(draws, LEVELS, axis=0), strict=True)
    return {name: Quantity(float(middle), (float(low), float(high))) for name, middle, low, high in rows}


def _ratios(found: Quantities, true: Mapping[str, float] | None) -> dict[str, Quantity]:
    return {} if true is None else {name: one.times(1 / true[name]) for name, one in found.items()}


def _truth(found: Quantities, ratios: Quantities) -> dict[str, float]:
    if any(one.value == 0 for one in ratios.values()):
        raise ValueError("truth_ratio must be > 0")
    return {name: one.value / ratios[name].value for name, one in found.items()}


def _plain(quantities: Quantities) -> dict[str, Any]:
    return {name: {"value": one.value, "ci90": one.ci90 and list(one.ci90)} for name, one in quantities.items()}


def _read(document: Mapping[str, Any], key: str, names: Iterable[str]) -> dict[str, Quantity]:
    quantities = _mapping(document.get(key), key)
    return {name: _quantity(quantities.get(name), f"{key}.{name}") for name in names}


def _quantity(document: Any, where: str) -> Quantity:
    values = _mapping(document, where)
    interval = values.get("ci90")
    if interval is None:
        return Quantity(_number(values.get("value")))
    if not isinstance(interval, list) or len(interval) != 2:
        raise ValueError(f"{where}.ci90 must be null or two numbers, got {interval!r:.60}")
    return Quantity(_number(values.get("value")), (_number(interval[0]), _number(interval[1])))


def _mapping(document: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(document, dict):
        raise ValueError(f"{where} must be an object, got {document!r:.60}")
    return document


def _row(values: Any) -> tuple[float, ...]:
    if not isinstance(values, list):
        raise ValueError(f"stiffness_curve must hold lists, got {values!r:.60}")
    return tuple(map(_number, values))


def _number(value: Any) -> float:
    """A stiffness, ratio or spread: finite and not negative."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not (math.isfinite(value) and value >= 0):
        raise ValueError(f"a stiffness must be a finite number >= 0, got {value!r:.60}")
    return float(value)
