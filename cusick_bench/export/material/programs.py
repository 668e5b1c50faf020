"""The programs, by name, and the folder that is written for one of them."""

from __future__ import annotations

from pathlib import Path

from cusick_bench import __version__
from cusick_bench.export.errors import ExportError
from cusick_bench.export.material.blender import BLENDER
from cusick_bench.export.material.clo import CLO, MARVELOUS
from cusick_bench.export.material.fabric import FabricMaterial
from cusick_bench.export.material.newton import NEWTON
from cusick_bench.export.material.program import Program
from cusick_bench.export.written import fill, require_new, write_files

PROGRAMS: dict[str, Program] = {program.name: program for program in (BLENDER, NEWTON, MARVELOUS, CLO)}
"""Programs that materials are written for."""


def write_material(
    folder: Path,
    fabric: FabricMaterial,
    program: str,
    *,
    edge_length: float | None = None,
    command: str = "cusick-bench export material",
) -> list[Path]:
    """Writes a fabric's material for a program into a new folder.

    Args:
        folder: Where it is to be; made if it is not there.
        fabric: The fabric.
        program: One of `PROGRAMS`.
        edge_length: Edge length of the program's mesh [m], for programs whose values depend on it.
        command: What the README says it was written by.

    Returns:
        The files written.

    Raises:
        ExportError: The folder is not empty, an unknown program, or an edge length that is wrong or of no use.
    """
    if program not in PROGRAMS:
        raise ExportError(f"materials are written for {', '.join(PROGRAMS)}, got {program!r}")
    chosen = PROGRAMS[program]
    if edge_length is not None and not chosen.needs_edge_length:
        raise ExportError(f"an edge length is of no use for {chosen.title}; leave out --edge-length")
    if edge_length is not None and not 1e-5 <= edge_length <= 1:
        raise ExportError(f"the edge length must be 0.00001 to 1 m, got {edge_length}; give it in metres")
    require_new(folder, "a material")
    texts = dict(chosen.files(fabric, edge_length))
    texts["README.md"] = fill(
        "material/README.md", fabric=fabric, program=chosen, rows=_rows(fabric), curves=_curves(fabric),
        command=command, version=__version__,
    )  # fmt: skip
    return write_files({folder / name: text for name, text in texts.items()})


def _rows(fabric: FabricMaterial) -> list[tuple[str, str, str, str]]:
    """Quantity, value, interval and unit of every number, as words."""
    bending = [(f"bending, {name}", one, "N m") for name, one in fabric.bending.items()]
    stretch = [("shear" if name == "shear" else f"stretch, {name}", one, "N/m") for name, one in fabric.stretch.items()]
    means = [
        ("bending, geometric mean of warp, weft, bias, bias", fabric.mean_bending, "N m"),
        ("stretch, geometric mean of warp and weft", fabric.mean_stretch, "N/m"),
    ]
    return [
        (name, f"{one.value:.4g}", "{:.4g} to {:.4g}".format(*one.ci90) if one.ci90 else "none", unit)
        for name, one, unit in (*bending, *stretch, *means)
    ]


def _curves(fabric: FabricMaterial) -> list[tuple[str, str]]:
    return [(name, ", ".join(f"{value:.4g}" for value in values)) for name, values in fabric.curve.items()]
