"""`cusick-bench simulate`: one or many drapes of a cloth given by a few numbers."""

from __future__ import annotations

import itertools
import time
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.table import Table

from cusick_bench.cli.common import console, interruptible, output, print_json, user_errors
from cusick_bench.cli.options import (
    BENDING,
    DENSITY,
    LAW,
    MOST_DRAWS,
    CameraName,
    CameraOption,
    Clamp,
    Json,
    Law,
    LawName,
    Membrane,
    Mode,
    Seed,
    Shear,
    Steps,
    Stretch,
    VerticesByLaw,
    WithEffect,
    bending_stiffnesses,
    checked_density,
    clamp_by_law,
    cloth_option,
    membrane_asked,
    output_option,
    running_option,
    simulation_option,
    vertices_by_law,
)
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.simulate.seen_drape import Sight, drape_name, forget_drapes, write_drape
from cusick_bench.cli.written_paths import folder_made
from cusick_bench.sim.constants import (
    CLOTH_RADIUS,
    PLATE_RADIUS,
    VERTICES_OF_TRUTH,
)
from cusick_bench.sim.errors import CusickError

if TYPE_CHECKING:
    from cusick_bench.problem import Scene
    from cusick_bench.sim.cloth.material import Material
    from cusick_bench.sim.cloth.mesh import Mesh
    from cusick_bench.sim.drape import DrapeBatch, DrapeSimulator
    from cusick_bench.sim.effects import Cause


app = typer.Typer()

_MOST_ROWS = 40  # draws that the table shows one by one
_AT_REST = {True: "yes", False: "no", None: "?"}


@dataclass(frozen=True)
class Draws:
    """Random variants of one cloth; each draw depends on the seed and its number only.

    Attributes:
        simulator: How they are draped.
        cloth: Their mean.
        heterogeneity: Spread of log stiffness.
        seed: Seed of the first.
        causes: What the base model leaves out.
    """

    simulator: DrapeSimulator
    cloth: Material
    heterogeneity: float
    seed: int
    causes: tuple[Cause, ...] = ()

    def batches(self, count: int) -> Iterator[tuple[range, DrapeBatch]]:
        """Drapes `count` draws in batches of like size that fit the memory: their numbers, and they, on the CPU.

        With causes they are draped one by one, since a cause may be random and ask for a mesh of its own.
        """
        if self.causes:
            yield from self._caused(count)
            return
        batches = -(-count // self.simulator.at_once())
        ends = [round(count * part / batches) for part in range(batches + 1)]
        for first, end in itertools.pairwise(ends):
            yield range(first, end), self._batch(range(first, end))

    def _batch(self, numbers: range) -> DrapeBatch:
        import torch

        seeds = [self.seed + number for number in numbers]
        with ThreadPoolExecutor() as pool:  # a device would wait longer for a shape than it takes to drape it
            laid = np.stack(list(pool.map(self.simulator.laid_down, seeds)))
        batch = self.simulator.drape_batch(
            [self.material_of(number) for number in numbers],
            initial=torch.from_numpy(laid),
            rest_angle=torch.stack([self.simulator.rest_angles(seed) for seed in seeds]),
        )
        return replace(batch, vertices=batch.vertices.cpu())

    def scene(self, number: int) -> Scene:
        """A draw's causes, as in a later picture of it."""
        from cusick_bench.problem import Scene

        plain = self.simulator
        return Scene(self.causes, plain.mesh, plain.settings, capture=2, later=True, seed=self.seed + number)

    def reach(self, count: int) -> float:
        """How far from the plate's axis the flat cloths seem to reach [m]: under causes, what a picture has to show."""
        import torch

        scenes = (self.scene(number) for number in range(count if self.causes else 0))
        seen = (scene.seen(torch.from_numpy(scene.warped.flat)) for scene in scenes)
        return max((float(torch.linalg.norm(points[:, :2], dim=1).max()) for points in seen), default=0.0)

    def _caused(self, count: int) -> Iterator[tuple[range, DrapeBatch]]:
        import torch

        from cusick_bench.sim.setup import Simulators

        simulators = Simulators()
        for number in range(count):
            scene, seed = self.scene(number), self.seed + number
            simulator = simulators.get(scene.warped, scene.simulated)
            laid, rest = torch.from_numpy(simulator.laid_down(seed)), simulator.rest_angles(seed)
            yield range(number, number + 1), scene.drape(simulator, [self.material_of(number)], laid[None], rest[None])

    def material_of(self, number: int) -> Material:
        """The cloth of a draw.

        Args:
            number: Number of the draw, from 0.

        Returns:
            The cloth, uneven where a heterogeneity is asked for.
        """
        from cusick_bench.sim.cloth.heterogeneity import random_heterogeneity

        if self.heterogeneity == 0:
            return self.cloth  # its tables are shared by all elements and all draws
        generator = np.random.default_rng([self.seed, number, 2])
        return random_heterogeneity(self.cloth, self.simulator.mesh, self.heterogeneity, generator)


@app.command()
@user_errors
def simulate(
    density: Annotated[float, DENSITY],
    bending: Annotated[str, BENDING],
    stretch: Stretch = 300.0,
    shear: Shear = 60.0,
    poisson: Annotated[
        float, cloth_option(min=-0.99, max=0.99, help="Poisson's ratio of bending, of law plate.")
    ] = 0.0,
    heterogeneity: Annotated[
        float,
        cloth_option(min=0, max=3, help="Standard deviation of log stiffness over the cloth, a smooth field of 2 cm."),
    ] = 0.0,
    laying_height: Annotated[
        float,
        cloth_option(
            min=0,
            max=0.1,
            help="Standard deviation of the heights in which the cloth is laid down, which decide where it folds [m].",
        ),
    ] = 1e-3,
    rest_height: Annotated[
        float,
        cloth_option(min=0, max=0.1, help="Standard deviation of the rest shape's height [m]."),
    ] = 0.0,
    draws: Annotated[
        int,
        cloth_option(
            min=1, max=MOST_DRAWS, help="Number of drapes, each with its own random shapes; draped in batches."
        ),
    ] = 1,
    vertices: VerticesByLaw = None,
    mesh: Annotated[
        Path | None,
        simulation_option(help="Flat cloth mesh (OBJ) about the plate's axis, of any size, instead of a disc's."),
    ] = None,
    mode: Annotated[
        Mode | None,
        simulation_option(
            help="Fall from flat (drop, implicit Euler), or static balance (equilibrium, Newton); drop, or equilibrium "
            "with --self-contact.",
            show_default=False,
        ),
    ] = None,
    steps: Steps = 100,
    law: Law = LAW,
    clamp: Clamp = None,
    membrane: Membrane = None,
    camera: CameraOption = CameraName.parallel,
    self_contact: Annotated[
        float,
        simulation_option(help="Distance that folds keep from each other [m]; 0 for no contact."),
    ] = 0.0,
    with_effect: WithEffect = None,
    device: Annotated[
        str,
        running_option(help="cpu, cuda or cuda:N (mode drop, big batches), or cpu:torch (the GPU's code on the CPU)."),
    ] = "cpu",
    seed: Seed = 0,
    out: Annotated[Path | None, output_option(help="Folder for meshes, silhouettes and profiles.")] = None,
    as_json: Json = False,
) -> None:
    """Simulate drapes and print drape coefficient, folds and convergence.

    The bending stiffness is that of the cloth as a plate, whatever the law. Draws with effects are made one by one.
    """
    from cusick_bench.problem import parse_causes
    from cusick_bench.sim.cloth.material import PUBLISHED_BENDING_FACTOR, uniform_material
    from cusick_bench.sim.cloth.resolution import cloth_mesh
    from cusick_bench.sim.drape import DrapeSimulator
    from cusick_bench.sim.engine.settings import DrapeSettings

    rows, causes = bending_stiffnesses(bending), parse_causes(with_effect or ())
    if causes and device != "cpu":
        raise CusickError(f"effects are simulated on the CPU; leave out --device {device}, or --with-effect")
    if poisson and law is not LawName.plate:
        raise CusickError(
            f"--poisson is about law plate, and law {law.value} always bends with about -1/3; leave --poisson out, or "
            "take --law plate"
        )
    if any(cause.effect.name == "self-contact" for cause in causes) and (mode is Mode.drop or self_contact > 0):
        option = "--mode drop" if mode is Mode.drop else "--self-contact"
        raise CusickError(
            f"--with-effect self-contact lets the cloth come to rest, with a thickness of its own, got {option} as "
            "well; leave one of them out"
        )
    if mesh is not None and vertices is not None:
        raise CusickError("--vertices is about a disc that is meshed here; leave it out with --mesh")
    factor = PUBLISHED_BENDING_FACTOR if law is LawName.published else 1.0
    cloth = uniform_material(
        density=checked_density(density),
        bending=(factor * rows[0], factor * rows[1], factor * rows[2]),
        stretch=stretch,
        shear=shear,
        poisson=poisson,
    )
    name = law.value
    size = vertices_by_law(vertices, law, VERTICES_OF_TRUTH)
    sheet = cloth_mesh(name, size, seed=seed) if mesh is None else _read_mesh(mesh, name)
    settings = DrapeSettings(
        law=name,
        clamp=clamp_by_law(clamp, law),
        membrane=membrane_asked(membrane),
        mode=(mode or (Mode.equilibrium if self_contact > 0 else Mode.drop)).value,
        steps=steps,
        laying_amplitude=laying_height,
        rest_amplitude=rest_height,
        seed=seed,
        self_contact=self_contact,
    )
    drawn = Draws(DrapeSimulator(sheet, settings, device=device), cloth, heterogeneity, seed, causes)
    size_of_cloth, reach = (CLOTH_RADIUS, CLOTH_RADIUS) if mesh is None else _size_of(sheet)
    sight = Sight.of(camera, size_of_cloth, max(reach, drawn.reach(draws)))
    clock = time.perf_counter()
    with folder_made(out):
        results = _simulated(drawn, draws, sight, out)
    _report(
        results, as_json,
        {
            "vertices": sheet.vertices, "faces": len(sheet.faces), "out": out, "device": device,
            "wall_seconds": time.perf_counter() - clock,
        },
    )  # fmt: skip


def _read_mesh(path: Path, law: str) -> Mesh:
    """The user's own mesh, adapted to the law; it must cover the plate."""
    from cusick_bench.sim.cloth.obj import mesh_from_obj
    from cusick_bench.sim.cloth.resolution import fitted_to

    mesh = mesh_from_obj(path)
    nearest = float(np.hypot(*mesh.material[mesh.boundary].T).min())
    if nearest <= PLATE_RADIUS:
        raise CusickError(
            f"{path} must reach beyond the plate of {PLATE_RADIUS:g} m on all sides, but its rim comes as near as "
            f"{nearest:.3g} m to the plate's axis, x = y = 0; move the cloth's centre there, or take a larger cloth"
        )
    return fitted_to(law, mesh)


def _size_of(mesh: Mesh) -> tuple[float, float]:
    """Radius of a cloth, and how far it reaches from the plate's axis [m]."""
    from cusick_bench.sim.cloth.warp import cloth_circle

    return cloth_circle(mesh)[1], float(np.hypot(*mesh.material.T).max())


def _simulated(drawn: Draws, count: int, sight: Sight, out: Path | None) -> list[dict[str, Any]]:
    """Drapes all draws, writes what is to be written, and returns what the JSON document says of each."""
    results: list[dict[str, Any]] = []
    faces = drawn.simulator.mesh.faces
    with progress_bar("draping", count) as bar, interruptible(partial(_kept, out, results)):
        for numbers, batch in drawn.batches(count):
            if out is not None and not results:
                forget_drapes(out)  # now that the first are made: what is refused replaces nothing
            for place, number in enumerate(numbers):
                bar.advance()
                if batch.failures[place] is not None:
                    results.append({"draw": number, "converged": False, "failure": batch.failures[place]})
                    continue
                drape = batch.member(place)
                seen = drawn.scene(number).seen(drape.vertices) if drawn.causes else drape.vertices
                outcome = sight.outcome(drape, seen, faces)
                results.append({"draw": number, **outcome.summary()})
                if out is not None:
                    write_drape(out, drape_name(number), outcome, faces)
    return results


def _kept(out: Path | None, results: list[dict[str, Any]]) -> str:
    """What is written of drapes when the command is interrupted."""
    if out is None or not results:
        return "nothing was written"
    written = sum(1 for _ in out.glob("*_profile.csv"))  # the last file of a drape
    return f"{written} drapes are written to {out}"


def _report(results: list[dict[str, Any]], as_json: bool, extra: dict[str, Any]) -> None:
    """Prints the drapes; the document's own keys are those of a single drape, or means over the draws."""
    done = [result for result in results if "failure" not in result]
    _report_failures(results)
    if as_json:
        keys = ("drape_coefficient", "folds", "residual", "seconds")
        means = {key: float(np.mean([result[key] for result in done])) if done else None for key in keys}
        known = {result["converged"] for result in results}
        converged = None if None in known and False not in known else known == {True}
        print_json({**means, "converged": converged, "failed": len(results) - len(done), **extra, "draws": results})
    else:
        _print_table(results, done, extra)
    if not done:
        raise typer.Exit(1)


def _report_failures(results: list[dict[str, Any]]) -> None:
    """Says on standard error which draws diverged, and why; draws with the same reason together."""
    reasons: dict[str, list[int]] = defaultdict(list)
    for result in results:
        if "failure" in result:
            reasons[result["failure"]].append(result["draw"])
    if reasons:
        console.print(f"{sum(map(len, reasons.values()))} of {len(results)} draws diverged:")
    for reason, draws in reasons.items():
        console.print(f"draw {', '.join(map(str, draws))}: {reason}")


def _print_table(results: list[dict[str, Any]], done: list[dict[str, Any]], extra: dict[str, Any]) -> None:
    """The first draws one by one, and mean and standard deviation of all that have not diverged."""
    title = (
        f"{len(results)} drape(s) of {extra['vertices']} vertices, {extra['wall_seconds']:.1f} s on {extra['device']}"
    )
    table = Table(title=title)
    for name in ("draw", "drape coefficient", "folds", "at rest", "residual", "seconds"):
        table.add_column(name, justify="right")
    for r in results[:_MOST_ROWS]:
        if "failure" in r:
            table.add_row(str(r["draw"]), "-", "-", "failed", "-", "-")
            continue
        table.add_row(
            str(r["draw"]), f"{r['drape_coefficient']:.4f}", str(r["folds"]), _AT_REST[r["converged"]],
            f"{r['residual']:.1e}", f"{r['seconds']:.2f}",
        )  # fmt: skip
    if len(results) > _MOST_ROWS:
        table.add_row("…", *[""] * 5)
    if len(done) > 1:
        table.add_section()
        coefficient, folds = (np.array([r[key] for r in done]) for key in ("drape_coefficient", "folds"))
        spreads = (
            f"{coefficient.mean():.4f} ± {coefficient.std(ddof=1):.4f}", f"{folds.mean():.1f} ± {folds.std(ddof=1):.1f}"
        )  # fmt: skip
        known = [r["converged"] for r in done if r["converged"] is not None]
        rest = f"{100 * np.mean(known):.0f} %" if known else _AT_REST[None]
        table.add_row("mean ± sd", *spreads, rest, "", f"{np.mean([r['seconds'] for r in done]):.3f}")
    output.print(table)
