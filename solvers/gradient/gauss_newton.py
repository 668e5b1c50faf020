"""Gauss-Newton steps whose Jacobian is known by its adjoint products alone, for residuals that leap.

Minimised is J(z) = weight |r(z)|^2 + |z|^2 / 2. An evaluation gives r_i and one product h_i = A^T r_i with the Jacobian
A of r, no more. Taken as observations of one unknown A with independent Gaussian entries, wrong by about r_i, the
latest pairs R = (r_1 ...), H = (h_1 ...) say

    A^T A  ~  H K^-1 H^T,    K = R^T R + NOISE diag(R^T R),

and a step minimises the quadratic model with this curvature within a ball (Levenberg, Marquardt). No gradients are
subtracted from each other. So where the residual leaps from one evaluation to the next, as it does where folds come
and go, nothing false is learnt of the curvature, which would undo quasi-Newton methods.

References:
    Schlenkrich, Griewank, Walther, On the local convergence of adjoint Broyden methods, Math. Programming 121, 2010.
    Nocedal, Wright, Numerical Optimization, 2nd edition, 2006, Sections 4.1 (ball) and 10.3 (Levenberg-Marquardt).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

MEMORY = 20  # pairs
NOISE = 0.05  # squared relative error of the products, since the Jacobian is another one at every point
_SLACK = 1e-6  # of a step's length, for rounding
BISECTIONS = 40  # of the damping: to 1e-12 of its range

Vector = Float[np.ndarray, " unknowns"]


@dataclass(frozen=True)
class Adjoints:
    """Information on the Jacobian from evaluations.

    Attributes:
        residuals: Latest r_i, oldest first.
        products: h_i = A^T r_i.
    """

    residuals: Float[np.ndarray, "pairs outputs"]
    products: Float[np.ndarray, "pairs unknowns"]

    @classmethod
    def of(cls, residual: Float[np.ndarray, " outputs"], product: Vector) -> "Adjoints":
        """A first pair.

        Args:
            residual: Residual r at a point.
            product: (dr/dz)^T r there.

        Returns:
            A memory of one pair.
        """
        return cls(residual[None], product[None])

    def and_of(self, residual: Float[np.ndarray, " outputs"], product: Vector) -> "Adjoints":
        """A pair richer; the oldest one is forgotten where there are too many.

        Args:
            residual: Residual r at another point.
            product: (dr/dz)^T r there.

        Returns:
            A memory with that pair.
        """
        return Adjoints(
            np.concatenate([self.residuals, residual[None]])[-MEMORY:],
            np.concatenate([self.products, product[None]])[-MEMORY:],
        )


def damped_step(gradient: Vector, adjoints: Adjoints, *, weight: float, radius: float) -> Vector:
    """The step to the lowest point of the quadratic model within a ball.

    Args:
        gradient: Gradient of J at the present point: 2 weight A^T r + z.
        adjoints: What is known of the Jacobian.
        weight: Weight of the squared residual in J.
        radius: Radius of the ball.

    Returns:
        The step, not longer than the radius.
    """
    # ((1 + damping) I + 2 weight H K^-1 H^T) step = -gradient, by the Woodbury identity in as many unknowns as pairs.
    products = adjoints.products
    gram = adjoints.residuals @ adjoints.residuals.T
    noisy = gram + np.diag(NOISE * np.diag(gram) + np.finfo(float).tiny)
    with np.errstate(over="ignore"):
        square, inner, along = float(gradient @ gradient), products @ products.T, products @ gradient
    if not (np.isfinite(square) and np.isfinite(inner).all() and np.isfinite(along).all()):
        return _steepest(gradient, radius)

    def shares(damping: float) -> tuple[np.ndarray, float]:
        """Weights of the pairs in the step, and how long it is."""
        share = np.linalg.lstsq(noisy * ((1 + damping) / (2 * weight)) + inner, along, rcond=None)[0]
        length = np.sqrt(max(square - 2 * share @ along + share @ inner @ share, 0.0))
        return share, float(length) / (1 + damping)

    damping, (share, length) = 0.0, shares(0.0)
    if length > radius:
        low, high = 0.0, np.sqrt(square) / radius  # at the upper end it is a short step along the gradient
        for _ in range(BISECTIONS):
            damping = (low + high) / 2
            low, high = (damping, high) if shares(damping)[1] > radius else (low, damping)
        damping, share = high, shares(high)[0]
    step = (share @ products - gradient) / (1 + damping)
    sound = np.linalg.norm(step) <= (1 + _SLACK) * radius and step @ gradient < 0
    return step if sound else _steepest(gradient, radius)  # an adjoint of 1e17 has left no digits of the rest


def _steepest(gradient: Vector, radius: float) -> Vector:
    """The longest step down the gradient, however large that is."""
    direction = gradient / max(float(np.abs(gradient).max()), np.finfo(float).tiny)
    return -radius * direction / max(float(np.linalg.norm(direction)), 1.0)
