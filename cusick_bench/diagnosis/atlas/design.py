"""What an atlas is made of: which fabrics, which of them with which effects, and on which mesh."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.effects import registered
from cusick_bench.sim.engine.settings import Clamp

BASE = "base"
FINE = "fine-mesh"
"""The base model again, on a finer mesh with shorter steps: what a simulator's own errors do to the statistics."""
LAWS = "other-laws"
"""The base model again, with membrane, bending curve and lengths that theta leaves open drawn at random."""
ONE_MESH = "one-mesh"
"""The base model again, all samples of a fabric on one mesh: what an asymmetry that they share does, be it a mesh's."""
FINE_VERTICES = 1205
NOT_SIMULATED = ("grain-skew", "density-bias", "self-contact")
"""Turned statistics, another weight, and drapes too costly for an atlas: see `emulator`."""
SEED = 71
"""Of fabrics, samples and effects."""
_STIFF_IN_SHEAR = 5.8  # of theta's shear


@dataclass(frozen=True)
class Design:
    """What an atlas is made of.

    Attributes:
        points: Fabrics.
        stiff_points: More of them that are stiff in shear, where little changes; of these the same shares as of the
            others have what follows.
        effect_points: How many of them, the first ones, have every effect too.
        fine_points: How many of them have drapes on a finer mesh.
        law_points: How many of them have drapes under other laws.
        one_mesh_points: How many of them have all samples on one mesh.
        samples: Samples of each, draped on both sides.
        vertices: Mesh size.
        clamp: How hinges on the plate's edge bend (see `DrapeSettings`).
    """

    points: int = 320
    stiff_points: int = 80
    effect_points: int = 160
    fine_points: int = 100
    law_points: int = 80
    one_mesh_points: int = 80
    samples: int = 4
    vertices: int = 480
    clamp: Clamp = "half"

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
        """(point, effect) to simulate, in an order of which any beginning is a smaller atlas."""
        effects = [name for name in registered() if name not in NOT_SIMULATED]
        return [
            (point, name)
            for point in range(self.points + self.stiff_points)
            for name in (
                BASE,
                *([FINE] if self.has(point, self.fine_points) else ()),
                *([LAWS] if self.has(point, self.law_points) else ()),
                *([ONE_MESH] if self.has(point, self.one_mesh_points) else ()),
                *(effects if self.has(point, self.effect_points) else ()),
            )
        ]


def _spread(low: ndarray, high: ndarray, count: int, seed: int) -> Float[ndarray, "points parameters"]:
    """Scrambled Sobol points in a box."""
    from scipy.stats import qmc

    whole = 1 << max(0, (count - 1).bit_length())
    unit = qmc.Sobol(len(low), rng=np.random.default_rng(seed)).random(whole)[:count]
    return low + unit * (high - low)
