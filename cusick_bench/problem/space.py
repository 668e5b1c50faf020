"""What a solver's numbers mean: a parameter space turns an unconstrained vector tau into a cloth to drape.

A new space is one file with one subclass of `ParameterSpace` and one line in `spaces.py`.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.problem.priors import BENDING_SIZE, STRETCH_SIZE, StiffnessPrior
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.errors import SimulationError

BOUND = 3.0  # box for solvers that need one, in units of prior standard deviations


@dataclass(frozen=True)
class Specimen:
    """A cloth as it is put on the plate.

    Attributes:
        material: Stiffness tables and areal density.
        initial: How it is laid down, None for the problem's own way.
        rest_angle: Dihedral rest angles of the hinges [rad], None for a flat cloth.
    """

    material: Material
    initial: Float[Tensor, "vertices 3"] | None = None
    rest_angle: Float[Tensor, " hinges"] | None = None


@dataclass(frozen=True)
class ParameterSpace(ABC):
    """Unconstrained vectors tau with prior N(0, I), and the specimens they stand for.

    Attributes:
        mesh: The cloth's mesh.
        prior: Median and scale of the stiffness tables.
        plate_radius: Radius of the plate that the cloth lies on [m].
        cloth_radius: Nominal radius of the cloth [m].
        name: Name of the space.
        version: Raised by 1 whenever another specimen stands for a vector; results of before are computed again.
        lays_down: Whether its vectors say how a specimen is laid down, so that the problem's own way is not used.
    """

    mesh: Mesh
    prior: StiffnessPrior
    plate_radius: float = RELEASE.plate_radius_m
    cloth_radius: float = RELEASE.cloth_radius_m
    name: ClassVar[str]
    version: ClassVar[int] = 1
    differentiable: ClassVar[bool] = True
    lays_down: ClassVar[bool] = False

    @property
    @abstractmethod
    def dimension(self) -> int:
        """Length of tau."""

    @abstractmethod
    def specimen(self, tau: Float[Tensor, " dimension"]) -> Specimen:
        """The cloth that tau stands for; differentiable with respect to tau.

        Args:
            tau: Parameter vector in the unconstrained, scaled space.

        Returns:
            Its material and fields.
        """

    def no_specimen(self, tau: Float[Tensor, " dimension"]) -> str:
        """Why tau stands for no cloth, as far from the prior's middle, where numbers overflow.

        Args:
            tau: Parameter vector.

        Returns:
            What is wrong; empty where it stands for a cloth.
        """
        try:
            found = self.specimen(tau)
        except SimulationError as error:
            return str(error)
        shapes = [shape for shape in (found.initial, found.rest_angle) if shape is not None]
        if all(torch.isfinite(shape).all() for shape in shapes):
            return ""
        return "its shape as laid down or at rest is not finite"

    @abstractmethod
    def bending_level(self, factor: float) -> Float[np.ndarray, " dimension"]:
        """The prior median with all bending stiffnesses multiplied by one factor.

        Args:
            factor: The factor, > 0.

        Returns:
            The parameter vector.
        """

    @property
    def specimen_level(self) -> slice:
        """Entries of tau that belong to one specimen and not to its cloth: another specimen has them drawn anew."""
        return slice(0, 0)

    @property
    def bounds(self) -> tuple[Float[np.ndarray, " dimension"], Float[np.ndarray, " dimension"]]:
        """Box for solvers that need one, lower and upper [prior standard deviations]."""
        return np.full(self.dimension, -BOUND), np.full(self.dimension, BOUND)

    def sample_prior(self, generator: np.random.Generator) -> Float[np.ndarray, " dimension"]:
        """Draws a parameter vector from the prior.

        Args:
            generator: Source of randomness.

        Returns:
            The parameter vector.
        """
        return generator.standard_normal(self.dimension)

    def density(self) -> Float[Tensor, ""]:
        """Areal density [kg/m2]."""
        return torch.tensor(self.prior.density, dtype=torch.float64)


@dataclass(frozen=True)
class HomogeneousSpace(ParameterSpace):
    """One stretch and one bending table for the whole cloth: 39 numbers."""

    name: ClassVar[str] = "homo"

    @property
    def dimension(self) -> int:
        return STRETCH_SIZE + BENDING_SIZE

    def specimen(self, tau: Float[Tensor, " dimension"]) -> Specimen:
        """The cloth with one stretch and one bending table; see `ParameterSpace.specimen`."""
        stretch, bending = tau.split([STRETCH_SIZE, BENDING_SIZE])
        return Specimen(Material(self.prior.stretch(stretch), self.prior.bending(bending), self.density()))

    def bending_level(self, factor: float) -> Float[np.ndarray, " dimension"]:
        """See `ParameterSpace.bending_level`."""
        return np.concatenate([np.zeros(STRETCH_SIZE), self.prior.bending_level(factor)])


@dataclass(frozen=True)
class HeterogeneousSpace(ParameterSpace):
    """One stretch table a face and one bending table a hinge: 241,680 numbers on 2699 vertices."""

    name: ClassVar[str] = "heter"

    @property
    def dimension(self) -> int:
        return STRETCH_SIZE * len(self.mesh.faces) + BENDING_SIZE * len(self.mesh.hinges)

    def specimen(self, tau: Float[Tensor, " dimension"]) -> Specimen:
        """The cloth with one stretch table a face and one bending table a hinge; see `ParameterSpace.specimen`."""
        stretch, bending = tau.split([STRETCH_SIZE * len(self.mesh.faces), BENDING_SIZE * len(self.mesh.hinges)])
        return Specimen(
            Material(
                self.prior.stretch(stretch.unflatten(0, (-1, STRETCH_SIZE))),
                self.prior.bending(bending.unflatten(0, (-1, BENDING_SIZE))),
                self.density(),
            )
        )

    def bending_level(self, factor: float) -> Float[np.ndarray, " dimension"]:
        """See `ParameterSpace.bending_level`."""
        bending = np.tile(self.prior.bending_level(factor), len(self.mesh.hinges))
        return np.concatenate([np.zeros(STRETCH_SIZE * len(self.mesh.faces)), bending])
