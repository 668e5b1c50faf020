"""True fabrics, drawn widely: from limp to stiff, one-sided in warp or weft, with their own natural variability.

Stretch hardens (samples at full strain are stiffer than at rest), bending stiffness grows or falls with curvature.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.constants import CLOTH_RADIUS, GRAVITY

BENDING = (1.5e-4, 1.1e-2)
"""Range of B / (rho g R^3): drape coefficients of about .26 to .85; what is limper crumples at this mesh size."""

_DENSITY = (0.06, 0.30)  # [kg/m2]
_STRETCH = (80.0, 350.0)  # [N/m], half the membrane stiffness
_SHEAR = (15.0, 60.0)  # [N/m]


@dataclass(frozen=True)
class Variability:
    """Spread of what is random from sample to sample, and from laying to laying.

    Attributes:
        stiffness: Standard deviation of log stiffness over the cloth.
        stiffness_length: Its correlation length [m].
        rest: Height of the rest shape [m].
        rest_length: Its correlation length [m].
        laying: Height in which a face is laid down [m].
        laying_length: Its correlation length [m].
        repeat: Change of that height between captures [m].
        shift: Standard deviation of the cloth's place under the camera [m].
        turn: Standard deviation of its direction there [rad].
    """

    stiffness: float
    stiffness_length: float
    rest: float
    rest_length: float
    laying: float
    laying_length: float
    repeat: float
    shift: float = 3e-4
    turn: float = 0.5 * np.pi / 180


@dataclass(frozen=True)
class Fabric:
    """A fabric.

    Attributes:
        material: Mean tables; the density is the one that is written in the case's table, without its error.
        thickness: Thickness of the cloth [m].
        variability: Spread between its samples and their pictures.
        stiffness: ln of B / (rho g R^3), B the mean of warp and weft at rest.
    """

    material: Material
    thickness: float
    variability: Variability
    stiffness: float


def fabric_of(seed: Sequence[int], attempt: int = 0) -> Fabric:
    """Fabric of a case.

    Args:
        seed: Seed of the case.
        attempt: Number of the draw: another fabric where the effect could not be seen in those before.

    Returns:
        The fabric.
    """
    return draw_fabric(np.random.default_rng([*seed, 1, *([attempt] if attempt else [])]))


def draw_fabric(generator: np.random.Generator) -> Fabric:
    """Draws a fabric.

    Args:
        generator: Source of randomness.

    Returns:
        A fabric of random stiffness, anisotropy, density and variability.
    """
    density = float(np.exp(generator.uniform(*np.log(_DENSITY))))
    ratio = float(np.exp(generator.uniform(*np.log(BENDING))))
    table = _bending(ratio * density * GRAVITY * CLOTH_RADIUS**3, generator)
    material = Material(_stretch(generator), table, torch.tensor(density, dtype=torch.float64))
    return Fabric(material, 2e-4 + 1.2e-3 * density, _variability(generator), float(np.log(ratio)))


def _bending(level: float, generator: np.random.Generator) -> torch.Tensor:
    """Table (3, 5) about a level [N m]."""
    anisotropy, bias = np.exp(generator.normal(0, 0.3)), np.exp(generator.normal(0, 0.12))
    rows = level * np.array([np.sqrt(anisotropy), bias, 1 / np.sqrt(anisotropy)])
    end = generator.uniform(0.7, 1.2)  # B at 40 /m over B at rest; most of the change at low curvature
    growth = 1 + (end - 1) * (1 - np.exp(-np.arange(5) / 1.5)) / (1 - np.exp(-4 / 1.5))
    return torch.from_numpy(rows[:, None] * growth)


def _stretch(generator: np.random.Generator) -> torch.Tensor:
    """Table (6, 4): at rest, then stretched in five directions."""
    warp, weft = np.exp(generator.uniform(np.log(_STRETCH[0]), np.log(_STRETCH[1]), 2))
    shear = float(np.exp(generator.uniform(*np.log(_SHEAR))))
    at_rest = np.array([warp, 0.1 * min(warp, weft), weft, shear])
    harder = np.append(1.0, generator.uniform(1.2, 2.2) + 0.2 * np.cos(np.linspace(0, 2 * np.pi, 5)))
    return torch.from_numpy(at_rest * harder[:, None])


def _variability(generator: np.random.Generator) -> Variability:
    factor = np.exp(generator.normal(0, 0.2, 4))
    return Variability(
        stiffness=0.10 * factor[0],
        stiffness_length=generator.uniform(0.012, 0.03),
        rest=5e-4 * factor[1],
        rest_length=generator.uniform(0.025, 0.045),
        laying=1e-3 * factor[2],
        laying_length=generator.uniform(0.025, 0.045),
        repeat=2.5e-5 * factor[3],
    )
