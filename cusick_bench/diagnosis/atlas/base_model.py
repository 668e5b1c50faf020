"""The base model of a fabric: what the simulator knows, without any effect, as a distribution over drapes.

A fabric has nine numbers theta; lengths are in units of the cloth's radius R, stiffness in units of weight:

    bending      ln of B / (rho g R^3), B the geometric mean of warp and weft
    anisotropy   ln of B_weft / B_warp
    bias         ln of B at 45 degrees over B
    growth       ln of B at 40 /m over B at 0
    shear        ln of shear stiffness / (rho g R)
    laying       ln of the height in which the cloth is laid down, standard deviation over 1 mm
    rest         ln of the rest shape's height over 0.3 mm
    length       ln of the correlation length of the laid shape over 20 mm
    between      ln of the standard deviation of ln B between samples over 0.1

and a sample of it is a draw of its level of stiffness and of smooth fields: of its rest shape and stiffness, which it
keeps when it is turned over, and of the shape in which each face is laid down. These are what scatters the folds of
real samples; without them a diagnosis would blame natural variability on an effect.

Everything else is fixed (the cloth is nearly inextensible, its membrane stiffness does not depend on strain) or drawn
once for each fabric (Poisson's ratio from 0 to .3, the correlation length of the rest shape). With `other_laws` the
fixed quantities are drawn at random too, over the range that woven cloth shows, to learn how much they matter.

Its law is `plate` on a mesh where the error of discretisation is small (`sim/constants.py`). An atlas is made of many
drapes by a cheaper model (`COARSE`) and of fewer by this one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from cusick_bench.sim.cloth.material import Material, uniform_material
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.cloth.shape import SmoothField, smooth_field
from cusick_bench.sim.constants import CLOTH_RADIUS, GRAVITY, VERTICES_OF_TRUTH
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.release import STEP_SECONDS, STEPS
from cusick_bench.sim.setup import Field, Setup, Side

NAMES = ("bending", "anisotropy", "bias", "growth", "shear", "laying", "rest", "length", "between")
PRIOR_MEAN = np.array([-7.1, 0.0, 0.0, 0.0, 5.0, 0.35, 0.0, 0.0, 0.0])
PRIOR_SD = np.array([1.4, 0.45, 0.25, 0.3, 1.0, 0.6, 0.45, 0.45, 0.5])
"""Bending: the drape coefficients of woven cloth, .1 to .9, and with them the middle 98 % of 618 measured fabrics
(Feng et al. 2022); shear: Kawabata's G of woven cloth, .3 to 3 gf/(cm deg), at .1 to .25 kg/m2; laid shape: what gives
real numbers and depths of folds (`sim/release.py`); the others: spread of Kawabata measurements of woven cloth,
assumed."""
LOW = np.array([-9.8, -1.1, -0.6, -0.7, 2.2, -1.0, -1.1, -0.9, -1.2])
HIGH = np.array([-4.5, 1.1, 0.6, 0.7, 7.2, 1.6, 1.1, 0.8, 1.2])

LAYING_HEIGHT = 1e-3  # [m]
LAYING_LENGTH = 0.02  # [m]
STEEPEST = 0.3  # upper limit of the laid shape's height over its correlation length, approached smoothly
REST_HEIGHT = 3e-4  # [m]
BETWEEN = 0.1  # sd of ln B between samples
STIFFNESS_SPREAD = 0.08  # sd of log stiffness within a sample: natural unevenness of weight and stiffness
STIFFNESS_LENGTH = 0.02  # [m]
REST_LENGTHS = (0.022, 0.042)  # [m] correlation length of the rest shape, drawn per fabric
POISSON = (0.0, 0.3)  # drawn per fabric
_OTHER_STRETCH = (60.0, 800.0)  # [N/m] at `DENSITY`: measured cloth at small strain (Wang, O'Brien, Ramamoorthi 2011)
_OTHER_HARDENING = (1.0, 2.5)  # membrane stiffness at full over that at no strain; likewise
_OTHER_LENGTHS = (-0.5, 0.4)  # ln of correlation lengths over those of the base model
DENSITY = 0.15  # [kg/m2]; only ratios to weight matter
STRETCH = 300.0  # [N/m] at that density: nearly inextensible
SETTINGS = DrapeSettings(law="plate", membrane="given", steps=STEPS, step_seconds=STEP_SECONDS)
"""How cloths of the base model are draped. The shipped atlas was made before membranes were softened, and closures are
simulated alike: with softened membranes corrections of its predictions (`simulation.closure`) diverge in limp cloth."""
MESHES = 8  # meshes in turn, so that no mesh's own asymmetry is taken for a property of the cloth


@dataclass(frozen=True)
class BaseModel:
    """Simulates samples of a fabric.

    Attributes:
        vertices: Mesh size.
        settings: How cloths are draped.
        meshes: Number of meshes that are used in turn.
        first_mesh: Number of the first one.
        other_laws: Whether membrane stiffness, bending curve and correlation lengths are drawn at random as well.
    """

    vertices: int = VERTICES_OF_TRUTH
    settings: DrapeSettings = SETTINGS
    meshes: int = MESHES
    first_mesh: int = 0
    other_laws: bool = False

    def samples(
        self,
        theta: Float[ndarray, "parameters"],
        count: int,
        seed: Sequence[int],
        *,
        sides: Sequence[Side] = ("up", "down"),
    ) -> list[Setup]:
        """Setups of `count` samples, each on both sides: up, down, up, down, ...

        Args:
            theta: The fabric.
            count: Number of samples.
            seed: Same seed, same samples: theta and effects can change under common random numbers.
            sides: Which faces are draped.

        Returns:
            The setups, sample by sample.
        """
        fabric = np.random.default_rng([*seed, 0])
        rest_length, poisson = fabric.uniform(*REST_LENGTHS), fabric.uniform(*POISSON)
        laying_length = LAYING_LENGTH * float(np.exp(theta[7]))
        material = replace(cloth(theta), poisson=torch.tensor(poisson, dtype=torch.float64))
        stiffness_length = STIFFNESS_LENGTH
        if self.other_laws:
            other = np.random.default_rng([*seed, 2])
            material = _of_another_law(material, other)
            factor = np.exp(other.uniform(*_OTHER_LENGTHS, size=2))
            rest_length, stiffness_length = rest_length * float(factor[0]), stiffness_length * float(factor[1])
        laying_height = _not_too_steep(LAYING_HEIGHT * float(np.exp(theta[5])), laying_length)
        rest_height = REST_HEIGHT * float(np.exp(theta[6]))
        between = BETWEEN * float(np.exp(theta[8]))
        setups = []
        for sample in range(count):
            generator = np.random.default_rng([*seed, 1, sample])
            mesh = _mesh(self.settings.law, self.vertices, self.first_mesh + int(generator.integers(self.meshes)))
            bending, stretch = (smooth_field(STIFFNESS_SPREAD, stiffness_length, generator) for _ in range(2))
            rest = smooth_field(rest_height, float(rest_length), generator)
            laying = {side: smooth_field(laying_height, laying_length, generator) for side in ("up", "down")}
            level = between * float(generator.standard_normal())
            for side in sides:
                setups.append(
                    Setup(
                        mesh, self.settings, material, side=side, capture=1 if side == "up" else 3,
                        laying=as_field(laying[side]), rest=as_field(rest),
                        log_bending=(as_field(bending), _even(level)),
                        log_stretch=(as_field(stretch),), specimen_seed=(*seed, sample),
                        laying_seed=(*seed, sample, int(side == "down")),
                    )
                )  # fmt: skip
        return setups


def _not_too_steep(height: float, length: float) -> float:
    """Height of the laid shape [m], reduced so that height over length stays below `STEEPEST`."""
    return height / (1 + height / (STEEPEST * length))


def _even(value: float) -> Field:
    """A field that has the same value everywhere."""
    return lambda points: torch.full((len(points),), value, dtype=torch.float64)


def cloth(theta: Float[ndarray, "parameters"]) -> Material:
    """The mean cloth of a fabric, at `DENSITY`.

    Args:
        theta: The fabric (see the module).

    Returns:
        Its material.
    """
    weight = DENSITY * GRAVITY
    level = np.exp(theta[0]) * weight * CLOTH_RADIUS**3
    rows = level * np.exp([theta[1] / 2, theta[2], -theta[1] / 2])
    growth = np.exp(theta[3] * np.linspace(0, 1, 5))
    shear = float(np.exp(theta[4])) * weight * CLOTH_RADIUS
    plain = uniform_material(density=DENSITY, bending=float(level), stretch=STRETCH, shear=shear)
    return replace(plain, bending=torch.from_numpy(rows[:, None] * growth))


def _of_another_law(material: Material, generator: np.random.Generator) -> Material:
    """The cloth with a random membrane and bending curve; shear, bending at rest and bending at 40 /m stay the same.

    The membrane stretches more easily and hardens with strain.
    """
    warp, weft = np.exp(generator.uniform(*np.log(_OTHER_STRETCH), size=2)) / 2
    at_rest = np.array([warp, generator.uniform(0, 0.2) * min(warp, weft), weft, float(material.stretch[0, 3])])
    strained = float(generator.uniform(*_OTHER_HARDENING)) + generator.uniform(-0.2, 0.2, 5)
    stretch = at_rest * np.append(1.0, strained)[:, None]
    # The ratio of bending stiffness at 40 /m to that at 0 stays, but most of the change may come at small curvatures,
    # as it does with friction between yarns.
    early = (1 - np.exp(-np.arange(5) / 1.5)) / (1 - np.exp(-4 / 1.5))
    table = material.bending.numpy()
    share = generator.uniform()
    even = np.linspace(0, 1, 5)
    curve = np.exp(np.log(table[:, -1:] / table[:, :1]) * (share * early + (1 - share) * even))
    return replace(material, stretch=torch.from_numpy(stretch), bending=torch.from_numpy(table[:, :1] * curve))


def as_field(smooth: SmoothField) -> Field:
    """A random field as a function of torch points, without gradients to them.

    Args:
        smooth: The field as a function of numpy points.

    Returns:
        The function.
    """

    def field(points: Tensor) -> Tensor:
        return torch.from_numpy(smooth(points.detach().numpy()))

    return field


@lru_cache(maxsize=32)
def _mesh(law: str, vertices: int, seed: int) -> Mesh:
    return cloth_mesh(law, vertices, seed=1000 + seed)
