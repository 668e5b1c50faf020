"""Engineering values of a cloth's stiffness: one number for each direction, from the fitted tables.

Bending [N m]. The direction is that of the curvature: *warp* is the stiffness of a strip cut along the warp, whose
warp yarns bend. Hinges that lie along the weft measure it, row 2 of the table; row 0 is the weft, row 1 the bias. One
number is the geometric mean over the table's five curvatures, 0 to 40 /m. The value at rest alone says little about a
drape: in drapes of the five synthetic cloths (1205 vertices) three quarters of the bending energy lie beyond 26 to 68
/m. A silhouette determines the mean of the five values, but hardly their differences. A
Kawabata bending test reads 50 to 150 /m, where the laws keep the value of 40 /m, the last of `curve`. Law `published`
bends as if it had a quarter of its table, and that quarter is given. Law `plate` has D11 from the warp's row, D22 from
the weft's, and D33 from the bias' row; its bias here is D11 / 4 + D22 / 4 + D12 / 2 + D33, which is that row again
unless the row is too soft for a plate.

Stretch [N/m]. Force per width and unit strain along warp and weft, with the other direction's strain zero, and force
per width and unit shear angle, all at small strain (the table's sample at rest): a drape strains cloth by some tenths
of a per cent. The laws double the table's c11 and c22; shear energy 2 c33 G01^2 = c33 angle^2 / 2 gives c33.

Of tables per element the number is the geometric mean over the overhang (what lies on the plate does not bend),
weighted by area, and of hinges also by how much of the row they use. The spread beside it is the standard deviation of
the logarithm between elements, weighted alike.

References:
    Kawabata. The standardization and analysis of hand evaluation. Textile Machinery Society of Japan, 1980 (KES-FB2).
    Peirce. The "handle" of cloth as a measurable quantity. J. Textile Institute 21, 1930 (flexural rigidity, mg cm).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.constants import Law

if TYPE_CHECKING:
    from torch import Tensor


STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity [m/s2] (3rd CGPM, 1901; exact)."""

GRAM_FORCE = STANDARD_GRAVITY / 1000
"""1 gf [N]: a gram under the standard acceleration of gravity."""

GF_CM2_PER_CM = GRAM_FORCE * 1e-2
"""1 gf cm2/cm [N m]: moment gf cm for each cm of width, over curvature 1/cm, is gf cm = 9.80665e-5 N m."""

MG_CM = GF_CM2_PER_CM / 1000
"""1 mg cm [N m], the unit of Peirce's flexural rigidity (ISO 9073-7, ASTM D1388): a thousandth of a gf cm."""

BENDING_ROWS = {"warp": 2, "weft": 0, "bias": 1}
"""Row of the bending table for each direction of curvature."""

BENDING, STRETCH = ("warp", "weft", "bias"), ("warp", "weft", "shear")


@dataclass(frozen=True)
class ClothStiffness:
    """Stiffness of one cloth; arrays are in the order of `BENDING` and `STRETCH`.

    Attributes:
        bending: Bending stiffness of each direction [N m].
        stretch: Membrane stiffness along warp and weft and in shear [N/m].
        curve: Bending stiffness of each direction at curvatures of 0, 10, 20, 30 and 40 /m [N m].
        bending_spread: Standard deviation of log bending stiffness between elements; 0 for one table.
    """

    bending: Float[ndarray, " bending"]
    stretch: Float[ndarray, " stretch"]
    curve: Float[ndarray, "bending curvatures"]
    bending_spread: Float[ndarray, " bending"]


@dataclass(frozen=True)
class ElementWeights:
    """Weight of each element in the mean over a cloth.

    Attributes:
        hinges: Weight of each hinge for each direction of bending, in the order of `BENDING`.
        faces: Weight of each face.
    """

    hinges: Float[ndarray, "bending hinges"]
    faces: Float[ndarray, " faces"]


def element_weights(mesh: Mesh, plate_radius: float) -> ElementWeights:
    """Areas of the elements that overhang, those of hinges times the share of each row that they use.

    Args:
        mesh: The cloth.
        plate_radius: Radius of the plate [m].

    Returns:
        Weights that add up to 1 in each direction.

    Raises:
        ValueError: Nothing overhangs.
    """
    from cusick_bench.sim.cloth.heterogeneity import face_centres, hinge_centres
    from cusick_bench.sim.engine.triangles.elements import elements_of

    elements = elements_of(mesh)
    area = elements.hinge_weight / elements.hinge_scale**2  # (l^2 / A) / (l / A)^2
    low, fraction = elements.direction_low, elements.direction_fraction
    rows = np.stack([np.where(low == row, 1 - fraction, np.where(low + 1 == row, fraction, 0)) for row in range(3)])
    hinges = rows[list(BENDING_ROWS.values())] * area * _overhangs(hinge_centres(mesh), plate_radius)
    faces = elements.face_area * _overhangs(face_centres(mesh), plate_radius)
    if not (faces.any() and hinges.any(1).all()):
        raise ValueError(
            f"cloth must reach beyond a plate of {plate_radius:g} m; give the radius of the plate in metres"
        )
    return ElementWeights(hinges / hinges.sum(1, keepdims=True), faces / faces.sum())


def cloth_stiffness(
    stretch: Float[Tensor, "*faces 6 4"],
    bending: Float[Tensor, "*hinges 3 5"],
    law: str,
    weights: ElementWeights | None = None,
    poisson: float = 0.0,
) -> ClothStiffness:
    """The stiffness that a cloth's tables mean.

    Args:
        stretch: C, shared or per face [N/m].
        bending: B, shared or per hinge [N m].
        law: Material law that they are for; laws `plate` and `paper` read the same tables.
        weights: Weights of the elements, for tables per element.
        poisson: Poisson's ratio of bending, which law `plate` has.

    Returns:
        One number for each direction, and its spread between elements.

    Raises:
        ValueError: The tables are per element, and no weights are given; or an unknown law.
    """
    from cusick_bench.sim.cloth.material import PUBLISHED_BENDING_FACTOR
    from cusick_bench.sim.laws.plate import bias_stiffness

    if law not in get_args(Law):
        raise ValueError(f"law must be one of {', '.join(get_args(Law))}, got {law!r}")
    if weights is None and (stretch.ndim > 2 or bending.ndim > 2):
        raise ValueError("tables per element need the weights of the elements; see `element_weights`")
    factor = PUBLISHED_BENDING_FACTOR if law == "published" else 1.0
    tables = bending.detach().cpu().numpy()[..., list(BENDING_ROWS.values()), :] / factor
    if law == "plate":
        warp, weft, bias = np.moveaxis(tables, -2, 0)
        tables[..., BENDING.index("bias"), :] = bias_stiffness(warp, weft, bias, poisson)
    curves = np.log(tables)
    table = stretch.detach().cpu().numpy()[..., 0, :]  # at rest: c11, c12, c22, c33
    at_rest = np.log(np.stack([2 * table[..., 0], 2 * table[..., 2], table[..., 3]], -1))
    bending_spread = np.zeros(len(BENDING))
    if weights is not None and curves.ndim > 2:
        bending_spread = _spread(curves.mean(-1).T, weights.hinges)
        curves = np.einsum("dh,hdc->dc", weights.hinges, curves)
    if weights is not None and at_rest.ndim > 1:
        at_rest = weights.faces @ at_rest
    return ClothStiffness(np.exp(curves.mean(1)), np.exp(at_rest), np.exp(curves), bending_spread)


def bending_length(bending: Any, areal_density: Any) -> Any:
    """Peirce's bending length c = (B / (g w))^(1/3), which ISO 9073-7 calls so too: half the overhang of a strip.

    It is the length that a drape shows: cloths of one bending length drape alike, whatever they weigh.

    Args:
        bending: Bending stiffness B, a number or an array [N m].
        areal_density: Mass per area w, likewise [kg/m2].

    Returns:
        The length [m].

    References:
        Peirce. The "handle" of cloth as a measurable quantity. J. Textile Institute 21, 1930. ISO 9073-7, flexural
        rigidity = mass per area times the cube of the bending length.
    """
    return (bending / (STANDARD_GRAVITY * areal_density)) ** (1 / 3)


def _overhangs(centres: Float[ndarray, "elements 2"], plate_radius: float) -> ndarray:
    return np.hypot(*np.asarray(centres).T) > plate_radius


def _spread(logs: Float[ndarray, "numbers elements"], weights: Float[ndarray, "rows elements"]) -> ndarray:
    middle = (weights * logs).sum(1, keepdims=True)
    return np.sqrt((weights * (logs - middle) ** 2).sum(1))
