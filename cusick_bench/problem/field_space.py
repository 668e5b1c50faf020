"""Smooth random fields around a homogeneous cloth: of stiffness, of the shape it is laid down in, of its rest shape.

Draws of stiffness that are independent from element to element average out over a fold and cannot move it; undulations
of a millimetre in the shape in which the cloth is laid down, or in its rest shape, can. So tau holds, all with prior
N(0, 1):

    the 39 numbers of the homogeneous space,
    traits in which cloths differ further: the levels of bending and of stretch stiffness (those numbers, independent of
    one another, hardly let all rise together), how bending stiffness rises with curvature, and how stiff the bias is,
    logarithms of amplitude and correlation length of every field, around the medians below,
    weights w of every field's modes (see `cusick_bench.sim.cloth.matern`).

The first three belong to the cloth, the weights to the specimen: another one of the same cloth has them drawn anew.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.problem.priors import BENDING_SIZE, STRETCH_SIZE
from cusick_bench.problem.space import ParameterSpace, Specimen
from cusick_bench.sim.cloth.heterogeneity import face_centres, hinge_centres
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.matern import EXTENSION, DiscModes, disc_modes, matern_root
from cusick_bench.sim.cloth.shape import dihedral_angles, fade_in

MODES = 300  # of each field: waves of 3.5 cm and longer
HOMOGENEOUS = STRETCH_SIZE + BENDING_SIZE
_CURVATURES = torch.arange(-2.0, 3.0, dtype=torch.float64)  # samples 0 to 40 /m, from the middle one [10 /m]
_BIAS_ROW = torch.tensor([[0.0], [1.0], [0.0]], dtype=torch.float64)  # of the bending table


@dataclass(frozen=True)
class FieldPrior:
    """Log-normal prior of one field's amplitude and correlation length.

    Attributes:
        amplitude: Median, in the field's unit.
        length: Median [m].
        amplitude_sd: Standard deviation of the logarithm of the amplitude.
        length_sd: Standard deviation of the log of the correlation length.
        level: Standard deviation between specimens of what is uniform over the cloth, in the field's unit.
    """

    amplitude: float
    length: float
    amplitude_sd: float = 0.5
    length_sd: float = 0.3
    level: float = 0.0


@dataclass(frozen=True)
class Trait:
    """Normal prior of something in which cloths differ.

    Attributes:
        mean: Mean over all cloths.
        sd: Standard deviation between cloths.
    """

    mean: float
    sd: float


# What `cusick_bench.problem.population` finds at 700 vertices in fabrics of the release that no table predicts. They
# are of the mesh as well: a coarse mesh of triangles cannot bend without stretch, which the level of stretch takes on.
TRAITS = {
    "bending": Trait(0.0, 1.55),  # [log] level of all bending stiffnesses, beside the prior of the homogeneous space
    "stretch": Trait(0.3, 1.05),  # [log] of all stretch stiffnesses, beside that prior
    "hardening": Trait(0.5, 0.2),  # [log] rise of bending stiffness from one curvature sample to the next, 10 /m on
    "bias": Trait(0.6, 0.7),  # [log] bending stiffness at 45 degrees, beside that prior
}

# From there too: the correlation length of the laid shape, which decides on the number of folds (three of the eight
# fabrics and faces lie at the lower end of its box, below which all waves that the modes hold are equally strong), and
# the level of stiffness of a sample. The others are assumed, wide: undulations of 1 mm in the laid shape and of a third
# of that in the rest shape, stiffness uneven by 15 %, so that simulated samples of one cloth vary as real ones do.
FIELDS = {
    "stiffness": FieldPrior(0.15, 0.02, level=0.14),  # [log]
    "laying": FieldPrior(1.0e-3, 0.014, length_sd=0.65),  # [m]
    "rest": FieldPrior(0.3e-3, 0.03),  # [m]
}
CLOTH = HOMOGENEOUS + len(TRAITS) + 2 * len(FIELDS)

# From there again: by how much a fabric's mean statistics (`cusick_bench.problem.statistics`) lie above those of the
# nearest simulated cloth, over fabrics. Folds of all of them have narrower crests than simulated ones.
DISCREPANCY = {
    "area_log_odds": Trait(-0.01, 0.01),
    "fold_depth_log": Trait(0.03, 0.06),
    "crest_number": Trait(0.02, 0.03),
    "fold_skewness": Trait(0.16, 0.05),
}


@dataclass(frozen=True)
class FieldSpace(ParameterSpace):
    """A homogeneous cloth with traits and random fields: 39 + 4 + 6 + 900 numbers on any mesh."""

    name: ClassVar[str] = "field"

    @property
    def dimension(self) -> int:
        return CLOTH + len(FIELDS) * MODES

    @property
    def specimen_level(self) -> slice:
        return slice(CLOTH, self.dimension)

    def weights(self, name: str) -> slice:
        """Entries of tau that are the weights of a field.

        Args:
            name: Name of the field, among `FIELDS`.

        Returns:
            Their range.
        """
        begin = self.specimen_level.start + MODES * list(FIELDS).index(name)
        return slice(begin, begin + MODES)

    @staticmethod
    def trait_entry(name: str) -> int:
        """Entry of tau that is a trait's deviation from its mean, in its standard deviations.

        Args:
            name: Name of the trait, among `TRAITS`.

        Returns:
            Its index.
        """
        return HOMOGENEOUS + list(TRAITS).index(name)

    @staticmethod
    def amplitude(name: str) -> int:
        """Entry of tau that is the logarithm of a field's amplitude.

        Args:
            name: Name of the field, among `FIELDS`.

        Returns:
            Its index.
        """
        return HOMOGENEOUS + len(TRAITS) + 2 * list(FIELDS).index(name)

    @staticmethod
    def length(name: str) -> int:
        """Entry of tau that is the logarithm of a field's correlation length.

        Args:
            name: Name of the field, among `FIELDS`.

        Returns:
            Its index.
        """
        return FieldSpace.amplitude(name) + 1

    def root(self, tau: Float[Tensor, " dimension"], name: str) -> Float[Tensor, " modes"]:
        """Standard deviations of a field's coefficients.

        Args:
            tau: Parameter vector in the unconstrained, scaled space.
            name: Name of the field, among `FIELDS`.

        Returns:
            One a mode, in the field's unit times metres.
        """
        prior = FIELDS[name]
        amplitude = prior.amplitude * (prior.amplitude_sd * tau[self.amplitude(name)]).exp()
        length = prior.length * (prior.length_sd * tau[self.length(name)]).exp()
        modes = self._modes
        uniform = torch.zeros(MODES, dtype=torch.float64)
        uniform[0] = prior.level * modes.radius * math.sqrt(math.pi)  # the first mode is constant, of unit norm
        return (matern_root(modes, amplitude, length).square() + uniform.square()).sqrt()

    def trait(self, tau: Float[Tensor, " dimension"], name: str) -> Float[Tensor, ""]:
        """Value of a trait of the cloth.

        Args:
            tau: Parameter vector in the unconstrained, scaled space.
            name: Name of the trait, among `TRAITS`.

        Returns:
            The value, in the trait's unit.
        """
        prior = TRAITS[name]
        return prior.mean + prior.sd * tau[self.trait_entry(name)]

    def field(self, tau: Float[Tensor, " dimension"], name: str) -> Float[Tensor, " points"]:
        """Values of a field.

        Args:
            tau: Parameter vector in the unconstrained, scaled space.
            name: Name of the field, among `FIELDS`.

        Returns:
            On the hinges for stiffness, on the vertices for the others, in the field's unit.
        """
        return self._basis[name] @ (self.root(tau, name) * tau[self.weights(name)])

    def specimen(self, tau: Float[Tensor, " dimension"]) -> Specimen:
        """The cloth whose tables are homogeneous, with its traits and fields; see `ParameterSpace.specimen`."""
        stretch, bending = tau[:HOMOGENEOUS].split([STRETCH_SIZE, BENDING_SIZE])
        coefficients = self.root(tau, "stiffness") * tau[self.weights("stiffness")]
        on_hinges, on_faces = (self._basis[name] @ coefficients for name in ("stiffness", "faces"))
        curve = self.trait(tau, "hardening") * _CURVATURES + self.trait(tau, "bias") * _BIAS_ROW
        level = self.trait(tau, "bending")
        material = Material(
            self.prior.stretch(stretch) * (self.trait(tau, "stretch") + on_faces).exp()[:, None, None],
            self.prior.bending(bending) * (level + curve + on_hinges[:, None, None]).exp(),
            self.density(),
        )
        laid, rest = (self._raised(self.field(tau, name)) for name in ("laying", "rest"))
        return Specimen(material, initial=laid, rest_angle=dihedral_angles(rest, self.mesh.hinges))

    def bending_level(self, factor: float) -> Float[np.ndarray, " dimension"]:
        """The most probable vector of a median cloth whose bending stiffnesses are all multiplied by one factor.

        Args:
            factor: The factor, > 0.

        Returns:
            The parameter vector.
        """
        table, trait = self.prior.bending_level_sd, TRAITS["bending"].sd
        share = table**2 / (table**2 + trait**2)
        level = np.zeros(self.dimension)
        level[STRETCH_SIZE:HOMOGENEOUS] = share * self.prior.bending_level(factor)
        level[self.trait_entry("bending")] = (1 - share) * math.log(factor) / trait
        return level

    def laid_like(self, height: Float[np.ndarray, " vertices"]) -> Float[np.ndarray, " modes"]:
        """Weights of the laying field, at its median amplitude and length, that undulate most nearly as `height`.

        Of all weights that do, the most probable ones under noise of a tenth of the amplitude.

        Args:
            height: Undulation of the vertices [m]; what lies on the plate does not count.

        Returns:
            One weight a mode.
        """
        prior = FIELDS["laying"]
        ramp = fade_in(self.mesh, self.plate_radius)
        root = self.root(torch.zeros(self.dimension, dtype=torch.float64), "laying").numpy()
        design = ramp[:, None] * self._basis["laying"].numpy() * root
        noise = 0.1 * prior.amplitude
        normal = design.T @ design / noise**2 + np.eye(MODES)
        return np.linalg.solve(normal, design.T @ (ramp * height) / noise**2)

    @property
    def _modes(self) -> DiscModes:
        return disc_modes(MODES, EXTENSION * self.cloth_radius)

    @cached_property
    def _basis(self) -> dict[str, Float[Tensor, "points modes"]]:
        modes, mesh = self._modes, self.mesh
        points = {"stiffness": hinge_centres(mesh), "faces": face_centres(mesh), "laying": mesh.material}
        basis = {name: torch.from_numpy(modes(where)) for name, where in points.items()}
        return basis | {"rest": basis["laying"]}

    def _raised(self, height: Float[Tensor, " vertices"]) -> Float[Tensor, "vertices 3"]:
        """The flat cloth with its overhang at a height; on the plate it is flat."""
        ramp = torch.from_numpy(fade_in(self.mesh, self.plate_radius))
        flat = torch.from_numpy(self.mesh.flat)
        return torch.cat([flat[:, :2], (ramp * height)[:, None]], 1)
