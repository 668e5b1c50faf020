"""Expected statistics of the drapes of a cloth, learned once: the knowledge of an inference before its first drape.

Random cloths are draped, one specimen of each. Their statistics (`cusick_bench.problem.statistics`) are fitted by a
polynomial in the numbers `leading.LEADING`, to which a specimen's own level of stiffness is added. It is of second
degree, of third degree in products with the bending level, and of fifth degree in the bending level alone; all other
properties of a cloth, each entry of its tables, enter linearly. The scatter of specimens of the same level is estimated
from pairs of specimens of one cloth, so that errors of the polynomial are not part of it. It has a constant
correlation, and standard deviations whose logarithm is linear in the same numbers (and quadratic in the bending level):
limp cloth varies less than stiff cloth. Differences in level between specimens are added along the slope. Beyond the
range of the cloths that were draped, the values at its edge are used.

References:
    Kennedy, O'Hagan. Bayesian calibration of computer models. JRSS B 63(3), 2001. Davidian, Carroll. Variance function
    estimation. JASA 82, 1987 (the scatter).
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.files import read_npz
from cusick_bench.problem.cloth_prior import CLOTH
from cusick_bench.problem.leading import ALONG_LEVEL, LEADING, Leading, Levels

SHIPPED = Path(__file__).parent / "expected_statistics.npz"
"""Made by `cusick-bench population --law plate --out FOLDER`."""
_LOG_CHI2 = 1.27  # -E log z^2 of a standard normal z
_PASSES = 3  # alternating fits of regression and scatter
_STEP = 0.3  # step of the level for its slope [log]
_FAR = 4.0  # [standard deviations] differences of pairs are cut here, as one may have fallen into another equilibrium
_LEAST_SHARE = 1e-3  # least squared residual over the variance, so that its logarithm is finite


@dataclass(frozen=True, eq=False)
class ExpectedStatistics:
    """Expected statistics of cloths, and the scatter of their specimens.

    Attributes:
        low, high: Range of the leading directions of the cloths that were draped.
        mean: Coefficients of the expectation.
        rest: Derivatives by properties that change none of the leading directions.
        log_sd: Coefficients of the logarithm of the standard deviations.
        correlation: Correlation matrix of the statistics between specimens of one cloth and level.
    """

    low: Float[ndarray, " leading"]
    high: Float[ndarray, " leading"]
    mean: Float[ndarray, "terms statistics"]
    rest: Float[ndarray, "numbers statistics"]
    log_sd: Float[ndarray, "few statistics"]
    correlation: Float[ndarray, "statistics statistics"]

    def __call__(self, leading: Float[ndarray, "cloths leading"]) -> Float[ndarray, "cloths statistics"]:
        """Expected statistics of cloths with these leading directions and median values of all else, one a row."""
        return _terms(self._place(leading)) @ self.mean

    def of(
        self, leading: Leading, cloths: Float[ndarray, "cloths numbers"], levels: Levels = 0.0
    ) -> Float[ndarray, "cloths statistics"]:
        """Expected statistics of cloths with tables of their own.

        Args:
            leading: Gives their leading directions.
            cloths: theta, one a row.
            levels: Levels of specimens of them; 0 for the cloths.

        Returns:
            One row a cloth.
        """
        return self(leading(cloths, levels)) + leading.rest(cloths) @ self.rest

    def slope(self, leading: Float[ndarray, "cloths leading"]) -> Float[ndarray, "cloths statistics"]:
        """Derivative of the expected statistics by the level of specimens.

        Args:
            leading: Leading directions of their cloths, one a row.

        Returns:
            One row a cloth.
        """
        step = _STEP * ALONG_LEVEL
        return (self(leading + step) - self(leading - step)) / (2 * _STEP)

    def scatter(self, leading: Float[ndarray, "cloths leading"]) -> Float[ndarray, "cloths statistics statistics"]:
        """Covariance of the statistics of specimens of one level.

        Args:
            leading: Leading directions of their cloths, one a row.

        Returns:
            One matrix a cloth.
        """
        sd = np.exp(_few(self._place(leading)) @ self.log_sd)
        return self.correlation * sd[:, :, None] * sd[:, None, :]

    def npz(self) -> bytes:
        """Content of an .npz file."""
        content = BytesIO()
        np.savez_compressed(content, **{name: getattr(self, name) for name in self.__dataclass_fields__})
        return content.getvalue()

    def _place(self, leading: Float[ndarray, "cloths leading"]) -> Float[ndarray, "cloths leading"]:
        return _place(leading, self.low, self.high)


@lru_cache(maxsize=1)
def shipped() -> ExpectedStatistics:
    """The shipped statistics, of law `plate`; they are a good guess for other laws as well."""
    return ExpectedStatistics(**read_npz(SHIPPED, remedy="install cusick-bench again"))


def least_cloths() -> int:
    """How many cloths the regression needs at least: one and a half times its coefficients."""
    return 3 * (_terms(np.zeros((1, len(LEADING)))).shape[1] + CLOTH) // 2


def learn(
    leading: Leading,
    cloths: Float[ndarray, "cloths numbers"],
    levels: Float[ndarray, " cloths"],
    statistics: Float[ndarray, "cloths statistics"],
    pairs: Int[ndarray, "pairs 2"],
) -> ExpectedStatistics:
    """Regresses statistics of specimens.

    Args:
        leading: Gives their leading directions.
        cloths: theta of the cloths; `least_cloths` or more.
        levels: Levels of the specimens.
        statistics: Statistics of the specimens.
        pairs: Rows of which two are specimens of one cloth.

    Returns:
        Expectation and scatter.
    """
    directions = leading(cloths, levels)
    low, high = directions.min(0), directions.max(0)
    place = _place(directions, low, high)
    terms, few = np.hstack([_terms(place), leading.rest(cloths)]), _few(place)
    of_pairs = few[pairs].mean(1)
    sd = np.ones_like(statistics)
    mean = log_sd = standardised = statistics
    for _ in range(_PASSES):
        columns = [_solved(terms / one[:, None], column / one) for one, column in zip(sd.T, statistics.T, strict=True)]
        mean = np.stack(columns, 1)
        first, second = np.moveaxis((statistics - terms @ mean)[pairs], 1, 0)
        apart = (first - second) / math.sqrt(2)
        floor = _LEAST_SHARE * (apart**2).mean(0)
        log_sd = _solved(of_pairs, 0.5 * (np.log(apart**2 + floor) + _LOG_CHI2))
        standardised = np.clip(apart / np.exp(of_pairs @ log_sd), -_FAR, _FAR)
        log_sd[0] += np.log(standardised.std(0))
        sd = np.exp(few @ log_sd)
    own = terms.shape[1] - cloths.shape[1]
    return ExpectedStatistics(low, high, mean[:own], mean[own:], log_sd, np.corrcoef(standardised.T))


def _place(leading: ndarray, low: ndarray, high: ndarray) -> Float[ndarray, "cloths leading"]:
    """Within -1 to 1."""
    return 2 * (np.clip(leading, low, high) - low) / (high - low) - 1


def _solved(design: ndarray, response: ndarray) -> ndarray:
    return np.linalg.lstsq(design, response, rcond=None)[0]


def _few(place: Float[ndarray, "cloths leading"]) -> Float[ndarray, "cloths few"]:
    level = place[:, :1]
    return np.hstack([np.ones_like(level), place, level**2])


def _terms(place: Float[ndarray, "cloths leading"]) -> Float[ndarray, "cloths terms"]:
    level = place[:, :1]
    first, second = np.triu_indices(place.shape[1])
    products = place[:, first] * place[:, second]
    return np.hstack([np.ones_like(level), place, products, level * products, level**4, level**5])
