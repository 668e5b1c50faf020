"""Smooth random fields around a homogeneous cloth: of stiffness, of the laid-down shape and of the rest shape.

Stiffness that varies independently from element to element averages out over a fold and cannot move it; undulations of
a millimetre in the laid-down shape or in the rest shape can. So tau holds, all with prior N(0, 1):

    the 39 numbers of the homogeneous space,
    traits, further numbers in which cloths differ: the levels of bending and of stretch stiffness (the 39 numbers are
    independent, so they hardly ever rise all together), the rise of bending stiffness with curvature, the stiffness of
    the bias, and others (`TRAITS`),
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
from cusick_bench.problem.priors import (
    BENDING_SIZE,
    BENDING_SLOPE,
    BENDING_TABLE_FACTOR,
    DENSITY_REFERENCE,
    STRETCH_SIZE,
    StiffnessPrior,
)
from cusick_bench.problem.space import ParameterSpace, Specimen
from cusick_bench.sim.cloth.heterogeneity import face_centres, hinge_centres
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.matern import EXTENSION, DiscModes, disc_modes, matern_root
from cusick_bench.sim.cloth.shape import dihedral_angles, fade_in

MODES = 300  # of each field: waves of 3.5 cm and longer
MOST_POISSON = 0.3  # largest Poisson's ratio of bending; woven cloth has less
HOMOGENEOUS = STRETCH_SIZE + BENDING_SIZE
_CURVATURES = torch.arange(-2.0, 3.0, dtype=torch.float64)  # samples 0 to 40 /m, from the middle one [10 /m]
_GRAIN_ROW = torch.tensor([[-0.5], [0.0], [0.5]], dtype=torch.float64)
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
    amplitude_sd: float = 0.3
    length_sd: float = 0.3
    level: float = 0.0


@dataclass(frozen=True)
class Trait:
    """Normal prior of a trait, a number in which cloths differ.

    Attributes:
        mean: Mean over all cloths.
        sd: Standard deviation between cloths.
    """

    mean: float
    sd: float


# Found by `cusick_bench.problem.population` with law `plate` at 480 vertices, from fabrics of the release that are not
# used in any table of results, neither themselves nor as a named set.
TRAITS = {
    "bending": Trait(-0.7, 1.5),  # [log] level of all bending stiffnesses, relative to the homogeneous space's prior
    "stretch": Trait(0.9, 1.2),  # [log] level of all stretch stiffnesses, relative to that prior
    "hardening": Trait(0.45, 0.25),  # [log] rise of bending stiffness per curvature sample, that is per 10 /m
    "bias": Trait(-0.1, 0.5),  # [log] bending stiffness at 45 degrees, relative to that prior
    "grain": Trait(-0.7, 0.5),  # [log] bending stiffness of the warp over that of the weft, relative to that prior
    "poisson": Trait(0.0, 1.5),  # log odds of Poisson's ratio within 0 to `MOST_POISSON`, for law `plate`; assumed
    "curl": Trait(0.0, 4.0),  # [1/m] curvature of the rest shape, the same all over; > 0 where it rises to its face
}

# The correlation length of the laid shape, and how much samples of one cloth differ in stiffness, were found in the
# same way. The others are assumed: undulations of 1 mm in the laid shape (from .3 to 3 mm no statistic used for
# inference changes by more than a fifth of a specimen's scatter), of a third of that in the rest shape, and 15 % of
# unevenness of the stiffness.
FIELDS = {
    "stiffness": FieldPrior(0.15, 0.02, level=0.12),  # [log]
    "laying": FieldPrior(1.0e-3, 0.0135, length_sd=0.5),  # [m]
    "rest": FieldPrior(0.3e-3, 0.03),  # [m]
}
CLOTH = HOMOGENEOUS + len(TRAITS) + 2 * len(FIELDS)

# Found in the same way: distance of a fabric's mean statistics (`cusick_bench.problem.statistics`) from those of the
# nearest simulated cloth, root mean square over fabrics. All fabrics share a tendency towards 45 degrees, which no
# symmetric cloth has; hence the large value of `grain_2_imaginary`.
DISCREPANCY = {
    "area_log_odds": 0.03,
    "fold_depth_log": 0.08,
    "crest_number": 0.035,
    "fold_skewness": 0.13,
    "grain_2_real": 0.06,
    "grain_2_imaginary": 0.42,
    "grain_4_real": 0.1,
}


LEADING = ("bending", "bias", "grain", "stretch", "shear", "hardening", "curl", "laying")
"""Numbers on which the expected statistics of a cloth depend: logarithms of the bending stiffness (mean over
curvatures, warp and weft), of the ratio of the bias to it, of the ratio of warp to weft, of the stretch stiffness at
rest, and of the ratio of the shear stiffness to that; rise of bending stiffness with curvature; curl; logarithm of the
laid shape's correlation length."""
ALONG_LEVEL = np.isin(LEADING, ("bending", "stretch")).astype(np.float64)
"""Derivative of these by a specimen's level, which multiplies all bending and stretch stiffnesses by one factor."""
Levels = Float[np.ndarray, " cloths"] | float
_AT_REST = {"c11": 0, "c22": 1, "c33": 2}  # entries of the first strain sample among the diagonal ones


@dataclass(frozen=True)
class Leading:
    """Leading directions of cloths: x = origin + rows theta, for a cloth of reference weight and size.

    Attributes:
        rows: Derivatives by theta.
        origin: Values for the median cloth.
    """

    rows: Float[np.ndarray, "leading cloth"]
    origin: Float[np.ndarray, " leading"]

    def __call__(
        self, cloths: Float[np.ndarray, "cloths numbers"], levels: Levels = 0.0
    ) -> Float[np.ndarray, "cloths leading"]:
        """Leading directions x of cloths theta, or of specimens of them.

        Args:
            cloths: theta, one a row.
            levels: Log stiffness of each specimen beside its cloth's (`FieldSpace.levels`); 0 for the cloths.

        Returns:
            One row a cloth.
        """
        return self.origin + self._moved(cloths, levels)

    def rest(self, cloths: Float[np.ndarray, "cloths numbers"]) -> Float[np.ndarray, "cloths numbers"]:
        """Properties of cloths that change none of the leading directions.

        Args:
            cloths: theta, one a row.

        Returns:
            Their projections.
        """
        return cloths - (cloths @ self.rows.T) @ np.linalg.pinv(self.rows).T

    def scaled(
        self, cloths: Float[np.ndarray, "cloths numbers"], levels: Levels = 0.0
    ) -> Float[np.ndarray, "cloths leading"]:
        """Leading directions about those of the median cloth, in standard deviations of the prior.

        Args:
            cloths: theta, one a row.
            levels: Log stiffness of each specimen beside its cloth's; 0 for the cloths.

        Returns:
            One row a cloth.
        """
        return self._moved(cloths, levels) / np.linalg.norm(self.rows, axis=1)

    @property
    def scaled_level(self) -> Float[np.ndarray, " leading"]:
        """How `scaled` moves with a specimen's level."""
        return ALONG_LEVEL / np.linalg.norm(self.rows, axis=1)

    def _moved(
        self, cloths: Float[np.ndarray, "cloths numbers"], levels: Levels
    ) -> Float[np.ndarray, "cloths leading"]:
        return cloths @ self.rows.T + np.multiply.outer(levels, ALONG_LEVEL)


def _trait(cloths: Float[Tensor, "*batch numbers"], name: str) -> Float[Tensor, "*batch"]:
    prior = TRAITS[name]
    return prior.mean + prior.sd * cloths[..., FieldSpace.trait_entry(name)]


def _trait_levels(cloths: Float[Tensor, "*batch numbers"]) -> tuple[Tensor, Float[Tensor, "*batch 3 5"]]:
    """Contributions of traits to the logarithms of all stretch stiffnesses, and of each bending stiffness."""

    def of(name: str) -> Float[Tensor, "*batch 1 1"]:
        return _trait(cloths, name)[..., None, None]

    curve = of("hardening") * _CURVATURES + of("bias") * _BIAS_ROW
    curve = curve + of("grain") * _GRAIN_ROW
    return _trait(cloths, "stretch"), of("bending") + curve


def cloth_tables(
    prior: StiffnessPrior, cloths: Float[Tensor, "*batch numbers"]
) -> tuple[Float[Tensor, "*batch 6 4"], Float[Tensor, "*batch 3 5"]]:
    """Stiffness tables of cloths, without the fields in which specimens differ.

    Args:
        prior: Law and areal density of the cloths.
        cloths: Their parameters in the unconstrained, scaled space, the first `CLOTH` of a vector of `FieldSpace`.

    Returns:
        Stretch tables [N/m] and bending tables [N m].
    """
    stretch, bending = cloths[..., :HOMOGENEOUS].split([STRETCH_SIZE, BENDING_SIZE], -1)
    stretch_level, bending_levels = _trait_levels(cloths)
    return prior.stretch(stretch) * stretch_level.exp()[..., None, None], prior.bending(bending) * bending_levels.exp()


def mean_bending(prior: StiffnessPrior, cloths: Float[np.ndarray, "cloths numbers"]) -> Float[np.ndarray, " cloths"]:
    """Bending stiffness of cloths, the geometric mean of directions and curvatures.

    Args:
        prior: Law and areal density of the cloths.
        cloths: Their parameters, as `cloth_tables` takes them.

    Returns:
        One a cloth [N m].
    """
    bending = cloth_tables(prior, torch.as_tensor(cloths))[1]
    return bending.log().mean((1, 2)).exp().numpy() / BENDING_TABLE_FACTOR[prior.law]


@dataclass(frozen=True)
class FieldSpace(ParameterSpace):
    """A homogeneous cloth with traits and random fields: 39 + 7 + 6 + 900 numbers on any mesh."""

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
            rows[row, self.trait_entry(name)], origin[row] = TRAITS[name].sd, TRAITS[name].mean
        laying, size = FIELDS["laying"], self.cloth_radius / RELEASE.cloth_radius_m
        rows[7, self.length("laying")], origin[7] = laying.length_sd, math.log(laying.length / size)
        weight = self.prior.density / DENSITY_REFERENCE
        origin[0] += (BENDING_SLOPE[[0, 2]].mean() - 1) * math.log(weight) - 3 * math.log(size)
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
        amplitude = prior.amplitude * (prior.amplitude_sd * tau[self.amplitude(name)]).exp()
        length = prior.length * (prior.length_sd * tau[self.length(name)]).exp()
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
        turned[..., self.trait_entry("curl")] = -cloths[..., self.trait_entry("curl")] - 2 * curl.mean / curl.sd
        turned[..., self.weights("rest")] *= -1  # nothing where there are no weights
        return turned

    def trait(self, tau: Float[Tensor, " dimension"], name: str) -> Float[Tensor, ""]:
        """Value of a trait of the cloth.

        Args:
            tau: Parameter vector in the unconstrained, scaled space.
            name: Name of the trait, among `TRAITS`.

        Returns:
            The value, in the trait's unit.
        """
        return _trait(tau, name)

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
        stretch_level, bending_levels = _trait_levels(tau)
        material = Material(
            self.prior.stretch(stretch) * (stretch_level + on_faces).exp()[:, None, None],
            self.prior.bending(bending) * (bending_levels + on_hinges[:, None, None]).exp(),
            self.density(),
            MOST_POISSON * torch.sigmoid(self.trait(tau, "poisson")),
        )
        bowl = 0.5 * torch.from_numpy((self.mesh.material**2).sum(1))
        laid = self._raised(self.field(tau, "laying"))
        rest = self._raised(self.field(tau, "rest") + self.trait(tau, "curl") * bowl)
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

    def _raised(self, height: Float[Tensor, " vertices"]) -> Float[Tensor, "vertices 3"]:
        """The flat cloth with its overhang at a height; on the plate it is flat."""
        ramp = torch.from_numpy(fade_in(self.mesh, self.plate_radius))
        flat = torch.from_numpy(self.mesh.flat)
        return torch.cat([flat[:, :2], (ramp * height)[:, None]], 1)
