"""The cut's mark does not point along the warp."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from cusick_bench.sim.setup import Setup


@lru_cache(maxsize=16)
def skewed(mesh: Mesh, degrees: float) -> Mesh:
    """The same cloth with its warp turned counter-clockwise from +x; equal arguments give one mesh.

    Args:
        mesh: The cloth.
        degrees: Angle of the warp.

    Returns:
        The mesh with its material axes turned.
    """
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    u, v = mesh.corners[..., 0], mesh.corners[..., 1]
    return Mesh(mesh.material, mesh.faces, np.stack([cosine * u + sine * v, cosine * v - sine * u], axis=-1))


class GrainSkew(Effect):
    """Warp and weft turned from the mark by which the cloth is laid down and photographed."""

    name = "grain-skew"
    kind = "material"
    summary = "the warp does not lie along the mark"
    physics = "Stretch and bending tables are read in a frame turned by the angle; outline and laying stay."
    reference = "ASTM D3882, Standard test method for bow and skew in woven and knitted fabrics."
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "angle", "deg", -45.0, 45.0, 2.0, "skew and bow of woven cloth 1 to 3 degrees: the middle",
            summary="of the warp, counter-clockwise from the mark",
        ),
    )  # fmt: skip

    def _apply(self, setup: Setup, value: Values) -> Setup:
        return replace(setup, mesh=skewed(setup.mesh, float(value["angle"])))
