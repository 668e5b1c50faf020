"""Random fields of the true world: Matern covariance, by plane waves with Student-t wave vectors.

The spectral density of a Matern field of smoothness nu in the plane, (2 nu / length^2 + k^2)^-(nu + 1), is that of a
Student-t vector with 2 nu degrees of freedom. Rougher than the diagnosis' own fields, whose covariance is Gaussian.

References:
    Rasmussen, Williams. Gaussian Processes for Machine Learning, 2006, Eq. 4.15.
    Rahimi, Recht. Random features for large-scale kernel machines. NeurIPS 2007.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.cloth.shape import SmoothField

Field = Callable[[Float[ndarray, "points 2"]], Float[ndarray, "points"]]
"""From material points about the cloth's centre [m] to values."""

Outline = Callable[[Float[ndarray, "points"]], Float[ndarray, "points"]]
"""From a direction in the cloth [rad] to the cut's radius over the nominal one."""

_WAVES = 200
_SHORTEST = 0.008  # [m]; meshes resolve no shorter waves


def matern_field(amplitude: float, length: float, smoothness: float, generator: np.random.Generator) -> SmoothField:
    """Draws a field.

    Args:
        amplitude: Standard deviation.
        length: Correlation length [m].
        smoothness: Smoothness nu of the covariance.
        generator: Source of randomness.

    Returns:
        The field.
    """
    waves = generator.normal(0, 1 / length, (_WAVES, 2))
    waves /= np.sqrt(generator.chisquare(2 * smoothness, (_WAVES, 1)) / (2 * smoothness))
    number = np.hypot(waves[:, :1], waves[:, 1:])
    waves *= np.minimum(1, 2 * np.pi / _SHORTEST / number)
    return SmoothField(amplitude, waves, generator.uniform(0, 2 * np.pi, _WAVES))
