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
"""Limp ones of them on a still finer mesh, whose folds the base model's own mesh is too coarse for."""
LAWS = "other-laws"
"""The cheaper model again, with shorter steps, and membrane, bending curve and lengths that theta leaves open drawn at
random."""
ONE_MESH = "one-mesh"
"""The cheaper model again, all samples of a fabric on one mesh: what an asymmetry that they share does."""
FINEST_VERTICES = VERTICES_OF_PAPER
FINEST_SAMPLES = 2
LIMP = -7.0
"""theta's bending below which fabrics are draped on the finest mesh."""
NOT_SIMULATED = ("grain-skew", "density-bias", "self-contact")
"""Turned statistics, another weight, and drapes too costly for an atlas: see `emulator`."""
SEED = 71
"""Seed of the draws of fabrics, samples and effects."""
_STIFF_IN_SHEAR = 5.8  # of theta's shear


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
    """What an atlas is made of.

    Attributes:
        points: Fabrics.
        stiff_points: More of them that are stiff in shear, where little changes; of these the same shares as of the
            others have what follows.
        effect_points: How many of them, the first ones, have every effect too.
        fine_points: How many of them have drapes under the base model's own law and mesh.
        finest_points: How many of them have drapes on a still finer mesh, if they are limp.
        fine_effect_points: How many of them have every effect under the base model's own law and mesh.
        law_points: How many of them have drapes under other laws.
        one_mesh_points: How many of them have all samples on one mesh.
        samples: Samples of each, draped on both sides.
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
        """Whether a point is among the first `count`, or as large a share of the stiff ones.

        Args:
            point: Number of the fabric.
            count: Number of fabrics out of the first `points`.

        Returns:
            Whether it is.
        """
        if point < self.points:
            return point < count
        return (point - self.points) * self.points < count * self.stiff_points

    def tasks(self) -> list[tuple[int, str]]:
        """(point, what to simulate of it), in an order of which any beginning is a smaller atlas."""
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
