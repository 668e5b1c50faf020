"""Laying and release of a cloth, for drapes that predict, calibrate or diagnose.

The folds of a drape are decided by the stiffness of the cloth, by the shape in which it is laid down, and by whether it
falls or is let down slowly (`cusick-bench fold-selection`, `docs/folds.md`). The release is always a fall, since a
slower release changes the number of folds in the same way as a longer laid shape. Length and height of the laid shape
vary from fabric to fabric around the medians given here.
"""

from dataclasses import dataclass

import numpy as np

STEP_SECONDS = 0.05  # [s] of the drop, implicit Euler
STEPS = 90  # of a drop, 4.5 s in all


@dataclass(frozen=True)
class LogNormal:
    """A positive number that varies.

    Attributes:
        median: Its median.
        log_sd: Standard deviation of its logarithm.
    """

    median: float
    log_sd: float

    def draw(self, generator: np.random.Generator) -> float:
        """A value.

        Args:
            generator: Source of randomness.

        Returns:
            The value.
        """
        return self.median * float(np.exp(self.log_sd * generator.standard_normal()))


LAYING_LENGTH = LogNormal(0.02, 0.6)
"""Correlation length of the shape in which a cloth is laid down [m]; free for each fabric."""
LAYING_HEIGHT = LogNormal(2e-3, 0.7)
"""Standard deviation of its height [m]; free for each fabric."""
