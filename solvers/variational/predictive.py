"""Posterior-predictive drapes: cloths drawn from what a solver has learned, draped in batches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.solvers.base import Prediction, Progress

if TYPE_CHECKING:
    from cusick_bench.problem import DrapeProblem, Observation


TOGETHER = 16  # draws draped at once, eight for each of two threads; a kill loses at most these
MOST = 2  # largest number of draws tried for every one that is wanted


def predictive_draws(
    problem: DrapeProblem,
    tau: Callable[[int], Float[np.ndarray, " dimension"]],
    count: int,
    progress: Progress,
) -> dict[int, Observation]:
    """Drapes the draws 0, 1, ... until `count` of them are at rest; those whose drape fails are left out.

    Best-of-n scores are only comparable for equal n, so that a draw which fails is replaced by a further one. Fewer
    than `count` come back where more than half fail.

    Args:
        problem: The problem, which simulates and keeps finished drapes, so that a killed run goes on.
        tau: Parameters of a draw, always the same for the same number.
        count: Number of draws.
        progress: Called with what is being done and the share that is done.

    Returns:
        What was seen of each draw that is at rest, by its number.

    Raises:
        DrapeDiverged: Every one of them fails.
    """
    seen: dict[int, Observation] = {}
    tried = 0
    progress(f"draping draws, 0 of {count}", problem.meter.share)
    while len(seen) < count and tried < MOST * count:
        chosen = range(tried, min(tried + TOGETHER, tried + count - len(seen), MOST * count))
        drapes = problem.draw_batch(np.stack([tau(index) for index in chosen]))
        seen |= {index: one for index, one in zip(chosen, drapes, strict=True) if one is not None}
        tried = chosen.stop
        progress(f"draping draws, {len(seen)} of {count}", problem.meter.share)
    if not seen:
        raise DrapeDiverged(f"none of {tried} drawn cloths came to rest: {problem.meter.trace[-1].failure}")
    return seen


def with_draws(
    best: Prediction, seen: dict[int, Observation], posterior: dict[str, np.ndarray], turned: np.ndarray | None = None
) -> Prediction:
    """A fit of the training image with its posterior and what was drawn from that.

    Args:
        best: Fit of the training image.
        seen: Draws by their number.
        posterior: What was learned, by name of the array.
        turned: Which draws lie the other way up, in the order of `seen`; None where the solver knows one face only.

    Returns:
        An answer with draws, and with their numbers in its posterior.
    """
    images, vertices = (np.stack([getattr(one, name) for one in seen.values()]) for name in ("image", "vertices"))
    posterior = posterior | {"draws": np.array(list(seen))}
    return replace(best, draws=images, draw_vertices=vertices, draw_turned=turned, posterior=posterior)
