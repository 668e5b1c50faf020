"""Smooth Gaussian fields of stiffness over the cloth, in white coordinates: deviation = P (shared z_0 + amplitude S z).

Every one of the 39 table entries deviates by a number z_0 that all elements share, and by its own field with Matern
covariance (nu = 1), the solution of (kappa^2 - Laplace) w = white noise, discretised with linear finite elements on
the flat mesh,

    (kappa^2 M + K) w = sqrt(4 pi) kappa M^(1/2) z,    z ~ N(0, I),    kappa = sqrt(8) / length,

M the lumped mass, K the stiffness matrix. Then w has variance 1 inside the cloth (up to twice that at its rim, where
the noise is reflected) and correlation 0.14 at the distance `length`. P takes the mean of the corners on faces, and of
the ends on hinges. One sparse factor serves all fields. A gradient step in z is a smoothed step in tau.

References:
    Lindgren, Rue, Lindstroem, An explicit link between Gaussian fields and Gaussian Markov random fields: the
    stochastic partial differential equation approach, J. Royal Statistical Society B 73(4), 2011.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float
from scipy.sparse.linalg import splu

from cusick_bench.problem.priors import BENDING_SIZE, STRETCH_SIZE
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.solvers.base import SolverError

FIELDS = STRETCH_SIZE + BENDING_SIZE


def stiffness_matrix(mesh: Mesh) -> sparse.csc_matrix:
    """Linear finite elements' Dirichlet form on the flat cloth, (V, V) [1].

    Args:
        mesh: The flat cloth.

    Returns:
        Sparse symmetric matrix.
    """
    corner = mesh.material[mesh.faces]
    opposite = np.roll(corner, -2, axis=1) - np.roll(corner, -1, axis=1)  # edge that faces each corner
    blocks = np.einsum("fac,fbc->fab", opposite, opposite) / (4 * mesh.areas[:, None, None])
    rows, columns = np.repeat(mesh.faces, 3, axis=1).ravel(), np.tile(mesh.faces, 3).ravel()
    return sparse.csc_matrix((blocks.ravel(), (rows, columns)), shape=(mesh.vertices, mesh.vertices))


def _means(corners: np.ndarray, vertices: int) -> sparse.csr_matrix:
    """Takes a vertex field to the mean over each element's corners."""
    count, each = corners.shape
    rows = np.repeat(np.arange(count), each)
    return sparse.csr_matrix((np.full(corners.size, 1 / each), (rows, corners.ravel())), shape=(count, vertices))


@dataclass(frozen=True, eq=False)
class StiffnessField:
    """Deviations of the heterogeneous space's vector from that of a homogeneous cloth.

    Attributes:
        mesh: The cloth.
        amplitude: Standard deviation of each entry of tau over the cloth [prior standard deviations].
        length: Distance at which the correlation is 0.14 [m].
        shared: Standard deviation of what all elements have in common [prior standard deviations].

    Raises:
        SolverError: Amplitude, length or what is shared is not positive.
    """

    mesh: Mesh
    amplitude: float
    length: float
    shared: float = 1.0

    def __post_init__(self) -> None:
        for name in ("amplitude", "length", "shared"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise SolverError(f"a stiffness field's {name} must be > 0 and finite, got {value}")

    @property
    def dimension(self) -> int:
        """Length of z: for each table entry one shared number, and one number for each vertex."""
        return FIELDS * (1 + self.mesh.vertices)

    @cached_property
    def _on_faces(self) -> sparse.csr_matrix:
        return _means(self.mesh.faces, self.mesh.vertices)

    @cached_property
    def _on_hinges(self) -> sparse.csr_matrix:
        return _means(self.mesh.hinges[:, :2], self.mesh.vertices)

    @cached_property
    def _kappa(self) -> float:
        return math.sqrt(8.0) / self.length

    @cached_property
    def _factor(self) -> Any:
        precision = self._kappa**2 * sparse.diags(self.mesh.vertex_areas) + stiffness_matrix(self.mesh)
        return splu(sparse.csc_matrix(precision))

    @cached_property
    def _noise(self) -> Float[np.ndarray, "vertices 1"]:
        root_mass = np.sqrt(self.mesh.vertex_areas)
        return (self.amplitude * math.sqrt(4 * math.pi) * self._kappa * root_mass)[:, None]

    def deviation(self, z: Float[np.ndarray, " dimension"]) -> Float[np.ndarray, " parameters"]:
        """The change of tau at white coordinates z, a linear function.

        Args:
            z: White coordinates.

        Returns:
            Change of tau.
        """
        common, white = np.split(z.reshape(-1, FIELDS), [1])
        fields = self.shared * common + self._factor.solve(self._noise * white)
        stretch, bending = fields[:, :STRETCH_SIZE], fields[:, STRETCH_SIZE:]
        return np.concatenate([(self._on_faces @ stretch).ravel(), (self._on_hinges @ bending).ravel()])

    def pulled_back(self, gradient: Float[np.ndarray, " parameters"]) -> Float[np.ndarray, " dimension"]:
        """Gradient to z from a gradient to tau: the transpose of `deviation`.

        Args:
            gradient: Derivatives by tau.

        Returns:
            Derivatives by z.
        """
        cut = STRETCH_SIZE * len(self.mesh.faces)
        stretch = self._on_faces.T @ gradient[:cut].reshape(-1, STRETCH_SIZE)
        bending = self._on_hinges.T @ gradient[cut:].reshape(-1, BENDING_SIZE)
        corners = np.concatenate([stretch, bending], axis=1)
        common = self.shared * corners.sum(0, keepdims=True)
        return np.concatenate([common, self._noise * self._factor.solve(corners)]).ravel()
