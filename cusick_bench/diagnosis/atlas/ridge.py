"""Ridge regression of several quantities on the same terms, each with a strength of its own; sums of such fits.

References:
    Golub, Heath, Wahba. Generalized cross-validation as a method for choosing a good ridge parameter.
    Technometrics 21(2), 1979.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

_STRENGTHS = np.geomspace(1e-3, 1e3, 13)


@dataclass(frozen=True, eq=False)
class Fit:
    """Ridge regressions of several quantities on the same terms.

    Attributes:
        weights: One column a quantity.
        covariance: Covariance of the weights, for unit residual variance of each quantity: (quantities, terms, terms)
            would be large, so the average ridge's is kept.
        residual: Residual variance of each quantity.
    """

    weights: Float[ndarray, "terms quantities"]
    covariance: Float[ndarray, "terms terms"]
    residual: Float[ndarray, "quantities"]

    def __call__(self, terms: Float[ndarray, "rows terms"]) -> Float[ndarray, "rows quantities"]:
        return terms @ self.weights

    def variance(self, terms: Float[ndarray, "rows terms"]) -> Float[ndarray, "rows quantities"]:
        """Variance of the predictions, from the finite number of points.

        Args:
            terms: Terms of the regression, one a column.

        Returns:
            Variances.
        """
        return np.einsum("ri,ij,rj->r", terms, self.covariance, terms)[:, None] * self.residual


@dataclass(frozen=True, eq=False)
class SummedFit:
    """A fit and corrections to it, each on some of the same terms.

    Attributes:
        fits: The fits.
        columns: Terms of each.
    """

    fits: tuple[Fit, ...]
    columns: tuple[Int[ndarray, " chosen"], ...]

    def __call__(self, terms: Float[ndarray, "rows terms"]) -> Float[ndarray, "rows quantities"]:
        return np.sum([fit(terms[:, own]) for fit, own in zip(self.fits, self.columns, strict=True)], axis=0)

    def variance(self, terms: Float[ndarray, "rows terms"]) -> Float[ndarray, "rows quantities"]:
        """Variance of the predictions, from the finite number of points.

        Args:
            terms: Terms of the regression, one a column.

        Returns:
            Variances.
        """
        pairs = zip(self.fits, self.columns, strict=True)
        return np.sum([fit.variance(terms[:, own]) for fit, own in pairs], axis=0)


def ridge(
    terms: Float[ndarray, "rows terms"],
    values: Float[ndarray, "rows quantities"],
    free: int,
    precision: Float[ndarray, "rows"] | None = None,
) -> Fit:
    """Ridge regression, its strength by generalised cross-validation for each quantity.

    Args:
        terms: Terms of the regression, one a column.
        values: What to predict.
        free: Number of leading terms that are not shrunk.
        precision: Inverse variance of every row, up to a common factor; equal by default.

    Returns:
        The regressions.
    """
    if precision is not None:
        root = np.sqrt(precision)[:, None]
        terms, values = terms * root, values * root
    scale = np.sqrt((terms**2).mean(0)) + 1e-12
    penalty = np.ones(terms.shape[1])
    penalty[:free] = 1e-6
    x = terms / scale
    gram, moment = x.T @ x, x.T @ values
    best = np.full(values.shape[1], np.inf)
    weights, residual, chosen = np.zeros_like(moment), np.zeros(values.shape[1]), np.zeros(values.shape[1])
    for strength in _STRENGTHS:
        inverse = np.linalg.inv(gram + strength * np.diag(penalty))
        freedom = np.trace(inverse @ gram)
        trial = inverse @ moment
        squares = ((values - x @ trial) ** 2).sum(0)
        score = squares / (len(x) - min(freedom, 0.9 * len(x))) ** 2
        better = score < best
        best[better], weights[:, better], chosen[better] = score[better], trial[:, better], strength
        residual[better] = squares[better] / (len(x) - min(freedom, 0.9 * len(x)))
    typical = float(np.exp(np.log(chosen).mean()))
    covariance = np.linalg.inv(gram + typical * np.diag(penalty)) / np.outer(scale, scale)
    return Fit(weights / scale[:, None], covariance, residual)
