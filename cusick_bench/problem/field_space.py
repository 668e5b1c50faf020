"""Smooth random fields around a homogeneous cloth: of stiffness, of the laid-down shape and of the rest shape.

Stiffness that varies independently from element to element averages out over a fold and cannot move it; undulations of
a millimetre in the laid-down shape or in the rest shape can. So tau holds, all with prior N(0, 1):

    the 39 numbers of the homogeneous space,
    traits, further numbers in which cloths differ: the levels of bending and of stretch stiffness (the 39 numbers are
    independent, so they hardly ever rise all together), the rise of bending stiffness with curvature, the stiffness of
    the bias, and others (`TRAITS` in `cloth_prior`),
    logarithms of amplitude and correlation length of every field, relative to the medians below,
    weights w of every field's modes (see `cusick_bench.sim.cloth.matern`).

The first three belong to the cloth. The weights belong to a specimen: another specimen of the same cloth has new ones.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.problem.cloth_prior import (
    CLOTH,
    FIELDS,
    HOMOGENEOUS,
    MODES,
    MOST_POISSON,
    TRAITS,
    amplitude_entry,
    length_entry,
    trait_entry,
)
from cusick_bench.problem.cloth_tables import trait, trait_levels
from cusick_bench.problem.leading import LEADING, Leading
from cusick_bench.problem.priors import BENDING_SIZE, BENDING_SLOPE, DENSITY_REFERENCE, STRETCH_SIZE
from cusick_bench.problem.space import ParameterSpace, Specimen
from cusick_bench.sim.cloth.heterogeneity import face_centres, hinge_centres
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.matern import EXTENSION, DiscModes, disc_modes, matern_root
from cusick_bench.sim.cloth.shape import dihedral_angles, fade_in

_AT_REST = {"c11": 0, "c22": 1, "c33": 2}  # entries of the first strain sample among the diagonal ones


@dataclass(frozen=True)
class FieldSpace(ParameterSpace):
    """A homogeneous cloth with traits and random fields: 39 + 7 + 6 + 900 numbers on any mesh."""

    name: ClassVar[str] = "field"
    version: ClassVar[int] = 2
    lays_down: ClassVar[bool] = True

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

    @cached_property
    def leading(self) -> Leading:
        """Leading directions, on which the expected statistics depend (`LEADING`).

        A drape depends on stiffness over weight, and on lengths over the cloth's radius: cloths of other weight and
        size are taken for those of `DENSITY_REFERENCE` and the release's radius that drape alike.
        """
        rows = np.zeros((len(LEADING), CLOTH))
        weft, bias, warp = self.prior.bending_root.reshape(3, -1, BENDING_SIZE).mean(1)
        bending = slice(STRETCH_SIZE, HOMOGENEOUS)
        rows[:3, bending] = (warp + weft) / 2, bias - (warp + weft) / 2, warp - weft
        c11, c22, c33 = (self.prior.stretch_root[_AT_REST[name]] for name in ("c11", "c22", "c33"))
        tensile = [4 * sample + column for sample in range(6) for column in (0, 2, 3)]
        rows[3:5, tensile] = (c11 + c22) / 2, c33 - (c11 + c22) / 2
        traits = {"bending": 0, "bias": 1, "grain": 2, "stretch": 3, "hardening": 5, "curl": 6}
        origin = np.zeros(len(LEADING))
        for name, row in traits.items():
            rows[row, trait_entry(name)], origin[row] = TRAITS[name].sd, TRAITS[name].mean
        laying, size = FIELDS["laying"], self.cloth_radius / RELEASE.cloth_radius_m
        rows[7, length_entry("laying")], origin[7] = laying.length_sd, math.log(laying.length / size)
        weight = self.prior.density / DENSITY_REFERENCE
        of_weft, of_bias, of_warp = BENDING_SLOPE * math.log(weight)
        origin[0] += (of_warp + of_weft) / 2 - math.log(weight) - 3 * math.log(size)
        origin[1] += of_bias - (of_warp + of_weft) / 2
        origin[2] += of_warp - of_weft
        origin[3] -= math.log(weight * size)
        rows[6], origin[6] = rows[6] * size, origin[6] * size
        return Leading(rows, origin)

    def root(self, tau: Float[Tensor, " dimension"], name: str) -> Float[Tensor, " modes"]:
        """Standard deviations of a field's coefficients.

        Args:
            tau: Parameter vector in the unconstrained, scaled space.
            name: Name of the field, among `FIELDS`.

        Returns:
            One a mode, in the field's unit times metres.
        """
        prior = FIELDS[name]
        amplitude = prior.amplitude * (prior.amplitude_sd * tau[amplitude_entry(name)]).exp()
        length = prior.length * (prior.length_sd * tau[length_entry(name)]).exp()
        modes = self.modes
        uniform = torch.zeros(MODES, dtype=torch.float64)
        uniform[0] = prior.level * modes.radius * math.sqrt(math.pi)  # the first mode is constant, of unit norm
        return (matern_root(modes, amplitude, length).square() + uniform.square()).sqrt()

    def levels(self, taus: Float[np.ndarray, "members dimension"]) -> Float[np.ndarray, " members"]:
        """Level of specimens: mean of their stiffness field over the overhang [log].

        Args:
            taus: Parameter vectors in the unconstrained, scaled space, one a row.

        Returns:
            One a specimen.
        """
        weights = taus[:, self.weights("stiffness")]
        return np.array([own @ self._level_shares(tau) for own, tau in zip(weights, taus, strict=True)])

    def level_sd(self, cloth: Float[np.ndarray, " numbers"]) -> float:
        """Standard deviation of the level between specimens of a cloth [log].

        Args:
            cloth: theta.

        Returns:
            That of `levels`.
        """
        return float(np.linalg.norm(self._level_shares(cloth)))

    def _level_shares(self, cloth: Float[np.ndarray, " numbers"]) -> Float[np.ndarray, " modes"]:
        """Derivative of the level by each weight of the stiffness field."""
        return self._overhang_mean * self.root(torch.as_tensor(cloth), "stiffness").numpy()

    def turned(self, cloths: Float[np.ndarray, "*batch numbers"]) -> Float[np.ndarray, "*batch numbers"]:
        """Cloths or specimens that lie the other way up: their rest shape curves and undulates the other way.

        What is stiff stays so: tables that are symmetric in the grain are those of their mirror image. A specimen's
        stiffness field ought to be mirrored; its statistics are the same without.

        Args:
            cloths: theta or parameter vectors, in the last axis.

        Returns:
            Those of the other face.
        """
        turned, curl = cloths.copy(), TRAITS["curl"]
        turned[..., trait_entry("curl")] = -cloths[..., trait_entry("curl")] - 2 * curl.mean / curl.sd
        turned[..., self.weights("rest")] *= -1  # nothing where there are no weights
        return turned

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
        stretch_level, bending_levels = trait_levels(tau)
        material = Material(
            self.prior.stretch(stretch) * (stretch_level + on_faces).exp()[:, None, None],
            self.prior.bending(bending) * (bending_levels + on_hinges[:, None, None]).exp(),
            self.density(),
            MOST_POISSON * torch.sigmoid(trait(tau, "poisson")),
        )
        ramp = torch.from_numpy(fade_in(self.mesh, self.plate_radius))  # the plate is flat
        laid = self._raised(ramp * self.field(tau, "laying"))
        rest = dihedral_angles(self._raised(self.field(tau, "rest")), self.mesh.hinges)
        return Specimen(material, initial=laid, rest_angle=rest + trait(tau, "curl") * self._curled)

    def bending_level(self, factor: float) -> Float[np.ndarray, " dimension"]:
        """The most probable vector of a median cloth whose bending stiffnesses are all multiplied by one factor.

        Args:
            factor: The factor, > 0.

        Returns:
            The parameter vector.
        """
        table_sd, trait_sd = self.prior.bending_level_sd, TRAITS["bending"].sd
        share = table_sd**2 / (table_sd**2 + trait_sd**2)
        level = np.zeros(self.dimension)
        level[STRETCH_SIZE:HOMOGENEOUS] = share * self.prior.bending_level(factor)
        level[trait_entry("bending")] = (1 - share) * math.log(factor) / trait_sd
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
    def modes(self) -> DiscModes:
        """Modes of the fields."""
        return disc_modes(MODES, EXTENSION * self.cloth_radius)

    @cached_property
    def _basis(self) -> dict[str, Float[Tensor, "points modes"]]:
        modes, mesh = self.modes, self.mesh
        points = {"stiffness": hinge_centres(mesh), "faces": face_centres(mesh), "laying": mesh.material}
        basis = {name: torch.from_numpy(modes(where)) for name, where in points.items()}
        return basis | {"rest": basis["laying"]}

    @cached_property
    def _overhang_mean(self) -> Float[np.ndarray, " modes"]:
        """Mean of every mode over the hinges outside of the plate."""
        outside = np.hypot(*hinge_centres(self.mesh).T) > self.plate_radius
        return self._basis["stiffness"].numpy()[outside].mean(0)

    @cached_property
    def _curled(self) -> Float[Tensor, " hinges"]:
        """Rest angles of a cloth of curvature 1 per metre in every direction [rad m]."""
        slight = 1e-3  # [1/m] so that the bowl is as curved at its rim as in its middle
        bowl = self._raised(torch.from_numpy(0.5 * slight * (self.mesh.material**2).sum(1)))
        return dihedral_angles(bowl, self.mesh.hinges) / slight

    def _raised(self, height: Float[Tensor, " vertices"]) -> Float[Tensor, "vertices 3"]:
        """The flat cloth with its vertices at a height."""
        return torch.cat([torch.from_numpy(self.mesh.flat)[:, :2], height[:, None]], 1)
