"""Whether a drape still lies on the branch of equilibria that it started from.

A cloth has many equilibria. If parameters change a little, an equilibrium usually moves a little; but a branch can end,
and the cloth then snaps to another one, with another number of folds. Neither the gradient nor the residual shows that.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.cloth.folds import FOLD_PROMINENCE, ring_folds
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.constants import CLOTH_RADIUS


@dataclass(frozen=True)
class Branch:
    """Folds of the rim where a drape was followed from, and where it came to.

    Attributes:
        folds_before: Folds of the warm start.
        folds_after: Folds of the drape.
        moved: Largest way of a vertex [m].
    """

    folds_before: int
    folds_after: int
    moved: float

    @property
    def changed(self) -> bool:
        """Whether folds came or went: the drape has left its branch."""
        return self.folds_before != self.folds_after


@lru_cache(maxsize=8)
def _rim(mesh: Mesh) -> tuple[Int[ndarray, "rim"], Float[ndarray, "rim"]]:
    """Vertices on the rim, by their angle in the material, and these angles [rad]."""
    edges = np.sort(np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    rim = np.unique(unique[count == 1])
    angle = np.arctan2(*mesh.material[rim].T[::-1])
    order = np.argsort(angle)
    return rim[order], angle[order]


def rim_folds(mesh: Mesh, x: Float[ndarray, "vertices 3"]) -> int:
    """Number of folds: peaks of the rim's radius over the material angle, as `ring_folds` counts them.

    A peak stands out in proportion to the cloth's radius.

    Args:
        mesh: The cloth, a disc.
        x: Its positions [m].

    Returns:
        The number.
    """
    rim, angle = _rim(mesh)
    radius = np.interp(
        np.linspace(-np.pi, np.pi, 256, endpoint=False), angle, np.hypot(*x[rim, :2].T), period=2 * np.pi
    )
    size = float(np.hypot(*mesh.material[rim].T).max()) / CLOTH_RADIUS
    return ring_folds(radius, prominence=FOLD_PROMINENCE * size)


def follow(mesh: Mesh, before: Float[ndarray, "vertices 3"], after: Float[ndarray, "vertices 3"]) -> Branch:
    """Compares a drape with the one that it was followed from.

    Args:
        mesh: The cloth.
        before: Positions of the warm start [m].
        after: Positions of the drape [m].

    Returns:
        Folds before and after, and how far the cloth moved.
    """
    moved = float(np.linalg.norm(after - before, axis=1).max())
    return Branch(rim_folds(mesh, before), rim_folds(mesh, after), moved)
