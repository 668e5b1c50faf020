"""What an atlas' responses leave unexplained of fabrics that they were not fitted to.

For every effect the fabrics are divided into ten parts, each predicted by a fit to the other nine. The squared errors
and the squared shifts of all statistics, in sd, are summed, and the scatter of a fabric's few samples is subtracted
from both sums. Their ratio is the share of the shifts that is not explained: 0 at best, 1 where the response is no
better than expecting no shift. The means without effect are checked in the same way on fabrics draped by the base
model's own law, by the root mean square of their error in standard deviations between samples.

References:
    Stone. Cross-validatory choice and assessment of statistical predictions. JRSS B 36(2), 1974.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.design import BASE, FINE, FINEST, Design
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.emulator_fit import fit_base_means
from cusick_bench.diagnosis.atlas.points import Point
from cusick_bench.diagnosis.atlas.regression_terms import base_terms
from cusick_bench.diagnosis.atlas.response import LEAST_SAMPLES, Changes, changes, response
from cusick_bench.diagnosis.measure.statistics import EVEN, FREE, GROUPS, NAMES
from cusick_bench.sim.effects import Effect, registered

_PARTS = 10
THIRDS = ("limp", "middle", "stiff")


def unexplained(
    design: Design, points: Mapping[str, Mapping[int, Point]], emulator: Emulator
) -> dict[str, Float[ndarray, "3"]]:
    """Share of each effect's shifts that is not explained, for the limpest, middle and stiffest third of fabrics.

    Args:
        design: What the atlas was made of.
        points: What `points.read_points` returned.
        emulator: Fitted to them: its scatter between samples is the unit.

    Returns:
        The shares by effect; 0 at best.
    """
    theta = design.theta()
    sd = np.stack([emulator.sd(one) for one in theta])
    return {
        name: unexplained_shares(registered()[name], changes(registered()[name], theta, points[BASE], points[name], sd))
        for name in emulator.responses
    }


def error_of_means(
    design: Design, points: Mapping[str, Mapping[int, Point]], emulator: Emulator
) -> dict[str, Float[ndarray, "3"]]:
    """Cross-validated error of the means without effect, for the limpest, middle and stiffest third of fabrics.

    Args:
        design: What the atlas was made of.
        points: What `points.read_points` returned.
        emulator: Fitted to them: its scatter between samples is the unit.

    Returns:
        Root mean square error by group of statistics [sd]; empty where too few fabrics are draped by the base model's
        own law.
    """
    theta, fine = design.theta(), points.get(FINE, {})
    numbers = [n for n, point in fine.items() if np.isfinite(point.statistics).all((1, 2)).sum() >= LEAST_SAMPLES]
    if len(numbers) < 2 * _PARTS:
        return {}
    parts = np.random.default_rng(0).permutation(len(numbers)) % _PARTS
    squares = np.zeros((len(numbers), len(NAMES)))
    for part in range(_PARTS):
        held = {numbers[row] for row in np.flatnonzero(parts == part)}
        others = {
            name: {n: p for n, p in one.items() if n not in held}
            for name, one in points.items()
            if name != FINEST  # corrects errors of the base model's mesh, which the predicted drapes have
        }
        level, _ = fit_base_means(theta, others)
        for row in np.flatnonzero(parts == part):
            at = theta[numbers[row]]
            values = fine[numbers[row]].statistics
            values = values[np.isfinite(values).all((1, 2))].mean(1)
            error = (values.mean(0) - level(base_terms(at[None]))[0]) / emulator.sd(at)
            squares[row] = error**2 - (values.var(0, ddof=1) / len(values)) / emulator.sd(at) ** 2
    bending = theta[numbers, 0]
    third = np.digitize(bending, np.quantile(bending, [1 / 3, 2 / 3]))
    allowed = {*FREE, *EVEN}
    return {
        name: np.array(
            [np.sqrt(max(squares[third == k][:, [c for c in columns if c in allowed]].mean(), 0)) for k in range(3)]
        )
        for name, columns in GROUPS.items()
        if allowed.intersection(columns)
    }


def unexplained_shares(effect: Effect, measured: Changes) -> Float[ndarray, "3"]:
    """Cross-validated share of the squared shifts that the fitted response of an effect leaves unexplained.

    Args:
        effect: The effect.
        measured: Its measured changes, which are fitted and predicted in parts.

    Returns:
        The share among the limp, the middle and the stiff third of the fabrics [1]; above 1 where expecting no shift
        would be better.
    """
    parts = np.random.default_rng(0).permutation(len(measured.theta)) % _PARTS
    left = measured.shift.copy()
    for part in range(_PARTS):
        held = parts == part
        fitted, held_out = response(effect, measured.of(~held)), measured.of(held)
        for face, severity in enumerate(held_out.severity.T):
            left[held, face] -= fitted.shift(held_out.theta, severity, held_out.place)[0]
    error, size = (((values**2) - measured.noise).sum((1, 2)) for values in (left, measured.shift))
    third = np.digitize(measured.theta[:, 0], np.quantile(measured.theta[:, 0], [1 / 3, 2 / 3]))
    return np.array([error[third == k].sum() / size[third == k].sum() for k in range(len(THIRDS))])
