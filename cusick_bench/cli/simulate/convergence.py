"""`cusick-bench convergence`: how far drapes depend on the mesh and the time step, and how fast they converge."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cusick_bench.cli.common import print_json, tell, user_errors
from cusick_bench.cli.options import (
    MOST_DRAWS,
    MOST_STEPS,
    Clamp,
    Json,
    Law,
    LawName,
    Membrane,
    Seed,
    VerticesList,
    checked_bending,
    checked_density,
    clamp_by_law,
    cloth_option,
    membrane_asked,
    output_option,
    simulation_option,
)
from cusick_bench.cli.progress import Bar, progress_bar
from cusick_bench.cli.simulate.convergence_tables import (
    print_changes,
    print_meshes,
    print_orders,
    print_plate,
    print_reference,
    print_time_step,
)
from cusick_bench.cli.written_paths import room_for_picture
from cusick_bench.sim.errors import CusickError

if TYPE_CHECKING:
    from cusick_bench.benchmark.convergence.linear_plate import LinearPlate
    from cusick_bench.benchmark.convergence.mesh_dependence import MeshRow, Statistics
    from cusick_bench.benchmark.convergence.reference import PlateComparison
    from cusick_bench.benchmark.convergence.time_step import TimeStep
    from cusick_bench.report.figures.convergence import Panel
    from cusick_bench.sim.constants import Law as LawOfDrape
    from cusick_bench.sim.engine.settings import Clamp as ClampOfDrape
    from cusick_bench.sim.engine.settings import Membrane as MembraneOfDrape

app = typer.Typer()

_SIZES, _REFERENCE_SIZES = (297, 1205, 2699, 7496), (297, 1205, 2699)
_SHARES = (4, 2, 1)  # parts of a drop after which it is compared with its rest
_TIME_SIZE = 1205  # the time step is studied on the mesh whose size is nearest to this
_MOST_HALVINGS = 8
_DENSITY, _BENDING = 0.192, 1.4e-5  # of the cloth where none is given [kg/m2, N m]
_DRAWS, _STEPS, _HALVINGS = 8, 200, 1  # of its study where none are given
_MOST_MESHES = 1000


@dataclass(frozen=True)
class _Common:
    """Settings that both studies share."""

    law: LawOfDrape
    clamp: ClampOfDrape | None
    membrane: MembraneOfDrape | None
    meshes: int
    jitter: float
    seed: int

    def document(self) -> dict[str, Any]:
        """Its part of the JSON document."""
        shared = {"law": self.law, "clamp": self.clamp, "membrane": self.membrane}
        return {**shared, "meshes_per_size": self.meshes, "jitter": self.jitter, "seed": self.seed}


@dataclass(frozen=True)
class _Study:
    """Settings for the study of one cloth on several meshes."""

    sizes: Sequence[int]
    cloth: Mapping[str, float]
    draws: int
    steps: Sequence[int]
    halvings: int


@dataclass(frozen=True)
class _Drapes:
    """What is simulated for a study: statistics by mesh size, a row for each size, the stiff plate, the time steps."""

    statistics: dict[int, Statistics]
    rows: list[MeshRow]
    plate: LinearPlate
    time: TimeStep


@app.command()
@user_errors
def convergence(
    vertices: VerticesList = None,
    reference: Annotated[
        Path | None,
        simulation_option(help="Table of reference drapes of an ideal plate: simulate its rows, and compare."),
    ] = None,
    law: Law = LawName.paper,
    clamp: Clamp = None,
    membrane: Membrane = None,
    density: Annotated[
        float | None, cloth_option(help=f"Areal density [kg/m2], by default {_DENSITY:g}; not with --reference.")
    ] = None,
    bending: Annotated[
        float | None, cloth_option(help=f"Bending stiffness [N m], by default {_BENDING:g}; not with --reference.")
    ] = None,
    draws: Annotated[
        int | None,
        simulation_option(
            min=2,
            max=MOST_DRAWS,
            help=f"Drapes per size, each with its own mesh and laying, by default {_DRAWS}; not with --reference.",
        ),
    ] = None,
    meshes: Annotated[
        int,
        simulation_option(
            min=1, max=_MOST_MESHES, help="Meshes of one size for a drape laid down in one way; 1 tells no spread."
        ),
    ] = 1,
    jitter: Annotated[
        float,
        simulation_option(
            min=0, max=0.4, help="Share of the spacing by which interior vertices are moved: irregular meshes."
        ),
    ] = 0.0,
    steps: Annotated[
        int | None,
        simulation_option(
            min=1, max=MOST_STEPS, help=f"Steps of a drop, of 0.05 s, by default {_STEPS}; not with --reference."
        ),
    ] = None,
    halvings: Annotated[
        int | None,
        simulation_option(
            min=0,
            max=_MOST_HALVINGS,
            help=f"How often the time step is halved, by default {_HALVINGS}; not with --reference.",
        ),
    ] = None,
    picture: Annotated[
        Path | None, output_option(help="PNG to write: drape coefficient, folds and errors over the vertices.")
    ] = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Drape one cloth on meshes of several sizes and with shorter time steps, and measure how much drapes change.

    Without --vertices the meshes have 297, 1205, 2699 and 7496, which takes some minutes on two cores. With --reference
    the rows of the table are simulated instead, by default on 297, 1205 and 2699, each on --meshes meshes. Drops are
    compared with their rests after a quarter, a half and all of --steps.
    """
    from cusick_bench.sim.engine.settings import DrapeSettings

    if reference is not None:
        of_study = {"--density": density, "--bending": bending, "--draws": draws, "--steps": steps}
        _require_none(of_study | {"--halvings": halvings})
    asked: dict[str, Any] = {"clamp": clamp_by_law(clamp, law), "membrane": membrane_asked(membrane)}
    resting = DrapeSettings(law=law.value, mode="equilibrium", **asked)  # or refuses the law
    hinges: ClampOfDrape = "half" if resting.half_hinges else "whole"
    used: MembraneOfDrape = "softened" if resting.softens_membrane else "given"
    common = _Common(law.value, None if resting.law == "plate" else hinges, used, meshes, jitter, seed)
    with room_for_picture(picture):
        if reference is not None:
            sizes = sorted(set(vertices or _REFERENCE_SIZES))
            document, panels = _study_reference(reference, sizes, common, show=not as_json)
            title = f"law {law.value} against {reference.name}"
        else:
            sizes = sorted(set(vertices or _SIZES))
            study = _study_of(sizes, density, bending, draws, steps, halvings)
            document, panels = _study_meshes(study, common, show=not as_json)
            cloth = study.cloth
            title = f"law {law.value}, {cloth['density']:g} kg/m2, {cloth['bending']:g} N m, {study.draws} drapes each"
    if picture is not None:
        from cusick_bench.report.figures.convergence import save_convergence

        save_convergence(picture, title, panels)
        tell(f"wrote {picture}")
    if as_json:
        print_json(document)


def _require_none(options: Mapping[str, object]) -> None:
    """Refuses options of the study of one cloth beside a table of reference drapes."""
    for name, value in options.items():
        if value is not None:
            raise CusickError(
                f"{name} is about the study of one cloth, and --reference takes its drapes from the table; leave out "
                "one of the two"
            )


def _study_of(
    sizes: Sequence[int],
    density: float | None,
    bending: float | None,
    draws: int | None,
    steps: int | None,
    halvings: int | None,
) -> _Study:
    """The study that the options ask for; None is the usual value of each."""
    cloth = {
        "density": checked_density(_DENSITY if density is None else density),
        "bending": checked_bending(_BENDING if bending is None else bending),
    }
    asked = _STEPS if steps is None else steps
    return _Study(
        sizes,
        cloth,
        _DRAWS if draws is None else draws,
        sorted({max(asked // share, 1) for share in _SHARES}),
        _HALVINGS if halvings is None else halvings,
    )


def _study_reference(
    reference: Path, sizes: Sequence[int], common: _Common, *, show: bool
) -> tuple[dict[str, Any], list[Panel]]:
    """Simulates the rows of a table of reference drapes."""
    from cusick_bench.benchmark.convergence.reference import compare_with_reference, reference_orders
    from cusick_bench.datasets.files.plate_drapes import read_plate_drapes
    from cusick_bench.report.figures.convergence import reference_panels

    drapes = read_plate_drapes(reference)
    found: list[PlateComparison] = []
    with progress_bar("draping", sum(sizes) * len(drapes) * common.meshes) as bar:
        for size in sizes:
            bar.say(f"{size} vertices")
            found += compare_with_reference(
                drapes, [size], common.law, clamp=common.clamp, membrane=common.membrane, meshes=common.meshes,
                jitter=common.jitter, seed=common.seed, done=_weighed(bar, size),
            )  # fmt: skip
    orders = reference_orders(found)
    if show:
        print_reference(found, common.law, common.meshes)
        if len(sizes) > 1:
            print_orders(orders)
    document = {
        **common.document(),
        "reference_file": str(reference),
        "reference": [asdict(one) for one in found],
        "orders": [asdict(one) for one in orders],
    }
    return document, reference_panels(found)


def _study_meshes(study: _Study, common: _Common, *, show: bool) -> tuple[dict[str, Any], list[Panel]]:
    """Drapes one cloth on meshes of several sizes and with several time steps, and a stiff plate beside it."""
    import numpy as np

    from cusick_bench.benchmark.convergence.mesh_dependence import NAMES, mesh_changes
    from cusick_bench.benchmark.convergence.order import extrapolated_limit
    from cusick_bench.report.figures.convergence import mesh_panels

    made = _drape(study, common)
    coefficients = np.column_stack([made.statistics[size][:, NAMES.index("area_dc")] for size in study.sizes])
    limit = extrapolated_limit(study.sizes, coefficients, seed=common.seed)
    changes = mesh_changes(made.statistics)
    if show:
        print_meshes(made.rows, study.draws, study.cloth, limit)
        print_plate(made.plate)
        print_changes(changes)
        print_time_step(made.time)
    document = {
        **common.document(),
        **study.cloth,
        "draws": study.draws,
        "meshes": [asdict(row) for row in made.rows],
        "limit": None if limit is None else asdict(limit),
        "linear_plate": asdict(made.plate),
        "statistics": [asdict(change) for change in changes],
        "time_step": asdict(made.time),
    }
    return document, mesh_panels(made.rows, limit, made.plate)


def _drape(study: _Study, common: _Common) -> _Drapes:
    """Makes all drapes of a study, with progress."""
    import numpy as np

    from cusick_bench.benchmark.convergence.linear_plate import linear_plate
    from cusick_bench.benchmark.convergence.mesh_dependence import draw_statistics, mesh_row, mesh_spread
    from cusick_bench.benchmark.convergence.time_step import drapes_of_time_step, time_step
    from cusick_bench.sim.cloth.material import uniform_material
    from cusick_bench.sim.engine.settings import DrapeSettings

    sizes, draws = study.sizes, study.draws
    material = uniform_material(density=study.cloth["density"], bending=study.cloth["bending"])
    settings = DrapeSettings(law=common.law, clamp=common.clamp, membrane=common.membrane)
    spread = common.meshes if common.meshes > 1 else 0
    time_size = min(sizes, key=lambda size: abs(np.log(size / _TIME_SIZE)))
    timed = drapes_of_time_step(draws, study.steps, study.halvings)
    moved: dict[str, Any] = {"jitter": common.jitter, "seed": common.seed}
    by_size, rows = {}, []
    with progress_bar("draping", sum(sizes) * (draws + spread + common.meshes) + timed * time_size) as bar:
        for size in sizes:
            bar.say(f"{size} vertices")
            done = _weighed(bar, size)
            by_size[size] = draw_statistics(size, draws, material, settings, done=done, **moved)
            row = mesh_row(size, by_size[size])
            if spread:
                row = replace(row, mesh_sd_points=mesh_spread(size, spread, material, settings, done=done, **moved))
            rows.append(row)
        bar.say("linear plate")
        plate = linear_plate(
            sizes, common.law, clamp=common.clamp, meshes=common.meshes,
            done=_weighed(bar, sum(sizes) / len(sizes)), **moved,
        )  # fmt: skip
        bar.say("time step")
        time = time_step(
            time_size, draws, material, settings, steps=study.steps, halvings=study.halvings,
            done=_weighed(bar, time_size), **moved,
        )  # fmt: skip
    return _Drapes(by_size, rows, plate, time)


def _weighed(bar: Bar, weight: float) -> Callable[[int], None]:
    """Drapes as progress: a large mesh counts as more work."""
    return lambda drapes: bar.advance(weight * drapes)
