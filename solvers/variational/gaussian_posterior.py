"""Variational inference with a Gaussian q: its draws, its divergence from the prior, its slopes.

q = N(mu, diag(softplus(eta)^2)), draws by reparametrisation, tau = mu + softplus(eta) * epsilon; the prior is N(0, I).
One (mu, eta) may serve many entries of tau: `tie` names, for every entry, the pair it is drawn from.

References:
    Kingma, Welling. Auto-encoding variational Bayes. ICLR 2014. Blundell, Cornebise, Kavukcuoglu, Wierstra. Weight
    uncertainty in neural networks. ICML 2015 (softplus scales, gradients of Eq. 3 and 4). Gong, Mao, Wang. Bayesian
    Differentiable Physics for Cloth Digitalization. CVPR 2024, Eq. 6-10.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

if TYPE_CHECKING:
    from cusick_bench.solvers.adam import Arrays


INFERENCE, PREDICTION = range(2)  # what random numbers are for


def standard_normal(seed: int, purpose: int, index: int, size: int) -> Float[ndarray, " size"]:
    """Numbers from N(0, 1) that depend on nothing else, so that every draw can be made again by itself.

    Args:
        seed: Seed of the run.
        purpose: INFERENCE or PREDICTION.
        index: Number of the draw.
        size: Number of random numbers.

    Returns:
        The numbers.
    """
    return np.random.default_rng([seed, purpose, index]).standard_normal(size)


@dataclass
class Gaussian:
    """The variational distribution.

    Attributes:
        mean: mu, one number a pair.
        raw: eta; the scale is softplus(eta).
        tie: The pair of every entry of tau.
    """

    mean: Float[ndarray, " pairs"]
    raw: Float[ndarray, " pairs"]
    tie: Int[ndarray, " dimension"]

    @classmethod
    def around(cls, mean: Float[ndarray, " pairs"], scale: float, tie: Int[ndarray, " dimension"]) -> Gaussian:
        """q with one scale for all.

        Args:
            mean: mu, one number a pair.
            scale: Standard deviation of every pair.
            tie: The pair of every entry of tau.

        Returns:
            The distribution.
        """
        return cls(mean.copy(), np.full(len(mean), np.log(np.expm1(scale))), tie)

    @property
    def scale(self) -> Float[ndarray, " pairs"]:
        """softplus(eta), the standard deviations."""
        return np.logaddexp(0, self.raw)

    def draw(self, noise: Float[ndarray, "*draws dimension"]) -> Float[ndarray, "*draws dimension"]:
        """tau = mu + softplus(eta) * noise.

        Args:
            noise: Numbers from N(0, 1).

        Returns:
            Drawn parameter vectors.
        """
        return self.mean[self.tie] + self.scale[self.tie] * noise

    def divergence(self) -> tuple[Float[ndarray, " pairs"], Float[ndarray, " pairs"], Float[ndarray, " pairs"]]:
        """KL(q || N(0, 1)) of each pair times the entries it serves, and its derivatives by mean and scale."""
        entries = np.bincount(self.tie, minlength=len(self.mean))
        kl = 0.5 * (self.mean**2 + self.scale**2 - 1) - np.log(self.scale)
        return entries * kl, entries * self.mean, entries * (self.scale - 1 / self.scale)

    def pull_back(
        self, gradient: Float[ndarray, "draws dimension"], noise: Float[ndarray, "draws dimension"]
    ) -> tuple[Float[ndarray, " pairs"], Float[ndarray, " pairs"]]:
        """Derivatives by mean and scale, from those by every draw's tau, summed over the draws.

        Args:
            gradient: Derivatives by every draw's tau.
            noise: What these were drawn with.

        Returns:
            Derivatives by mean and by scale.
        """
        pairs = len(self.mean)
        by_mean = np.bincount(self.tie, gradient.sum(0), minlength=pairs)
        return by_mean, np.bincount(self.tie, (gradient * noise).sum(0), minlength=pairs)

    @property
    def arrays(self) -> Arrays:
        """Arrays that an optimiser changes in place."""
        return {"mean": self.mean, "raw": self.raw}

    def slopes(self, by_mean: Float[ndarray, " pairs"], by_scale: Float[ndarray, " pairs"]) -> Arrays:
        """Derivatives by `mean` and `raw` of a loss.

        Args:
            by_mean: Its derivatives by the mean.
            by_scale: Derivative of the loss by the scale.

        Returns:
            Derivatives by name of the array.
        """
        return {"mean": by_mean, "raw": by_scale / (1 + np.exp(-self.raw))}
