"""A good starting point from a few drapes: the bending stiffness with the training image's drape coefficient.

The drape coefficient rises monotonically with bending stiffness and hardly depends on anything else, so a
bracketing search over one number finds the level of the 15 bending stiffnesses before any gradient is paid
for.

References:
    Cusick, The dependence of fabric drape on bending and shear stiffness, J. Textile Institute 56(11), 1965.
"""

import math

from cusick_bench.datasets.files.silhouette import drape_coefficient_of
from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.solvers.incumbent import Incumbent

FIRST_STEP = math.log(3.0)  # step of log stiffness until the target is bracketed
TOLERANCE = 0.004  # tolerance of the drape coefficient, less than the difference between repeats of a test
LARGEST = math.log(100.0)  # largest distance from the prior median, 5 standard deviations of log bending stiffness


def match_bending_level(incumbent: Incumbent, drapes: int) -> float:
    """Finds the log factor on all bending stiffnesses of the prior median that matches the training image.

    Args:
        incumbent: Search to add the drapes to.
        drapes: Most drapes to spend.

    Returns:
        Log factor of the best match.
    """
    target = drape_coefficient_of(incumbent.problem.train_image, incumbent.problem.protocol)
    below: tuple[float, float] | None = None  # (log factor, drape coefficient - target)
    above: tuple[float, float] | None = None
    best, level = (math.inf, 0.0), 0.0
    for _ in range(drapes):
        try:
            miss = incumbent.drape_coefficient(incumbent.problem.space.bending_level(math.exp(level))) - target
        except DrapeDiverged:
            level += FIRST_STEP / 2  # too limp to converge, as a rule
            continue
        best = min(best, (abs(miss), level))
        if abs(miss) < TOLERANCE:
            break
        if miss < 0:
            below = (level, miss)
        else:
            above = (level, miss)
        level = _next_level(below, above)
        if abs(level) > LARGEST:
            break
    return best[1]


def _next_level(below: tuple[float, float] | None, above: tuple[float, float] | None) -> float:
    """A step outwards until the target is bracketed, then the chord's crossing, off the bracket's ends."""
    if below is None or above is None:
        known = below or above
        assert known is not None
        return known[0] + math.copysign(FIRST_STEP, -known[1])
    share = -below[1] / (above[1] - below[1])
    return below[0] + min(max(share, 0.15), 0.85) * (above[0] - below[0])
