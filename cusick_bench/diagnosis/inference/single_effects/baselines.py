"""Simpler ways to name a cause, for comparison: base parameters are not projected out, and there is no Occam's razor.

    largest-marginal-score   the effect whose shift correlates best with data minus the calibrated base model
    lasso-without-projection the largest effect of a sparse regression on all effects' linear shifts

Both take the base model at its best fit as the truth, so errors of the base parameters are attributed to effects.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.inference.single_effects.evidence import Grid

_THRESHOLD = 3.5  # standard deviations; about 5 % of fabrics without effect exceed it over 20 effects
_STRENGTH = 0.3


def largest_marginal_score(
    value: Float[ndarray, "kept"], grids: Sequence[Grid], shifts: Sequence[Float[ndarray, "points kept"]]
) -> dict[str, float]:
    """Normalised scores of all effects; empty where none is large.

    Args:
        value: Data minus base, in sampling standard deviations, not projected.
        grids: All hypotheses.
        shifts: Shifts of `value`, by hypothesis.

    Returns:
        By effect, the largest first.
    """
    scores: dict[str, float] = {}
    for grid, moved in zip(grids, shifts, strict=True):
        size = np.linalg.norm(moved, axis=1) + 1e-12
        score = float((moved @ value / size).max())
        scores[grid.hypothesis.name] = max(score, scores.get(grid.hypothesis.name, 0.0))
    if not scores or max(scores.values()) < _THRESHOLD:
        return {}
    weights = {name: score**2 for name, score in scores.items()}
    total = sum(weights.values())
    return {name: weight / total for name, weight in sorted(weights.items(), key=lambda item: -item[1])}


def lasso_without_projection(
    value: Float[ndarray, "kept"], grids: Sequence[Grid], shifts: Sequence[Float[ndarray, "points kept"]]
) -> dict[str, float]:
    """Normalised coefficients of a lasso; empty where none is active.

    Args:
        value: Data minus base, in sampling standard deviations, not projected.
        grids: All hypotheses.
        shifts: Shifts of `value`, by hypothesis.

    Returns:
        By effect, the largest first.
    """
    import cvxpy as cp  # slow to import

    if not grids:
        return {}
    columns, names = [], []
    for grid, moved in zip(grids, shifts, strict=True):
        small = np.abs(grid.severity()) < 2.5
        leading = np.linalg.eigh(moved[small].T @ moved[small])[1][:, :-3:-1].T
        columns += list(leading)
        names += [grid.hypothesis.name] * len(leading)
    matrix = np.array(columns).T
    weights = cp.Variable(matrix.shape[1])
    strongest = max(float(np.abs(matrix.T @ value).max()), _THRESHOLD)
    problem = cp.Problem(
        cp.Minimize(0.5 * cp.sum_squares(value - matrix @ weights) + _STRENGTH * strongest * cp.norm1(weights))
    )
    problem.solve(solver=cp.CLARABEL)
    if weights.value is None or np.abs(matrix.T @ value).max() < _THRESHOLD:
        return {}
    sizes: dict[str, float] = {}
    for name, weight in zip(names, weights.value, strict=True):
        sizes[name] = sizes.get(name, 0.0) + abs(float(weight))
    total = sum(sizes.values())
    return {
        name: size / total for name, size in sorted(sizes.items(), key=lambda item: -item[1]) if size > 1e-3 * total
    }
