"""The detectable shift: how strong an effect must be to be found in a fabric, from the atlas alone.

At base parameters theta with n samples, an effect of severity s moves the whitened residual by d(s), after the base
parameters have been fitted again to the data with the effect: friction that a stiffer cloth would explain equally well
cannot be detected, however strong it is. The detection test looks for the best of all causes at one level for all of
them together, so |d| must be larger than for one cause alone. `needed` measures how large.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.base_model import PRIOR_MEAN, PRIOR_SD
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.inference.findings.detection import detection_statistic
from cusick_bench.diagnosis.inference.residuals.residual import Residual, against_base
from cusick_bench.diagnosis.inference.sets.fabric_data import FabricData
from cusick_bench.diagnosis.inference.single_effects.hypotheses import Hypothesis, hypotheses, shifts
from cusick_bench.diagnosis.measure.features import ORDERS, SPREADS, Features
from cusick_bench.diagnosis.measure.statistics import RESOLUTION

NEEDED = 4.0
"""|d| that is found in 80 % of fabrics at the level of 5 %: the median over effects of what `needed` measures."""
STIFFNESS = (-9.0, -8.25, -7.5, -6.75, -6.0, -5.25, -4.5)
"""Levels of theta's bending, ln B / (rho g R^3), from limp to stiff."""
FABRICS = 12
"""Number of fabrics at each level of bending."""
_REFITTED = 0.7  # shifts above this share of what is needed are computed with base parameters fitted again
_SEED = 5


def detectable(
    emulator: Emulator,
    need: Mapping[str, float],
    *,
    inflation: float = 1.0,
    samples: int = 12,
    step: Callable[[], None] = lambda: None,
) -> Mapping[str, tuple[float | None, ...]]:
    """Detectable severity of every effect, in its own unit, at each of `STIFFNESS`: the median over fabrics.

    Args:
        emulator: The atlas.
        need: |d| that each effect needs to be found, from `needed`; `NEEDED` for those it lacks.
        inflation: Inflation of the noise, from calibration.
        samples: Samples of a fabric, draped on both sides, each captured twice.
        step: Called for each of `FABRICS` fabrics at each level.

    Returns:
        By effect; None where half of the fabrics do not show the largest severity that a diagnosis considers.
    """
    severities: dict[str, list[float | None]] = {}
    for level in STIFFNESS:
        at_level = detectable_at(emulator, level, need, inflation=inflation, samples=samples, step=step)
        for name, severity in at_level.items():
            severities.setdefault(name, []).append(float(f"{severity:.3g}") if np.isfinite(severity) else None)
    return {name: tuple(values) for name, values in severities.items() if any(value is not None for value in values)}


def detectable_at(
    emulator: Emulator,
    level: float,
    need: Mapping[str, float],
    *,
    inflation: float = 1.0,
    samples: int = 12,
    fabrics: int = FABRICS,
    step: Callable[[], None] = lambda: None,
) -> dict[str, float]:
    """Detectable severities at one level of bending: medians over fabrics whose other parameters are from the prior.

    Args:
        emulator: The atlas.
        level: ln B / (rho g R^3).
        need: |d| that each effect needs to be found, from `needed`; `NEEDED` for those it lacks.
        inflation: Inflation of the noise, from calibration.
        samples: Samples of a fabric.
        fabrics: Number of fabrics.
        step: Called for each fabric.

    Returns:
        By effect, in its own unit; infinite where it is not found.
    """
    generator = np.random.default_rng(_SEED)
    severities: dict[str, list[float]] = {}
    for _ in range(fabrics):
        theta = PRIOR_MEAN + 0.7 * PRIOR_SD * generator.standard_normal(len(PRIOR_SD))
        theta[0] = level
        expected = expected_features(emulator, theta, samples)
        residual = against_base(emulator, expected, start=theta, fixed=True)
        left = _Left(emulator, expected, residual, against_base(emulator, expected, start=theta).white)
        of_fabric: dict[str, float] = {}
        for hypothesis in hypotheses(emulator):
            if hypothesis.name not in of_fabric:
                moved = shifts(emulator, hypothesis, theta, residual.sd, residual.drift).features
                least = inflation * need.get(hypothesis.name, NEEDED)
                of_fabric[hypothesis.name] = _first(hypothesis, moved, left, least)
        for name, severity in of_fabric.items():
            severities.setdefault(name, []).append(severity)
        step()
    return {name: float(np.median(values)) for name, values in severities.items()}


def needed(
    emulator: Emulator,
    calibration: Calibration,
    generator: np.random.Generator,
    *,
    draws: int = 300,
    power: float = 0.8,
) -> dict[str, float]:
    """|d| at which each effect is found in a share of fabrics, by simulation of the whitened residual.

    Args:
        emulator: The atlas.
        calibration: How far other laws differ in each effect; |d| is in units of noise that is not inflated.
        generator: Random generator of the simulation.
        draws: Fabrics without effect; shifted ones are the same with each effect at a random point of its grid.
        power: The share.

    Returns:
        By effect.
    """
    theta = PRIOR_MEAN.copy()
    expected = expected_features(emulator, theta, 12)
    fabric = FabricData(emulator, Calibration(law_mismatch=calibration.law_mismatch), expected, None, 0.5)
    residual = fabric.against(start=theta, fixed=True)
    model = fabric.model(residual)
    noise = generator.standard_normal((draws, len(residual.white)))
    limit = float(np.quantile(detection_statistic(model, noise), 0.95))
    sizes = np.arange(3.0, 8.5, 0.5)
    sizes_needed: dict[str, float] = {}
    for grid in fabric.grids(residual):
        if grid.hypothesis.prior < 0.5:
            continue
        shares = []
        for size in sizes:
            rows = model.misfit.turned(grid.shift[generator.integers(len(grid.shift), size=draws)])
            unit = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9)
            shares.append(float((detection_statistic(model, noise + size * unit) > limit).mean()))
        sizes_needed[grid.hypothesis.name] = float(np.interp(power, np.maximum.accumulate(shares), sizes))
    return sizes_needed


def expected_features(emulator: Emulator, theta: ndarray, samples: int) -> Features:
    """Features of a fabric that is the base model's mean.

    Args:
        emulator: The atlas.
        theta: Base parameters.
        samples: Samples of the fabric, draped on both sides, each captured twice.

    Returns:
        The features, with the variances that so many samples have.
    """
    mean = emulator.mean(theta)
    sd = emulator.sd(theta)[list(ORDERS)]
    return Features(
        mean=np.stack([mean, mean]),
        samples=np.array([samples, samples]),
        both=samples,
        contrast=np.stack([mean, np.zeros_like(mean)]),
        share=np.stack([np.diag([1.0, 0.0]), np.diag([0.0, 1.0])]) / samples,
        spread=emulator.spread(theta),
        spread_variance=np.array([0.5 / (2 * samples - 2) / 0.75 / len(columns) for _, columns in SPREADS]),
        order=np.zeros(len(ORDERS)),
        order_covariance=np.diag(((0.3 * sd) ** 2 + RESOLUTION[list(ORDERS)] ** 2) / samples),
        order_freedom=0,
    )


@dataclass(frozen=True)
class _Left:
    """The part of a shift of the features that no base parameters explain.

    Attributes:
        emulator: The atlas.
        expected: Features of the fabric without it.
        residual: Residual of these, at the fabric's own parameters.
        without: w at the parameters that fit these best.
    """

    emulator: Emulator
    expected: Features
    residual: Residual
    without: Float[ndarray, "kept"]

    def linear(self, moved: Float[ndarray, "values rows"]) -> Float[ndarray, "values"]:
        """|d| of shifts so small that the fabric's own Jacobian holds."""
        return np.linalg.norm(self.residual.whiten(moved), axis=1)

    def refitted(self, moved: Float[ndarray, "rows"]) -> float:
        """|d| of one shift at the base parameters that fit it best."""
        there = against_base(self.emulator, self.expected, start=self.residual.theta, shift=-moved)
        return float(np.linalg.norm(there.white - self.without))


def _first(hypothesis: Hypothesis, moved: Float[ndarray, "values rows"], left: _Left, need: float) -> float:
    """Severity at which the median shift over directions and places reaches what is needed, by interpolation."""
    severity, linear = np.abs(hypothesis.severity()), left.linear(moved)
    before = (0.0, 0.0)
    for level in np.unique(severity):
        points = np.flatnonzero(severity == level)
        middle = points[np.argsort(linear[points])[len(points) // 2]]
        size = float(linear[middle])
        if size >= _REFITTED * need:
            size = min(size, left.refitted(moved[middle]))
        if size >= need:
            share = (need - before[1]) / (size - before[1])
            return float((before[0] + share * (level - before[0])) * hypothesis.effect.severity.typical)
        before = max(before, (float(level), size), key=lambda one: one[1])
    return float("inf")
