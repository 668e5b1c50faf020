"""`cusick-bench export material`: a fabric's stiffness for other cloth simulators."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cusick_bench.cli.common import command_line, print_json, tell, user_errors
from cusick_bench.cli.options import Json, cloth_option, output_option, simulation_option


class ProgramName(StrEnum):
    """Programs that materials are written for."""

    blender = "blender"
    newton = "newton"
    marvelous = "marvelous"
    clo = "clo"


@user_errors
def material(
    result: Annotated[Path, typer.Argument(help="A cell of a run, RUN/cells/KEY, or identify.json.", metavar="RESULT")],
    program: Annotated[ProgramName, output_option("--for", help="Program that it is for.", callback=None)],
    out: Annotated[Path, output_option(help="New folder for the material.")],
    fabric: Annotated[
        str | None, cloth_option(help="Fabric, where identify.json has several with a stiffness.")
    ] = None,
    density: Annotated[
        float | None, cloth_option(help="Areal density [kg/m2], by default the result's; stiffness is scaled alike.")
    ] = None,
    edge_length: Annotated[
        float | None, simulation_option(help="Edge length of the program's mesh [m]; for newton, by default 0.01.")
    ] = None,
    json: Json = False,
) -> None:
    """Write a fabric's stiffness for another cloth simulator: Blender, Newton, Marvelous Designer or CLO.

    Blender gets a script that sets the cloth modifier of the active object, Newton keyword arguments of add_cloth_mesh
    (solver VBD), Marvelous Designer and CLO a table of values to type in. A README says what carries over and what does
    not: most programs know neither direction nor curvature, and none an interval.
    """
    from cusick_bench.export.material import read_material, write_material

    found = read_material(result, fabric=fabric, density=density)
    files = write_material(out, found, program.value, edge_length=edge_length, command=command_line())
    tell(f"wrote {found.name} to {out}; its README.md says what carries over")
    if json:
        print_json({"path": out, "files": files, "fabric": found.name, "areal_density": found.density})
