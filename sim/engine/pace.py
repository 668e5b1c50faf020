"""Pace of a drop: all of its steps (`steady`), or two thirds of them with a push towards the end (`brisk`).

Once the folds have formed, a cloth approaches its rest slowly: each linearly implicit step is straight, rotated cloth
resists it, and only the next step accounts for that. The remaining distance shrinks by a constant factor in each step,
whatever the length of the step. With a heavy ball (Polyak) it shrinks faster: the share b of the last displacement is
added to every step,

    x_(n+1) = x_n + h v_(n+1) + b (x_n - x_(n-1)).

The velocity stays that of the step. The last steps have no push, so that the drop ends in the same motion as a steady
one. The first steps, which decide the folds, are exactly those of a steady drop.

References:
    Polyak. Some methods of speeding up the convergence of iteration methods. USSR Computational Mathematics and
    Mathematical Physics 4(5), 1964.
"""

from dataclasses import dataclass
from typing import Literal

PaceName = Literal["steady", "brisk"]
"""Names of the paces, as `DrapeSettings` takes them."""


@dataclass(frozen=True)
class Pace:
    """The steps of a drop.

    Attributes:
        steps: Their number.
        first: Steps without a push at the beginning.
        last: Steps without a push at the end.
        push: Share of the last displacement that is added to the steps between them.
    """

    steps: int
    first: int
    last: int = 0
    push: float = 0.0

    def push_of(self, step: int) -> float:
        """Share of the last displacement that is added to a step.

        Args:
            step: Number of the step, from 0.

        Returns:
            The share; 0 for none.
        """
        return self.push if self.first < step < self.steps - self.last else 0.0


def pace_of(name: PaceName, steps: int) -> Pace:
    """The pace of a drop.

    Args:
        name: `steady` or `brisk`.
        steps: Steps of the steady drop.

    Returns:
        Its steps.
    """
    if name == "steady":
        return Pace(steps, first=steps)
    return Pace(max(1, round(_SHARE * steps)), round(_FIRST * steps), round(_LAST * steps), _PUSH)


# Of a steady drop's steps; the best of nine ways on 31 random cloths of 1205 vertices. `cusick-bench pace` measures it.
_SHARE, _FIRST, _LAST = 0.65, 0.3, 0.1
_PUSH = 0.7  # b; .8 makes the cloth oscillate, .4 hardly helps
