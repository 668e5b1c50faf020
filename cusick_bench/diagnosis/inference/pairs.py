"""Two causes at once: proposed by a sparse programme, weighed like single ones.

    minimise 1/2 |w - sum_e G_e b_e|^2 + lambda sum_e sqrt(k_e) |b_e|

over groups, one an effect, whose columns G_e span the shifts that the effect can make (the leading directions of its
grid); the effects with the largest |G_e b_e| are paired with each other. A pair's evidence is that of its better half,
times that of the other on what the first leaves.

References:
    Yuan, Lin. Model selection and estimation in regression with grouped variables. JRSS B 68(1), 2006.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.inference.evidence import Candidate, Grid, candidates

_COLUMNS = 3  # directions kept of each effect's grid
_STRENGTH = 0.25  # of the penalty, as a share of the one that silences every effect
_ACTIVE = 4


def proposed(white: Float[ndarray, "kept"], grids: Sequence[Grid]) -> list[str]:
    """Effects that a group lasso leaves active.

    Args:
        white: What the base model leaves.
        grids: All hypotheses.

    Returns:
        Their names, the largest first, at most four.
    """
    import cvxpy as cp  # slow to import, and only diagnoses with something to explain need it

    groups: dict[str, ndarray] = {}
    for grid in grids:
        small = np.abs(grid.hypothesis.severity()) < 2.5
        vectors = np.linalg.svd(grid.shift[small], full_matrices=False)[2][:_COLUMNS].T
        groups.setdefault(grid.hypothesis.name, vectors)
    names = list(groups)
    variables = {name: cp.Variable(groups[name].shape[1]) for name in names}
    explained = sum(groups[name] @ variables[name] for name in names)
    silent = max(float(np.linalg.norm(groups[name].T @ white)) / np.sqrt(groups[name].shape[1]) for name in names)
    penalty = sum(np.sqrt(groups[name].shape[1]) * cp.norm(variables[name]) for name in names)
    problem = cp.Problem(cp.Minimize(0.5 * cp.sum_squares(white - explained) + _STRENGTH * silent * penalty))
    problem.solve(solver=cp.CLARABEL)
    sizes = {name: 0.0 if v.value is None else float(np.linalg.norm(v.value)) for name, v in variables.items()}
    largest = max(sizes.values(), default=0.0)
    return [name for name in sorted(names, key=lambda n: -sizes[n]) if sizes[name] > 1e-3 * largest][:_ACTIVE]


def pairs(
    white: Float[ndarray, "kept"], grids: Sequence[Grid], singles: Sequence[Candidate]
) -> dict[tuple[str, str], tuple[float, tuple[Candidate, Candidate]]]:
    """Log evidence of pairs of effects against none, and their parameters.

    Args:
        white: What the base model leaves.
        grids: All hypotheses.
        singles: Every hypothesis alone, best first.

    Returns:
        Log evidence and the best points of both, by the names of the pair.
    """
    leading = list(dict.fromkeys([one.hypothesis.name for one in singles[:3]] + proposed(white, grids)))
    weighed = {}
    for first, second in combinations(leading, 2):
        orders = (_pair(white, grids, singles, a, b) for a, b in ((first, second), (second, first)))
        weighed[first, second] = max(orders, key=lambda order: order[0])
    return weighed


def _pair(
    white: ndarray, grids: Sequence[Grid], singles: Sequence[Candidate], first: str, second: str
) -> tuple[float, tuple[Candidate, Candidate]]:
    """`first` at its best point, then `second` on what that leaves."""
    leading = next(one for one in singles if one.hypothesis.name == first)
    grid = next(g for g in grids if g.hypothesis == leading.hypothesis)
    point = grid.best(grid.log_likelihood(white))
    left = white - grid.shift[point]
    other = candidates(left, [g for g in grids if g.hypothesis.name == second])[0]
    freedom = leading.log_likelihood - leading.log_evidence  # what the first one's grid costs
    gained = 0.5 * float(white @ white) - 0.5 * float(left @ left)
    return gained - freedom + other.log_evidence, (leading, other)
