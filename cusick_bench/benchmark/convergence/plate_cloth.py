"""The cloth of the reference drapes: an isotropic plate under each material law.

Areal density 0.2 kg/m2, g = 9.8 m/s2; membrane energy 1/2 (K E11^2 + K E22^2 + K/2 (2 E12)^2) per area with
K = 300 N/m and Green's strain E.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from cusick_bench.sim.constants import CLOTH_RADIUS

if TYPE_CHECKING:
    from cusick_bench.sim.cloth.material import Material
    from cusick_bench.sim.constants import Law

DENSITY = 0.2  # [kg/m2]
GRAVITY = 9.8  # [m/s2]
STRETCH = 300.0  # [N/m]

FIXED_POISSON: Mapping[str, float] = {"paper": -1 / 3, "published": -1 / 3}
"""Poisson's ratio of the laws that bend at hinges, on equilateral triangles; the other laws have it as a parameter."""


def poisson_of(law: Law, asked: float) -> float:
    """Poisson's ratio with which a law bends.

    Args:
        law: Material law.
        asked: What it is to be.

    Returns:
        The same, or the law's own where that is fixed.
    """
    return FIXED_POISSON.get(law, asked)


def plate_cloth(ln_bending: float, poisson: float, law: Law) -> Material:
    """The cloth of a reference drape.

    Args:
        ln_bending: ln of bending stiffness over rho g R^3.
        poisson: Poisson's ratio; laws with a fixed one take no notice.
        law: Material law that it is for.

    Returns:
        The cloth, homogeneous and isotropic: the same plate under every law.
    """
    from cusick_bench.sim.cloth.material import PUBLISHED_BENDING_FACTOR, uniform_material

    stiffness = math.exp(ln_bending) * DENSITY * GRAVITY * CLOTH_RADIUS**3
    table = stiffness * (PUBLISHED_BENDING_FACTOR if law == "published" else 1.0)
    own: dict[str, float] = {} if law in FIXED_POISSON else {"poisson": poisson}
    return uniform_material(density=DENSITY, bending=table, stretch=STRETCH, shear=STRETCH / 2, **own)
