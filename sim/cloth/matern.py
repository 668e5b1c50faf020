"""Matern random fields over the cloth, as the stationary solutions of an SPDE in the eigenbasis of its operator.

(kappa^2 - Laplacian)^(3/2) u = white noise on a disc somewhat larger than the cloth, free at its edge, has the
eigenfunctions phi = J_m(k r) cos(m theta), J_m(k r) sin(m theta) with J_m'(k R) = 0. In them the precision of u is
diagonal, u = sum_j sqrt(S_j) w_j phi_j with w ~ N(0, I) and S_j ~ (kappa^2 + k_j^2)^-3: a Matern field of smoothness
2 with kappa = 2 / length, differentiable in its amplitude and length. The functions are known in closed form, so the
same weights are the same field on every mesh. The disc is larger than the cloth since a free edge doubles the
variance near it.

References:
    Lindgren, Rue, Lindstrom. An explicit link between Gaussian fields and Gaussian Markov random fields: the
    stochastic partial differential equation approach. JRSS B 73(4), 2011, Sec. 2 and App. A.4.
    Solin, Sarkka. Hilbert space methods for reduced-rank Gaussian process regression. Statistics and Computing 30,
    2020.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from scipy.special import jnp_zeros, jv
from torch import Tensor

from cusick_bench.sim.constants import CLOTH_RADIUS

SMOOTHNESS = 2.0  # nu of the Matern covariance
EXTENSION = 1.25  # radius of the disc as a multiple of the cloth's


@dataclass(frozen=True)
class DiscModes:
    """The lowest eigenfunctions of the Laplacian on a disc with a free edge, orthonormal.

    Attributes:
        radius: Radius of the disc [m].
        order: m of every mode.
        wave_number: k of every mode [1/m], ascending.
        sine: Whether its angular part is sin(m theta) rather than cos(m theta).
    """

    radius: float
    order: ndarray
    wave_number: Float[ndarray, "modes"]
    sine: ndarray

    def __call__(self, points: Float[ndarray, "points 2"]) -> Float[ndarray, "points modes"]:
        """Values at material points [1/m]."""
        r, theta = np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0])
        values = np.empty((len(points), len(self.order)))
        for j, (m, k, sine) in enumerate(zip(self.order, self.wave_number, self.sine, strict=True)):
            values[:, j] = jv(m, k * r) * (np.sin(m * theta) if sine else np.cos(m * theta)) / self._norm(m, k)
        return values

    def _norm(self, m: int, k: float) -> float:
        """Square root of the integral of the mode's square over the disc [m]."""
        edge = k * self.radius
        if edge == 0:
            return self.radius * np.sqrt(np.pi)
        angular = 2 * np.pi if m == 0 else np.pi
        return float(np.sqrt(angular * 0.5 * self.radius**2 * (1 - (m / edge) ** 2)) * abs(jv(m, edge)))


@lru_cache(maxsize=8)
def disc_modes(count: int, radius: float = EXTENSION * CLOTH_RADIUS) -> DiscModes:
    """The `count` modes of lowest wave number on a disc.

    Args:
        count: Number of modes, >= 1.
        radius: Radius of the disc [m].

    Returns:
        The modes, wave numbers ascending.
    """
    found = [(0.0, 0, False)]
    highest = 2 * int(np.sqrt(count)) + 4  # by Weyl's law k R grows as 2 sqrt(count), and order m begins above m
    for m in range(highest + 1):
        for k in jnp_zeros(m, int(np.sqrt(count)) + 2) / radius:
            found += [(k, m, sine) for sine in ([False, True] if m else [False])]
    wave_number, order, sine = zip(*sorted(found)[:count], strict=True)
    return DiscModes(radius, np.array(order), np.array(wave_number), np.array(sine))


def matern_root(modes: DiscModes, amplitude: Float[Tensor, ""], length: Float[Tensor, ""]) -> Float[Tensor, "modes"]:
    """sqrt(S_j): standard deviation of every mode's coefficient.

    Args:
        modes: Basis.
        amplitude: Standard deviation of the field, averaged over the disc, in the field's unit.
        length: Correlation length [m]: over it the correlation falls to about a half.

    Returns:
        Standard deviations, differentiable by amplitude and length.
    """
    kappa_squared = 2 * SMOOTHNESS / length**2
    spectrum = (1 + torch.as_tensor(modes.wave_number) ** 2 / kappa_squared) ** (-(SMOOTHNESS + 1))
    area = np.pi * modes.radius**2
    return amplitude * (spectrum * (area / spectrum.sum())).sqrt()
