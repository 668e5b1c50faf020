"""What an atlas is made of: which fabrics, which of them with which effects, and on which mesh."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.constants import VERTICES_OF_PAPER
from cusick_bench.sim.effects import registered

BASE = "base"
FINE = "fine"
"""The same fabrics under the base model's own law and mesh, `plate`: what the cheaper model gets wrong."""
FINEST = "finest"
"""The limp fabrics among them on a still finer mesh: the base model's own mesh is too coarse for their folds."""
LAWS = "other-laws"
"""The cheaper model again, with shorter steps and with a random membrane, bending curve and correlation lengths, which
theta does not describe."""
ONE_MESH = "one-mesh"
"""The cheaper model again, with all samples of a fabric on one mesh: the effect of an asymmetry that they share."""
FINEST_VERTICES = VERTICES_OF_PAPER
FINEST_SAMPLES = 2
LIMP = -7.0
"""theta's bending below which fabrics are draped on the finest mesh."""
NOT_SIMULATED = ("grain-skew", "density-bias", "self-contact")
"""Effects without drapes of their own: a skewed grain only turns the statistics, a wrong density only rescales the
stiffness, and drapes with self-contact are too costly for an atlas."""
SEED = 71
"""Seed of the draws of fabrics, samples and effects."""
_STIFF_IN_SHEAR = 5.8  # theta's shear above which fabrics belong to `stiff_points`


def at_fine(effect: str) -> str:
    """Name of the drapes of an effect under the base model's own law and mesh.

    Args:
        effect: Name of the effect.

    Returns:
        The name.
    """
    return f"{effect}@{FINE}"


@dataclass(frozen=True)
class Design:
    """Design of an atlas: its fabrics and drapes.

    Attributes:
        points: Number of fabrics.
        stiff_points: Number of further fabrics that are stiff in shear, where drapes hardly depend on shear. The
            numbers below are out of the first `points`; the same shares of the stiff ones are draped in the same ways.
        effect_points: How many fabrics, counted from the first, are also draped with every effect.
        fine_points: How many are also draped under the base model's own law and mesh.
        finest_points: How many are also draped on a still finer mesh, if they are limp.
        fine_effect_points: How many are also draped with every effect under the base model's own law and mesh.
        law_points: How many are also draped under other laws.
        one_mesh_points: How many are also draped with all samples on one mesh.
        samples: Samples of each fabric, draped on both sides.
        vertices: Mesh size of the cheaper model, whose law is `paper`.
    """

    points: int = 512
    stiff_points: int = 128
    effect_points: int = 128
    fine_points: int = 96
    finest_points: int = 40
    fine_effect_points: int = 8
    law_points: int = 64
    one_mesh_points: int = 48
    samples: int = 4
    vertices: int = 480

    def theta(self) -> Float[ndarray, "points parameters"]:
        """The fabrics: first `points` of any stiffness in shear, then `stiff_points`."""
        from cusick_bench.diagnosis.atlas.base_model import HIGH, LOW, NAMES

        shear = NAMES.index("shear")
        middle_low, middle_high = LOW.copy(), HIGH.copy()
        middle_low[shear] = middle_high[shear] = _STIFF_IN_SHEAR
        return np.concatenate(
            [_spread(LOW, middle_high, self.points, SEED), _spread(middle_low, HIGH, self.stiff_points, SEED + 1)]
        )

    def has(self, point: int, count: int) -> bool:
        """Whether a fabric is among the first `count`, or among as large a share of the stiff ones.

        Args:
            point: Number of the fabric.
            count: Number of fabrics out of the first `points`.

        Returns:
            True if it is.
        """
        if point < self.points:
            return point < count
        return (point - self.points) * self.points < count * self.stiff_points

    def tasks(self) -> list[tuple[int, str]]:
        """Pairs (fabric, what to simulate of it); the first so many of them always make a smaller atlas."""
        effects = [name for name in registered() if name not in NOT_SIMULATED]
        limp = self.theta()[:, 0] < LIMP
        return [
            (point, name)
            for point in range(self.points + self.stiff_points)
            for name in (
                BASE,
                *([FINE] if self.has(point, self.fine_points) else ()),
                *([FINEST] if limp[point] and self.has(point, self.finest_points) else ()),
                *([LAWS] if self.has(point, self.law_points) else ()),
                *([ONE_MESH] if self.has(point, self.one_mesh_points) else ()),
                *(effects if self.has(point, self.effect_points) else ()),
                *(map(at_fine, effects) if self.has(point, self.fine_effect_points) else ()),
            )
        ]


def _spread(low: ndarray, high: ndarray, count: int, seed: int) -> Float[ndarray, "points parameters"]:
    """Scrambled Sobol points in a box."""
    from scipy.stats import qmc

    whole = 1 << max(0, (count - 1).bit_length())
    unit = qmc.Sobol(len(low), rng=np.random.default_rng(seed)).random(whole)[:count]
    return low + unit * (high - low)
