"""Elliptical slice sampling: draws from a posterior whose prior is N(0, I), without a step length to choose.

From x and a draw v of the prior, the next point lies on the ellipse x cos(a) + v sin(a), at an angle that is drawn from
a bracket which shrinks towards 0 until the likelihood exceeds a drawn level.

References:
    Murray, Adams, MacKay. Elliptical slice sampling. AISTATS 2010, Fig. 2.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

Points = Float[np.ndarray, "chains dimension"]


def slice_sample(
    log_likelihood: Callable[[Points], Float[np.ndarray, " chains"]],
    start: Points,
    steps: int,
    generator: np.random.Generator,
) -> Points:
    """Moves many chains at once.

    Args:
        log_likelihood: Of points, one a row; finite at the start.
        start: Where the chains begin.
        steps: Steps of each.
        generator: Source of randomness.

    Returns:
        Where they end.
    """
    points, height = start.copy(), log_likelihood(start)
    for _ in range(steps):
        # Random numbers are drawn for all chains at every trial, from the step's own stream: whether one chain accepts,
        # which may depend on the last digit of a likelihood, must not change the numbers of the others.
        own = np.random.default_rng(generator.integers(2**63))
        other = own.standard_normal(points.shape)
        level = height + np.log(own.random(len(points)))
        angle = own.uniform(0, 2 * np.pi, len(points))
        low, high = angle - 2 * np.pi, angle.copy()
        waiting = np.arange(len(points))
        before = points.copy()
        while len(waiting):
            turn = angle[waiting, None]
            tried = before[waiting] * np.cos(turn) + other[waiting] * np.sin(turn)
            found = log_likelihood(tried)
            taken = found >= level[waiting]
            points[waiting[taken]], height[waiting[taken]] = tried[taken], found[taken]
            waiting = waiting[~taken]
            below = angle[waiting] < 0
            low[waiting[below]], high[waiting[~below]] = angle[waiting[below]], angle[waiting[~below]]
            angle[waiting] = own.uniform(low, high)[waiting]
    return points
