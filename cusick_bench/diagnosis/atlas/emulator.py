"""The atlas as smooth functions: what a fabric's features are at theta, and how much an effect moves them.

With z = theta scaled to [-1, 1], every statistic k has

    base     m_k(z)      = polynomial in z;                    sd_k(z) = exp(polynomial), scatter between samples

and every effect has a response (`response`). The polynomials fitted to the many cheap drapes and those fitted to the
corrections by fewer, more accurate drapes are added; `emulator_fit` says how all are fitted to the points of the atlas.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.base_model import HIGH, LOW
from cusick_bench.diagnosis.atlas.regression_terms import (
    base_terms,
    spread_terms,
)
from cusick_bench.diagnosis.atlas.response import Response
from cusick_bench.diagnosis.atlas.ridge import SummedFit
from cusick_bench.diagnosis.measure.own_outlines import OwnOutlines
from cusick_bench.diagnosis.measure.statistics import (
    RESOLUTION,
)


@dataclass(frozen=True, eq=False)
class Emulator:
    """The atlas, fitted.

    Attributes:
        base: Fitted function of every statistic (see the module) [its unit].
        base_spread: Fitted function of `Features.spread`.
        log_sd: ln of the standard deviation between samples of every statistic.
        correlation: Correlation of all statistics of both faces, between samples.
        discrepancy: Covariance of the base model's error [sd], the same on both faces, at the limp and at the stiff end
            of the atlas.
        responses: Response of each effect, by its name.
        outlines: Outlines of the fabric that is diagnosed, on which effects that act on the outline alone are undone
            instead of being emulated; None to emulate all.
        warp_seen_down: Angle at which the camera sees the warp of a cloth that lies face down [rad], as in `Captures`.
    """

    base: SummedFit
    base_spread: SummedFit
    log_sd: SummedFit
    correlation: Float[ndarray, "faces_statistics faces_statistics"]
    discrepancy: Float[ndarray, "2 statistics statistics"]
    responses: Mapping[str, Response]
    outlines: OwnOutlines | None = None
    warp_seen_down: float = np.pi

    def mean(self, theta: Float[ndarray, "*rows parameters"]) -> Float[ndarray, "*rows statistics"]:
        """Mean of every statistic, the same on both faces.

        Args:
            theta: Base parameters of one cloth or of several.

        Returns:
            Means of each [each statistic's unit].
        """
        return self.base(base_terms(theta.reshape(-1, theta.shape[-1]))).reshape(*theta.shape[:-1], -1)

    def spread(self, theta: Float[ndarray, "*rows parameters"]) -> Float[ndarray, "*rows spreads"]:
        """`Features.spread` of the base model.

        Args:
            theta: Base parameters of one cloth or of several.

        Returns:
            The spreads of each.
        """
        return self.base_spread(spread_terms(theta.reshape(-1, theta.shape[-1]))).reshape(*theta.shape[:-1], -1)

    def sd(self, theta: Float[ndarray, "parameters"]) -> Float[ndarray, "statistics"]:
        """Standard deviation of every statistic between samples; never below what images resolve.

        Args:
            theta: Base parameters.

        Returns:
            Standard deviations [each statistic's unit].
        """
        return np.maximum(np.exp(self.log_sd(spread_terms(theta[None]))[0]), RESOLUTION)

    def wrong(self, theta: Float[ndarray, "parameters"]) -> Float[ndarray, "statistics statistics"]:
        """Discrepancy of the base model's means.

        It is what the fit leaves unexplained in the atlas, and in addition the directions in which the atlas' cheaper
        law and coarser meshes differed from the base model: another simulator or a real cloth may differ as much.

        Args:
            theta: Base parameters.

        Returns:
            Its covariance, in units of sd.
        """
        limp, stiff = nearness_to_ends(theta[0])
        covariance = limp * self.discrepancy[0] + stiff * self.discrepancy[1]
        terms, sd = base_terms(theta[None]), self.sd(theta)
        for correction, columns in zip(self.base.fits[1:], self.base.columns[1:], strict=True):
            change = correction(terms[:, columns])[0] / sd
            covariance = covariance + np.outer(change, change)
        return covariance


def nearness_to_ends(
    bending: float | Float[ndarray, "*rows"],
) -> tuple[Float[ndarray, "*rows"], Float[ndarray, "*rows"]]:
    """How near cloth is to the limp and to the stiff end of the atlas.

    Args:
        bending: theta's bending.

    Returns:
        Shares of the two ends, which add up to 1.
    """
    share = np.clip((bending - LOW[0]) / (HIGH[0] - LOW[0]), 0, 1)
    return np.asarray(1 - share), np.asarray(share)
