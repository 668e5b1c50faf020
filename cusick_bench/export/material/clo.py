"""Marvelous Designer and CLO: a table of the values to type into the fabric's physical properties.

Both are programs of one maker with the same solver; their file formats are closed. Units are those that secondary
sources state, g mm2/s2 for bending and g/s2 for stretch and shear; the maker documents none, so they are not verified:

    1 N m = 1 kg m2/s2 = 1e3 g 1e6 mm2 / s2 = 1e9 g mm2/s2
    1 N/m = 1 kg/s2 = 1e3 g/s2
    1 kg/m2 = 1e3 g/m2

References:
    None of the maker. Names with these units (`bending_warp_g_mm2_s2`, `stretch_warp_g_s2`, `shear_g_s2`) stand in
    programs of third parties that set a fabric's properties.
"""

from __future__ import annotations

from collections.abc import Callable

from cusick_bench.export.material.fabric import FabricMaterial
from cusick_bench.export.material.program import Program
from cusick_bench.export.written import fill
from cusick_bench.metrics.found_stiffness import Quantity

BENDING_FACTOR = 1e9
"""g mm2/s2 in 1 N m."""

STRETCH_FACTOR = 1e3
"""g/s2 in 1 N/m."""

DENSITY_FACTOR = 1e3
"""g/m2 in 1 kg/m2."""


def table_rows(fabric: FabricMaterial) -> list[tuple[str, Quantity, str]]:
    """Values to type in.

    Args:
        fabric: The fabric.

    Returns:
        Name, value and unit of each field.
    """
    bending = [
        (f"Bending - {name.capitalize()}", one.times(BENDING_FACTOR), "g mm2/s2")
        for name, one in fabric.bending.items()
    ]
    stretch = [
        ("Shear" if name == "shear" else f"Stretch - {name.capitalize()}", one.times(STRETCH_FACTOR), "g/s2")
        for name, one in fabric.stretch.items()
    ]
    return [*stretch, *bending, ("Density", Quantity(DENSITY_FACTOR * fabric.density), "g/m2")]


def _cells(name: str, one: Quantity, unit: str) -> tuple[str, ...]:
    low, high = (f"{end:.6g}" for end in one.ci90) if one.ci90 else ("", "")
    return name, f"{one.value:.6g}", low, high, unit


def _files(program: str, stem: str) -> Callable[[FabricMaterial, float | None], dict[str, str]]:
    def files(fabric: FabricMaterial, edge_length: float | None) -> dict[str, str]:
        cells = [_cells(*row) for row in table_rows(fabric)]
        lines = ["property,value,low,high,unit", *(",".join(row) for row in cells)]
        return {
            f"{stem}.csv": "\n".join(lines) + "\n",
            f"{stem}.md": fill("material/table.md", fabric=fabric, program=program, rows=cells),
        }

    return files


def _program(name: str, title: str) -> Program:
    return Program(
        name=name,
        title=title,
        files=_files(title, name),
        use=f"Type the values of `{name}.md` (the same as `{name}.csv`) into the fabric's physical properties. Where "
        "the program shows a scale of 0 to 100 instead of values, they cannot be typed in directly.",
        kept=(
            "Bending stiffness of warp, weft and bias.",
            "Stretch of warp and weft, shear, and areal density.",
        ),
        lost=(
            "Certainty of the units: they are those of secondary sources and unverified, since the maker documents "
            "none. Ratios between cloths are right whatever the units.",
            "Dependence of bending stiffness on curvature: the programs have fields of their own for large curvature "
            "(buckling ratio and stiffness), which are not set.",
            "Separate shear of the two diagonals, which newer versions ask for: a fit has one for both.",
            "Friction, thickness and damping, which a drape at rest does not show.",
        ),
        source="Units stated by secondary sources, unverified; nothing was simulated in the program.",
    )


MARVELOUS = _program("marvelous", "Marvelous Designer")
"""Marvelous Designer."""

CLO = _program("clo", "CLO")
"""CLO."""
