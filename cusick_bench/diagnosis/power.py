"""The detectable shift: how strong an effect must be to be found in a fabric, from the atlas alone.

At base parameters theta with n samples, an effect of severity s moves the whitened residual by d(s). The detection test
looks for the best of all causes; its level holds over all of them together, so |d| must be larger than for one cause
alone. `needed` measures by how much.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.base_model import PRIOR_MEAN, PRIOR_SD
from cusick_bench.diagnosis.emulator import Emulator
from cusick_bench.diagnosis.evidence import detection_statistic, grids
from cusick_bench.diagnosis.features import ORDERS, SPREADS, Features
from cusick_bench.diagnosis.hypotheses import Hypothesis, hypotheses, shifts
from cusick_bench.diagnosis.residual import against_base
from cusick_bench.diagnosis.statistics import RESOLUTION

NEEDED = 4.0
"""|d| that is found in 80 % of fabrics at the level of 5 %, median over effects: see `needed`."""
STIFFNESS = (-9.0, -8.25, -7.5, -6.75, -6.0, -5.25, -4.5)
"""Levels of theta's bending, ln B / (rho g R^3), from limp to stiff."""
_FABRICS = 12
_SEED = 5


def detectable(emulator: Emulator, *, samples: int = 12) -> Mapping[str, tuple[float | None, ...]]:
    """Detectable severity of every effect, in its own unit, at each of `STIFFNESS`: the median over fabrics.

    Args:
        emulator: The atlas.
        samples: Samples of a fabric, draped on both sides, each captured twice.

    Returns:
        By effect; None where it is not found at six times the typical severity in half of the fabrics.
    """
    found: dict[str, list[float | None]] = {}
    for level in STIFFNESS:
        for name, severity in _at_level(emulator, level, samples).items():
            found.setdefault(name, []).append(float(f"{severity:.3g}") if np.isfinite(severity) else None)
    return {name: tuple(values) for name, values in found.items() if any(value is not None for value in values)}


def _at_level(emulator: Emulator, level: float, samples: int) -> dict[str, float]:
    """Medians over fabrics that are like in bending and else as the prior has them; infinite where not found."""
    generator = np.random.default_rng(_SEED)
    found: dict[str, list[float]] = {}
    for _ in range(_FABRICS):
        theta = PRIOR_MEAN + 0.7 * PRIOR_SD * generator.standard_normal(len(PRIOR_SD))
        theta[0] = level
        residual = against_base(emulator, _expected(emulator, theta, samples), start=theta, fixed=True)
        own: dict[str, float] = {}
        for hypothesis in hypotheses(emulator):
            moved = shifts(emulator, hypothesis, theta, residual.sd, residual.drift)
            size = np.linalg.norm(residual.whiten(moved.rows), axis=1)
            own.setdefault(hypothesis.name, _first(hypothesis, size))
        for name, severity in own.items():
            found.setdefault(name, []).append(severity)
    return {name: float(np.median(values)) for name, values in found.items()}


def needed(
    emulator: Emulator, generator: np.random.Generator, *, draws: int = 300, power: float = 0.8
) -> dict[str, float]:
    """|d| at which each effect is found in a share of fabrics, by simulation of the whitened residual.

    Args:
        emulator: The atlas.
        generator: Of the simulation.
        draws: Fabrics without effect; shifted ones are the same with each effect at a random point of its grid.
        power: The share.
    """
    theta = PRIOR_MEAN.copy()
    residual = against_base(emulator, _expected(emulator, theta, 12), start=theta, fixed=True)
    made = grids(emulator, residual)
    noise = generator.standard_normal((draws, len(residual.white)))
    limit = float(np.quantile(detection_statistic(noise, made), 0.95))
    sizes = np.arange(3.0, 8.5, 0.5)
    found: dict[str, float] = {}
    for grid in made:
        if grid.hypothesis.prior < 0.5:
            continue
        shares = []
        for size in sizes:
            rows = grid.shift[generator.integers(len(grid.shift), size=draws)]
            unit = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9)
            shares.append(float((detection_statistic(noise + size * unit, made) > limit).mean()))
        found[grid.hypothesis.name] = float(np.interp(power, np.maximum.accumulate(shares), sizes))
    return found


def _expected(emulator: Emulator, theta: ndarray, samples: int) -> Features:
    """Features of a fabric that is the base model's mean."""
    mean = emulator.mean(theta)
    sd = emulator.sd(theta)[list(ORDERS)]
    return Features(
        np.stack([mean, mean]), np.array([samples, samples]), samples, emulator.spread(theta),
        np.full(len(SPREADS), 0.5 / (2 * samples - 2) / 0.75), np.zeros(len(ORDERS)),
        ((0.3 * sd) ** 2 + RESOLUTION[list(ORDERS)] ** 2) / samples,
    )  # fmt: skip


def _first(hypothesis: Hypothesis, size: Float[ndarray, "values"]) -> float:
    """Severity at which the mean shift over directions and places reaches what is needed, by interpolation."""
    severity = np.abs(hypothesis.severity())
    levels = np.unique(severity)
    reached = np.array([np.median(size[severity == level]) for level in levels])
    above = np.flatnonzero(reached >= NEEDED)
    if not len(above):
        return float("inf")
    k = int(above[0])
    if k == 0:
        level = levels[0] * NEEDED / max(reached[0], 1e-9)
    else:
        share = (NEEDED - reached[k - 1]) / (reached[k] - reached[k - 1])
        level = levels[k - 1] + share * (levels[k] - levels[k - 1])
    return float(level * hypothesis.effect.severity.typical)
