"""Softened membranes: the membrane stiffness is reduced where folds are narrow for the mesh.

A surface with finitely many control points cannot fold without being stretched a little. Woven cloth resists stretching
100,000 times as much as bending on the scale of a mesh, so that the energy of these strains, and not that of bending,
decides how far limp cloth hangs (membrane locking). Yet stretching itself hardly matters to a drape: cloth of 60 N/m
stretches by .2 % under its own weight. The membrane stiffness of the whole cloth is therefore multiplied by

    1 / (1 + Y h^2 / (RATIO B)),

with Y its stiffness, the mean of warp and weft at no strain [N/m], B its bending stiffness, the mean of all directions
and curvatures [N m], and h the spacing of vertices, of as many equilateral triangles. Its stiffness then tends to
RATIO B / h^2 on coarse meshes and to its own on fine ones, with the same limit as without.

RATIO was chosen with random cloths of the population (`cusick-bench mesh-error`): the remaining locking, which holds
cloth up, and the additional sag by the softer membrane then cancel on all meshes of 480 vertices or more.

References:
    Stolarski, Belytschko. Membrane locking and reduced integration for curved elements. Journal of Applied Mechanics
    49(1), 1982.
    Lyly, Stenberg, Vihinen. A stable bilinear element for the Reissner-Mindlin plate model. Computer Methods in Applied
    Mechanics and Engineering 110, 1993 (an energy that locks, scaled by t^2 / (t^2 + alpha h^2)).
"""

from dataclasses import replace

from jaxtyping import Float
from torch import Tensor

from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.mesh import Mesh

NUMERICS_VERSION = 1  # raised when softened cloth's numbers change: see runner/numerics.py

RATIO = 28_000.0
"""Membrane stiffness over B / h^2 that a mesh bends without much locking."""

_WARP, _WEFT = 0, 2  # columns of C
_LEAST_BENDING = 1e-9  # [N m], a hundredth of the limpest silk's; keeps the factor finite for impossible tables


def softening(material: Material, mesh: Mesh) -> Float[Tensor, ""]:
    """Factor on a cloth's membrane stiffness on a mesh.

    Args:
        material: The cloth.
        mesh: The mesh.

    Returns:
        The factor, in (0, 1], differentiable by the cloth's stiffness.
    """
    at_rest = _mean_table(material.stretch)[0]
    membrane = 2 * at_rest[[_WARP, _WEFT]].mean().clamp(min=0)  # the law doubles the table
    bending = _mean_table(material.bending).mean().clamp(min=_LEAST_BENDING)
    return 1 / (1 + membrane * mesh.squared_spacing / (RATIO * bending))


def _mean_table(tables: Float[Tensor, "*elements rows columns"]) -> Float[Tensor, "rows columns"]:
    """Mean over elements: of one table repeated, that table to the bit, as if it had been shared."""
    tables = tables.reshape(-1, *tables.shape[-2:])
    return tables[0] + (tables - tables[0]).mean(0)


def softened(material: Material, mesh: Mesh) -> Material:
    """A cloth as a mesh can bend it.

    Args:
        material: The cloth.
        mesh: The mesh.

    Returns:
        The cloth with its membrane softened.
    """
    return replace(material, stretch=material.stretch * softening(material, mesh))
