"""Stiffness tables of cloths: the homogeneous space's, times what the traits contribute."""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from cusick_bench.problem.cloth_prior import HOMOGENEOUS, TRAITS, trait_entry
from cusick_bench.problem.priors import BENDING_SIZE, BENDING_TABLE_FACTOR, STRETCH_SIZE, StiffnessPrior

_CURVATURES = torch.arange(-2.0, 3.0, dtype=torch.float64)  # samples 0 to 40 /m, from the middle one [10 /m]
_GRAIN_ROW = torch.tensor([[-0.5], [0.0], [0.5]], dtype=torch.float64)
_BIAS_ROW = torch.tensor([[0.0], [1.0], [0.0]], dtype=torch.float64)  # of the bending table


def trait(cloths: Float[Tensor, "*batch numbers"], name: str) -> Float[Tensor, "*batch"]:
    """Value of a trait of cloths.

    Args:
        cloths: Their parameters in the unconstrained, scaled space, in the last axis.
        name: Name of the trait, among `TRAITS`.

    Returns:
        One a cloth, in the trait's unit.
    """
    prior = TRAITS[name]
    return prior.mean + prior.sd * cloths[..., trait_entry(name)]


def trait_levels(cloths: Float[Tensor, "*batch numbers"]) -> tuple[Tensor, Float[Tensor, "*batch 3 5"]]:
    """Contributions of traits to the logarithms of all stretch stiffnesses, and of each bending stiffness.

    Args:
        cloths: Parameters of cloths in the unconstrained, scaled space, in the last axis.

    Returns:
        One number a cloth for stretch, a table a cloth for bending.
    """

    def of(name: str) -> Float[Tensor, "*batch 1 1"]:
        return trait(cloths, name)[..., None, None]

    curve = of("hardening") * _CURVATURES + of("bias") * _BIAS_ROW
    curve = curve + of("grain") * _GRAIN_ROW
    return trait(cloths, "stretch"), of("bending") + curve


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
    stretch_level, bending_levels = trait_levels(cloths)
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
