"""Prior of a cloth's stiffness tables: where a fit starts, and in which units its steps are taken.

A table entry is exp(median + deviation), and the deviations of one table are jointly Gaussian. Optimisers see
the whitened vector tau = Sigma^(-1/2) deviation (symmetric root, so that a component of tau still belongs to
its entry): tau = 0 is the median cloth of a given weight and tau ~ N(0, I) is the prior.

Bending. Median and covariance come from a regression of log stiffness on log areal density over 618 measured
fabrics (`tests/problem/test_problem_spaces.py` repeats it on the published table), because a heavier cloth is a
stiffer one: density alone takes the standard deviation of log B from 1.3 to 0.8. Stretch. Membrane strains of a drape
are tiny and silhouettes say next to nothing about them, so the median is the published program's table with a wide,
assumed spread.

References:
    Feng, Huang, Xu, Wang, Learning-Based Bending Stiffness Parameter Estimation by a Drape Tester, ACM TOG
    41(6), 2022. Wang, O'Brien, Ramamoorthi, Data-Driven Elastic Models for Cloth, ACM TOG 30(4), 2011 (the
    two tables).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.problem.errors import ProblemError
from cusick_bench.sim.cloth.material import PUBLISHED_BENDING_FACTOR

# Regression of log B [N m] on log(areal density / 0.15 kg/m2), fabrics618.csv, in the order of the table's
# rows: hinges along the warp bend the weft (row 0), hinges at 45 degrees the bias, hinges along the weft bend
# the warp (row 2).
DENSITY_REFERENCE = 0.15  # [kg/m2]
BENDING_INTERCEPT = np.array([-11.8110, -11.6396, -11.4192])
BENDING_SLOPE = np.array([1.1110, 1.2143, 1.2494])
BENDING_RESIDUAL_COVARIANCE = np.array([[0.7604, 0.5232, 0.6002], [0.5232, 0.7080, 0.6478], [0.6002, 0.6478, 0.9621]])
# Spread among the five curvature samples of a row. Assumed: the same fabrics soften by about a tenth at 40
# /m.
BENDING_CURVATURE_SD = 0.2

# Stretch table of the published program [N/m]: six strain samples of c11, c12, c22, c33.
STRETCH_REFERENCE = np.array(
    [
        [150.0862, 0.3456, 150.4856, 10.189],
        [189.2275, 2.3716, 200.7334, 20.905],
        [51.2988, 4.9362, 60.3071, 25.393],
        [36.7329, 6.3891, 32.7261, 30.462],
        [58.9375, 5.1495, 49.8735, 25.055],
        [207.3079, 2.2163, 193.4768, 20.669],
    ]
)
STRETCH_LEVEL_SD = 0.5  # of log stiffness, shared by the whole table; assumed
STRETCH_ENTRY_SD = 0.3  # of log stiffness, each entry alone; assumed
COUPLING_SD = 0.5  # of atanh(c12 / sqrt(c11 c22)); assumed

# The published bending law acts as a plate of a quarter of its table value; the others take the physical value.
BENDING_TABLE_FACTOR = {"plate": 1.0, "paper": 1.0, "published": PUBLISHED_BENDING_FACTOR}

STRETCH_SIZE, BENDING_SIZE = 24, 15


def _symmetric_root(covariance: np.ndarray) -> np.ndarray:
    values, vectors = np.linalg.eigh(covariance)
    return (vectors * np.sqrt(values)) @ vectors.T


@dataclass(frozen=True)
class StiffnessPrior:
    """Maps whitened vectors to admissible stiffness tables, for one law and one areal density.

    Attributes:
        law: Material law the tables are meant for, "plate", "paper" or "published".
        areal_density: Mass per area of the cloth [kg/m2].
    """

    law: str
    areal_density: float

    def __post_init__(self) -> None:
        if self.law not in BENDING_TABLE_FACTOR:
            raise ProblemError(f"unknown material law {self.law!r}; use one of {sorted(BENDING_TABLE_FACTOR)}")

    @property
    def density(self) -> float:
        """Areal density [kg/m2], checked on first use: predictors without physics do without it.

        Raises:
            ProblemError: It is missing or not positive.
        """
        if not (np.isfinite(self.areal_density) and self.areal_density > 0):
            raise ProblemError(
                f"areal density must be > 0 kg/m2, got {self.areal_density}; add a row for this cloth to "
                "fabrics.csv (fabric,areal_density_kg_m2,thickness_m)"
            )
        return self.areal_density

    @cached_property
    def bending_median(self) -> np.ndarray:
        """Median of log bending stiffness, shape (3, 5) [log N m]."""
        rows = BENDING_INTERCEPT + BENDING_SLOPE * np.log(self.density / DENSITY_REFERENCE)
        return np.repeat(rows[:, None], 5, axis=1) + np.log(BENDING_TABLE_FACTOR[self.law])

    @cached_property
    def bending_root(self) -> np.ndarray:
        """Symmetric root of the covariance of the 15 log bending stiffnesses, shape (15, 15)."""
        covariance = np.kron(BENDING_RESIDUAL_COVARIANCE, np.ones((5, 5)))
        return _symmetric_root(covariance + BENDING_CURVATURE_SD**2 * np.eye(BENDING_SIZE))

    @cached_property
    def stretch_root(self) -> np.ndarray:
        """Symmetric root of the covariance of the 18 log diagonal stretch stiffnesses, shape (18, 18)."""
        return _symmetric_root(STRETCH_LEVEL_SD**2 * np.ones((18, 18)) + STRETCH_ENTRY_SD**2 * np.eye(18))

    def stretch(self, tau: Float[Tensor, "*batch 24"]) -> Float[Tensor, "*batch 6 4"]:
        """Stretch tables, positive definite whatever tau: c12 = tanh(.) sqrt(c11 c22).

        Args:
            tau: Whitened vectors.

        Returns:
            Tables [N/m].
        """
        tau = tau.unflatten(-1, (6, 4))
        diagonal = tau[..., [0, 2, 3]].flatten(-2) @ torch.as_tensor(self.stretch_root)
        median = torch.as_tensor(np.log(STRETCH_REFERENCE[:, [0, 2, 3]]))
        c11, c22, c33 = (median + diagonal.unflatten(-1, (6, 3))).exp().unbind(-1)
        coupling = torch.tanh(torch.as_tensor(_coupling(STRETCH_REFERENCE)) + COUPLING_SD * tau[..., 1])
        return torch.stack([c11, coupling * (c11 * c22).sqrt(), c22, c33], -1)

    def bending(self, tau: Float[Tensor, "*batch 15"]) -> Float[Tensor, "*batch 3 5"]:
        """Bending tables, positive whatever tau.

        Args:
            tau: Whitened vectors.

        Returns:
            Tables [N m].
        """
        deviation = tau @ torch.as_tensor(self.bending_root)
        return (torch.as_tensor(self.bending_median) + deviation.unflatten(-1, (3, 5))).exp()

    def stretch_tau(self, stretch: Float[np.ndarray, "6 4"]) -> Float[np.ndarray, "24"]:
        """The whitened vector of an admissible stretch table: inverse of `stretch`.

        Args:
            stretch: The table [N/m].

        Returns:
            The whitened vector.
        """
        tau = np.empty((6, 4))
        deviation = np.log(stretch[:, [0, 2, 3]] / STRETCH_REFERENCE[:, [0, 2, 3]])
        tau[:, [0, 2, 3]] = np.linalg.solve(self.stretch_root, deviation.ravel()).reshape(6, 3)
        tau[:, 1] = (_coupling(stretch) - _coupling(STRETCH_REFERENCE)) / COUPLING_SD
        return tau.ravel()

    def bending_tau(self, bending: Float[np.ndarray, "3 5"]) -> Float[np.ndarray, "15"]:
        """The whitened vector of a bending table: inverse of `bending`.

        Args:
            bending: The table [N m].

        Returns:
            The whitened vector.
        """
        return np.linalg.solve(self.bending_root, (np.log(bending) - self.bending_median).ravel())

    def bending_level(self, factor: float) -> Float[np.ndarray, "15"]:
        """The whitened vector of the median bending table times a factor.

        Args:
            factor: The factor, > 0.

        Returns:
            The whitened vector.
        """
        return np.linalg.solve(self.bending_root, np.full(BENDING_SIZE, np.log(factor)))

    @property
    def bending_level_sd(self) -> float:
        """Standard deviation of log stiffness that all bending stiffnesses have in common."""
        return 1 / float(np.linalg.norm(self.bending_level(np.e)))


def _coupling(stretch: Float[np.ndarray, "6 4"]) -> Float[np.ndarray, "6"]:
    c11, c12, c22, _ = stretch.T
    return np.arctanh(c12 / np.sqrt(c11 * c22))
