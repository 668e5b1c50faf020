"""Options that several commands share, with the same name and the same words on every help page.

If all commands take an option with the same type, its annotation is defined here (`Json`). If the type differs, for
example because only some commands can do without the option, only its description is (`DENSITY`), and each command adds
the type. `cloth_option` and similar functions put an option into a panel of the help page.
"""

from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cusick_bench.cli.completion import complete_cloth, complete_data, complete_effect, complete_solver
from cusick_bench.cli.written_paths import outside_package
from cusick_bench.diagnosis.options import ONE_SAMPLE
from cusick_bench.sim.constants import (
    DEFAULT_LAW,
    HEAVIEST_CLOTH,
    LIGHTEST_CLOTH,
    VERTICES_OF_PAPER,
    VERTICES_OF_TRUTH,
    VERTICES_TO_FIT,
)
from cusick_bench.sim.errors import CusickError

if TYPE_CHECKING:
    from cusick_bench.sim.engine.settings import Clamp as ClampOfDrape
    from cusick_bench.sim.engine.settings import Membrane as MembraneOfDrape

cloth_option = partial(typer.Option, rich_help_panel="Cloth")
data_option = partial(typer.Option, rich_help_panel="Data")
simulation_option = partial(typer.Option, rich_help_panel="Simulation")
fit_option = partial(typer.Option, rich_help_panel="Fit")
running_option = partial(typer.Option, rich_help_panel="Running")
diagnosis_option = partial(typer.Option, rich_help_panel="Diagnosis")
output_option = partial(typer.Option, rich_help_panel="Output", callback=outside_package)


class Mode(StrEnum):
    """Ways to a drape."""

    drop = "drop"
    equilibrium = "equilibrium"


class LawName(StrEnum):
    """Material laws."""

    plate = "plate"
    paper = "paper"
    published = "published"


LAW = LawName(DEFAULT_LAW)
"""Material law where none is asked for."""


class ClampName(StrEnum):
    """How hinges on the plate's edge bend."""

    half = "half"
    whole = "whole"


class MembraneName(StrEnum):
    """Whether the membrane is as soft as the mesh needs."""

    softened = "softened"
    given = "given"


class CameraName(StrEnum):
    """Cameras."""

    parallel = "parallel"
    pinhole = "pinhole"


# Data
Data = Annotated[
    str,
    data_option(help="Name of a data set, see `datasets`, or a folder in its layout.", autocompletion=complete_data),
]
RunsData = Annotated[
    str | None,
    data_option(
        help="Data set of the run: name or folder; by default the run's own, or else the folder in CUSICK_DATA.",
        autocompletion=complete_data,
    ),
]
FabricsCsv = Annotated[
    Path | None,
    data_option(help="Table of areal densities; by default fabrics.csv beside the data."),
]
RunsFabricsCsv = Annotated[
    Path | None,
    data_option(help="Table of areal densities; by default the run's own."),
]
Cloths = Annotated[
    list[str] | None, data_option("--cloth", help="Cloth; repeatable; by default all.", autocompletion=complete_cloth)
]
FittedCloths = Annotated[
    list[str] | None,
    data_option(
        "--cloth",
        help="Cloth; repeatable; by default all, of the public release the paper's five.",
        autocompletion=complete_cloth,
    ),
]
RunFolder = Annotated[Path, typer.Argument(help="Results folder, as given to `run --out`.", metavar="RUN")]

Force = Annotated[
    bool,
    data_option("--force", help="Use silhouettes even if no cloth on its plate can look like that (see `data audit`)."),
]

MOST_VERTICES, MOST_STEPS, MOST_DRAWS, MOST_WORKERS = 100_000, 100_000, 100_000, 1024
"""Largest values of options: anything larger is probably a typing error, and would fill memory or run for weeks."""
MOST_SAMPLES, MOST_SEEDS, MOST_CASES = 1000, 10_000, 100_000
LARGEST_SEED = 2**63 - 1
LARGEST_FIRST_SEED = 10**18 - MOST_SEEDS  # tables read seeds of 18 digits at most
_BENDING_STIFFNESSES = (1e-10, 1.0)  # [N m], a thousandth of the limpest silk's and a thin board's

# Cloth
DENSITY = cloth_option(help="Areal density [kg/m2].")
BENDING = cloth_option(
    help="Bending stiffness [N m]: one number, or three for hinges at 0,45,90 degrees to the warp (weft,bias,warp)."
)
membrane_option = partial(cloth_option, min=1e-3, max=1e9)  # [N/m]
Stretch = Annotated[float, membrane_option(help="Membrane stiffness along warp and weft [N/m].")]
Shear = Annotated[float, membrane_option(help="Shear stiffness [N/m].")]

# Photographs
Weight = Annotated[
    list[str] | None,
    cloth_option(help="Weight with its unit (g/m2, oz/yd2): NUMBER=WEIGHT, or of all other fabrics; repeatable."),
]
Weights = Annotated[
    Path | None,
    cloth_option(help="Table fabric,weight,thickness; by default weights.csv beside the photographs, if it is there."),
]
PlateDiameter = Annotated[str, cloth_option(help="Diameter of the plate, with its unit (mm, cm, m, in).")]
ClothDiameter = Annotated[str, cloth_option(help="Diameter of the flat cloth, with its unit (mm, cm, m, in).")]
CaptureFaces = Annotated[
    str, cloth_option("--captures", help="Which face lies up in which capture.", metavar="NUMBER=up|down,...")
]
CameraHeight = Annotated[
    str | None,
    cloth_option(
        help="Height of the camera above the plate, measured, with its unit; not used where two or more pictures of "
        "the board held at angles give it."
    ),
]
PrintedRuler = Annotated[
    str, cloth_option(help="Length of the printed board's ruler of 150 mm, as you measure it, with its unit.")
]
ImageSize = Annotated[int, output_option(min=64, max=4096, help="Width of the silhouettes [px].")]

# Simulation
Vertices = Annotated[
    int,
    simulation_option(min=1, max=MOST_VERTICES, help="Vertices of the cloth's mesh, 60 or more."),
]
VerticesByLaw = Annotated[
    int | None,
    simulation_option(
        "--vertices",
        min=1,
        max=MOST_VERTICES,
        help=f"Vertices of the cloth's mesh, 60 or more; by default {VERTICES_OF_TRUTH} in `simulate` and "
        f"{VERTICES_TO_FIT} elsewhere under law plate, {VERTICES_OF_PAPER} under laws paper and published.",
        show_default=False,
    ),
]
VerticesList = Annotated[
    list[int] | None,
    simulation_option("--vertices", min=1, max=MOST_VERTICES, help="Vertices of a mesh; repeatable."),
]
DropMode = Annotated[
    Mode,
    simulation_option(help="Fall from flat (drop, implicit Euler), or static balance (equilibrium, Newton)."),
]
Steps = Annotated[int, simulation_option(min=1, max=MOST_STEPS, help="Steps of a drop, of 0.05 s.")]
Law = Annotated[
    LawName,
    simulation_option(
        help="Material law: plate (converges with the mesh), paper (hinges, as an energy) or published (of the paper's "
        "code)."
    ),
]
Clamp = Annotated[
    ClampName | None,
    simulation_option(
        help="Hinges on the plate's edge bend in their free half, or whole as in the published program (half as stiff "
        "there); half under law paper, whole under law published.",
        show_default=False,
    ),
]
Membrane = Annotated[
    MembraneName | None,
    simulation_option(
        help="Membrane of law plate: softened to what the mesh can bend (its default), so that limp cloth does not "
        "lock, or as given.",
        show_default=False,
    ),
]
CameraOption = Annotated[
    CameraName,
    simulation_option("--camera", help="Parallel as in the data, or pinhole as in the published scripts."),
]
WithEffect = Annotated[
    list[str] | None,
    simulation_option(
        metavar="NAME:param=value,...",
        help="Effect that the base model leaves out; repeatable; see `effects`.",
        autocompletion=complete_effect,
    ),
]

# Fit
Solvers = Annotated[
    list[str] | None,
    fit_option(
        "--solver", help="Solver, NAME or NAME,option=value; repeatable; see `solvers`.", autocompletion=complete_solver
    ),
]
Budget = Annotated[
    float,
    fit_option(min=1, max=1e9, help="Drapes that a cell (solver, cloth, seed) may spend; a gradient counts as two."),
]
Seeds = Annotated[int, fit_option(min=1, max=MOST_SEEDS, help="Number of seeds.")]
FirstSeed = Annotated[int, fit_option("--seed", min=0, max=LARGEST_FIRST_SEED, help="First seed.")]


def not_one(samples: int) -> int:
    """Checks how many samples are simulated; the callback of `SimulatedSamples`.

    Args:
        samples: Their number.

    Returns:
        The same.

    Raises:
        typer.BadParameter: A single one.
    """
    if samples == 1:
        raise typer.BadParameter(ONE_SAMPLE)
    return samples


# Diagnosis
DiagnosedData = Annotated[
    str,
    typer.Argument(
        help="Data set: name or folder; by default the release in CUSICK_DATA.",
        metavar="DATA",
        autocompletion=complete_data,
    ),
]
Atlas = Annotated[Path, diagnosis_option(help="Fitted atlas, from `atlas fit`.")]
WithoutEffect = Annotated[
    list[str] | None,
    diagnosis_option(
        help="Effect to leave out of the candidates; repeatable; see `effects`.", autocompletion=complete_effect
    ),
]
SimulatedSamples = Annotated[
    int,
    diagnosis_option(
        "--samples",
        min=0,
        max=MOST_SAMPLES,
        help="Simulated samples of each model, two or more; 0 leaves gap and closure out.",
        callback=not_one,
    ),
]
Cases = Annotated[Path, typer.Argument(help="Folder of the cases.", metavar="CASES")]
Labels = Annotated[Path, typer.Argument(help="labels.json of the same cases.", metavar="LABELS")]

# Results
By = Annotated[
    str, typer.Option(help="Metric to rank by, best first: test_mse, or in short `mse`, `train MSE`, `H`, ...")
]

# Running and output
Workers = Annotated[int, running_option(min=1, max=MOST_WORKERS, help="Processes.")]
Seed = Annotated[int, running_option(min=0, max=LARGEST_SEED, help="Seed of the random numbers of this command.")]
Json = Annotated[bool, output_option("--json", help="One JSON document on standard output.")]


def checked_density(density: float) -> float:
    """Makes sure that the value of `--density` is a cloth's.

    Args:
        density: Areal density [kg/m2].

    Returns:
        It.

    Raises:
        CusickError: It is no cloth's, or in another unit.
    """
    if not LIGHTEST_CLOTH <= density <= HEAVIEST_CLOTH:
        raise CusickError(
            f"areal density must be from {LIGHTEST_CLOTH} to {HEAVIEST_CLOTH} kg/m2, got {density:g}; give --density "
            "in kg/m2, not in g/m2"
        )
    return density


def checked_bending(stiffness: float) -> float:
    """Makes sure that a bending stiffness is a cloth's.

    Args:
        stiffness: Bending stiffness [N m].

    Returns:
        It.

    Raises:
        CusickError: It is no cloth's.
    """
    least, most = _BENDING_STIFFNESSES
    if not least <= stiffness <= most:
        raise CusickError(f"bending stiffness must be from {least:g} to {most:g} N m, got {stiffness:g}; see --bending")
    return stiffness


def bending_stiffnesses(text: str) -> tuple[float, float, float]:
    """Reads the value of `--bending`.

    Args:
        text: One number for all directions, or three joined by commas.

    Returns:
        Bending stiffness at 0, 45 and 90 degrees from the warp [N m].

    Raises:
        CusickError: It is neither, or no cloth's.
    """
    try:
        rows = [float(word) for word in text.split(",")]
    except ValueError as error:
        raise CusickError(f"--bending takes one number or three joined by commas [N m], got {text!r}") from error
    if len(rows) not in (1, 3):
        raise CusickError(f"--bending takes one number or three (0, 45, 90 degrees), got {len(rows)}")
    rows = [checked_bending(row) for row in rows]
    return (rows[0], rows[0], rows[0]) if len(rows) == 1 else (rows[0], rows[1], rows[2])


def vertices_by_law(asked: int | None, law: LawName, of_plate: int) -> int:
    """Vertices of the cloth's mesh.

    Args:
        asked: What the user asked for, if anything.
        law: Material law.
        of_plate: What law `plate` gets for this purpose; the other laws get the paper's number.

    Returns:
        The number.
    """
    if asked is not None:
        return asked
    return of_plate if law is LawName.plate else VERTICES_OF_PAPER


def clamp_by_law(asked: ClampName | None, law: LawName) -> "ClampOfDrape | None":
    """How hinges on the plate's edge bend.

    Args:
        asked: What the user asked for, if anything.
        law: Material law.

    Returns:
        The clamp for `DrapeSettings`.

    Raises:
        CusickError: Law `plate` has no hinges.
    """
    if asked is None:
        return None
    if law is LawName.plate:
        raise CusickError(
            f"--clamp {asked.value} is about the hinges of law paper, and law plate has none; leave --clamp out, or "
            "add --law paper"
        )
    return asked.value


def membrane_asked(asked: MembraneName | None) -> "MembraneOfDrape | None":
    """The membrane for `DrapeSettings`, which refuses a softened one under another law than `plate`.

    Args:
        asked: What the user asked for, if anything.

    Returns:
        The same as `DrapeSettings` has it.
    """
    return None if asked is None else asked.value
