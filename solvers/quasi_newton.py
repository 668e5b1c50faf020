"""L-BFGS whose whole state can be saved, for searches with more unknowns than a journal of gradients could hold.

The direction is the two-loop recursion's, the step the first of 1, 1/4, 1/16, ... that satisfies Armijo's condition.
Where none does, what was learnt of the curvature is forgotten once; where steepest descent does not get lower either,
the search ends.

References:
    Liu, Nocedal, On the Limited Memory BFGS Method for Large Scale Optimization, Math. Programming 45, 1989.
    Nocedal, Wright, Numerical Optimization, 2nd edition, 2006, Algorithms 7.4 and 3.1.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

MEMORY = 12  # pairs of steps and gradient changes
TRIALS = 4  # step lengths tried along a direction
SHORTENING = 1 / 4
SUFFICIENT = 1e-4  # share of the promised decrease (Armijo)

Vector = Float[np.ndarray, " unknowns"]
Function = Callable[[Vector], tuple[float, Vector]]


@dataclass(frozen=True)
class Search:
    """A point with what was learnt on the way to it.

    Attributes:
        point: Where the search is.
        value: The function there.
        gradient: Its gradient there.
        steps: Latest steps, oldest first.
        changes: How the gradient changed along them.
    """

    point: Vector
    value: float
    gradient: Vector
    steps: Float[np.ndarray, "pairs unknowns"]
    changes: Float[np.ndarray, "pairs unknowns"]

    @classmethod
    def at(cls, point: Vector, function: Function) -> "Search":
        """A search that begins."""
        value, gradient = function(point)
        return cls(point, value, gradient, np.zeros((0, len(point))), np.zeros((0, len(point))))

    def forgetful(self) -> "Search":
        """The same point, without what was learnt."""
        return replace(self, steps=self.steps[:0], changes=self.changes[:0])

    def direction(self, first: float) -> Vector:
        """Minus the approximate inverse Hessian times the gradient; at first minus the gradient, `first` long."""
        if len(self.steps) == 0:
            return self.gradient * (-first / max(float(np.linalg.norm(self.gradient)), 1e-300))
        along, pairs = self.gradient.copy(), list(zip(self.steps, self.changes, strict=True))
        weights = []
        for step, change in reversed(pairs):
            weights.append(float(step @ along) / float(step @ change))
            along -= weights[-1] * change
        step, change = pairs[-1]
        along *= float(step @ change) / float(change @ change)
        for (step, change), weight in zip(pairs, reversed(weights), strict=True):
            along += step * (weight - float(change @ along) / float(step @ change))
        return -along

    def moved(self, point: Vector, value: float, gradient: Vector) -> "Search":
        """The search at its next point, a pair richer where the curvature along the step is positive."""
        step, change = point - self.point, gradient - self.gradient
        steps, changes = self.steps, self.changes
        if float(step @ change) > 1e-10 * float(np.linalg.norm(step) * np.linalg.norm(change)):
            steps = np.concatenate([steps, step[None]])[-MEMORY:]
            changes = np.concatenate([changes, change[None]])[-MEMORY:]
        return Search(point, value, gradient, steps, changes)


def descend(search: Search, function: Function, *, first: float) -> Search | None:
    """One iteration.

    Args:
        search: Where it stands.
        function: Value and gradient at a point.
        first: Length of the first trial step where nothing is known of the curvature.

    Returns:
        The search at a lower point, or None where neither direction leads to one.
    """
    for attempt in (search, search.forgetful()) if len(search.steps) else (search,):
        direction = attempt.direction(first)
        slope, length = float(attempt.gradient @ direction), 1.0
        for _ in range(TRIALS):
            point = attempt.point + length * direction
            value, gradient = function(point)
            if value <= attempt.value + SUFFICIENT * length * slope:
                return attempt.moved(point, value, gradient)
            length *= SHORTENING
    return None
