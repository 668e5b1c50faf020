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
"""Range of B / (rho g R^3): drape coefficients of about .26 to .85; what is limper crumples at these mesh sizes."""

_DENSITY = (0.06, 0.30)  # [kg/m2]


@dataclass(frozen=True)
class Population:
    """Fabrics that live in a world: ranges from which each is drawn, evenly, or evenly in the logarithm (+).

    Attributes:
        bending: + B / (rho g R^3), B the mean of warp and weft at rest.
        bending_growth: B at 40 /m over B at rest.
        stretch: + Half the membrane stiffness of warp and weft [N/m].
        shear: + Shear stiffness [N/m].
        hardening: Stretch stiffness at full strain over that at rest.
        poisson: Poisson's ratio of bending, for worlds that have one.
        stiffness_spread: Median standard deviation of log stiffness over the cloth.
        rest_height: Median height of the rest shape [m].
        laying_length: Correlation length of the height in which a face is laid down [m].
        laying_in_log: Whether that length is drawn evenly in its logarithm.
        laying_height: Median of that height at the shortest and at the longest length [m]; a power law between.
        repeat_share: Median change of that height between captures, as a share of it.
        shift: Standard deviation of the cloth's place under the camera [m].
        turn: Standard deviation of its direction there [deg].
    """

    bending: tuple[float, float] = BENDING
    bending_growth: tuple[float, float] = (0.7, 1.2)
    stretch: tuple[float, float] = (80.0, 350.0)
    shear: tuple[float, float] = (15.0, 60.0)
    hardening: tuple[float, float] = (1.2, 2.2)
    poisson: tuple[float, float] = (0.0, 0.0)
    stiffness_spread: float = 0.10
    rest_height: float = 5e-4
    laying_length: tuple[float, float] = (0.025, 0.045)
    laying_in_log: bool = False
    laying_height: tuple[float, float] = (1e-3, 1e-3)
    repeat_share: float = 0.025
    shift: float = 3e-4
    turn: float = 0.5


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
    shift: float
    turn: float


@dataclass(frozen=True)
class Fabric:
    """A fabric.

    Attributes:
        material: Mean tables; the density is the one that is written in the case's table, without its error.
        thickness: Thickness of the cloth [m].
        variability: Spread between its samples and their pictures.
        stiffness: ln of B / (rho g R^3), B the mean of warp and weft at rest.
        poisson: Poisson's ratio of bending, for worlds that have one.
    """

    material: Material
    thickness: float
    variability: Variability
    stiffness: float
    poisson: float


def generator_of(seed: Sequence[int], attempt: int = 0) -> np.random.Generator:
    """Randomness that decides on the fabric of a case.

    Args:
        seed: Seed of the case.
        attempt: Number of the draw.

    Returns:
        A generator at its start.
    """
    return np.random.default_rng([*seed, 1, *([attempt] if attempt else [])])


def draw_fabric(population: Population, generator: np.random.Generator) -> Fabric:
    """Draws a fabric.

    Args:
        population: Fabrics of a world.
        generator: Source of randomness.

    Returns:
        A fabric of random stiffness, anisotropy, density and variability.
    """
    density = float(np.exp(generator.uniform(*np.log(_DENSITY))))
    ratio = float(np.exp(generator.uniform(*np.log(population.bending))))
    table = _bending(ratio * density * GRAVITY * CLOTH_RADIUS**3, population, generator)
    material = Material(_stretch(population, generator), table, torch.tensor(density, dtype=torch.float64))
    variability = _variability(population, generator)
    poisson = float(generator.uniform(*population.poisson))
    return Fabric(material, 2e-4 + 1.2e-3 * density, variability, float(np.log(ratio)), poisson)


def _bending(level: float, population: Population, generator: np.random.Generator) -> torch.Tensor:
    """Table (3, 5) about a level [N m]."""
    anisotropy, bias = np.exp(generator.normal(0, 0.3)), np.exp(generator.normal(0, 0.12))
    rows = level * np.array([np.sqrt(anisotropy), bias, 1 / np.sqrt(anisotropy)])
    end = generator.uniform(*population.bending_growth)
    growth = 1 + (end - 1) * growth_share(10.0 * np.arange(5))
    return torch.from_numpy(rows[:, None] * growth)


BEND = 15.0
"""Curvature at which most of the change of bending stiffness is reached [1/m]."""

_LAST = 40.0  # [1/m] where tables end


def growth_share(curvature: np.ndarray) -> np.ndarray:
    """Share of the change of bending stiffness that is reached at some curvatures: most of it at low ones.

    Args:
        curvature: Curvatures, >= 0 [1/m].

    Returns:
        The share, 1 at 40 /m.
    """
    return (1 - np.exp(-curvature / BEND)) / (1 - np.exp(-_LAST / BEND))


def _stretch(population: Population, generator: np.random.Generator) -> torch.Tensor:
    """Table (6, 4): at rest, then stretched in five directions."""
    warp, weft = np.exp(generator.uniform(np.log(population.stretch[0]), np.log(population.stretch[1]), 2))
    shear = float(np.exp(generator.uniform(*np.log(population.shear))))
    at_rest = np.array([warp, 0.1 * min(warp, weft), weft, shear])
    directions = 0.2 * np.cos(np.linspace(0, 2 * np.pi, 5))
    harder = np.append(1.0, generator.uniform(*population.hardening) + directions)
    return torch.from_numpy(at_rest * harder[:, None])


def _variability(population: Population, generator: np.random.Generator) -> Variability:
    factor = np.exp(generator.normal(0, 0.2, 4))
    stiffness_length, rest_length = generator.uniform(0.012, 0.03), generator.uniform(0.025, 0.045)
    short, long = population.laying_length
    share = generator.uniform()
    length = float(short * (long / short) ** share if population.laying_in_log else short + (long - short) * share)
    low, high = population.laying_height
    height = low * (high / low) ** (np.log(length / short) / np.log(long / short)) * factor[2]
    return Variability(
        stiffness=population.stiffness_spread * factor[0],
        stiffness_length=stiffness_length,
        rest=population.rest_height * factor[1],
        rest_length=rest_length,
        laying=float(height),
        laying_length=length,
        repeat=float(population.repeat_share * height / factor[2] * factor[3]),
        shift=population.shift,
        turn=float(np.radians(population.turn)),
    )
