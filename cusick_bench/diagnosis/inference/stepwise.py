"""Several causes, one after the other: which effects a real fabric needs before no further one shows.

Forward selection: the cause with the best evidence is taken off the whitened residual, then the next, until evidence
runs out. Each is charged for its freedom as a single cause is, so a step that noise could make is not taken; the order
says which explains most, not which came first in nature. Effects are taken as their own laws have them: room for
another law would let a very strong effect stand for several together.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.inference.evidence import Candidate, Grid, candidates

MOST = 5
_LEAST_EVIDENCE = 4.0
"""ln of the evidence that a step must have: with some twenty causes to choose from, noise reaches it in 1 of 20."""
_LEAST_GAIN = 0.97  # share of |w|^2 that a step may leave at most


@dataclass(frozen=True, eq=False)
class Step:
    """A cause that was taken off.

    Attributes:
        candidate: The cause at its best parameters.
        misfit: Mean square of w that is left; 1 where all is explained.
    """

    candidate: Candidate
    misfit: float


def forward_selection(white: Float[ndarray, "kept"], grids: Sequence[Grid]) -> list[Step]:
    """Takes causes off what the base model leaves until no further one shows.

    Args:
        white: What the base model leaves.
        grids: All hypotheses.

    Returns:
        Causes in the order in which they were taken off, at most `MOST`.
    """
    left, open_grids, steps = white, list(grids), []
    while len(steps) < MOST and (taken := _next(left, open_grids)) is not None:
        best, left = taken
        open_grids = [one for one in open_grids if one.hypothesis.name != best.hypothesis.name]
        steps.append(Step(best, float(left @ left) / len(left)))
    return steps


def _next(left: Float[ndarray, "kept"], grids: Sequence[Grid]) -> tuple[Candidate, Float[ndarray, "kept"]] | None:
    """The cause with the best evidence of those that leave less, and what it leaves; None where there is none.

    Far beyond the atlas its own uncertainty lets a strong effect be likely that leaves more than it takes.
    """
    for best in candidates(left, grids, law_difference=0.0):
        if best.log_evidence < _LEAST_EVIDENCE:
            return None
        grid = next(one for one in grids if one.hypothesis == best.hypothesis)
        rest = left - grid.shift[grid.best(grid.log_likelihood(left, 0.0))]
        if rest @ rest < _LEAST_GAIN * (left @ left):
            return best, rest
    return None
