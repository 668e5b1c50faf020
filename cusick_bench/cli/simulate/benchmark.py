"""`cusick-bench benchmark`: speed, memory, scaling and gradient accuracy of the simulator, in one run."""

from collections.abc import Collection
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from cusick_bench.cli.common import command_line, interruptible, output, print_json, tell, user_errors
from cusick_bench.cli.options import (
    MOST_STEPS,
    MOST_VERTICES,
    Json,
    Law,
    LawName,
    VerticesList,
    output_option,
    simulation_option,
)
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.written_paths import folder_made
from cusick_bench.files.json_text import json_text
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.errors import CusickError

if TYPE_CHECKING:
    from cusick_bench.benchmark.plan import Plan


app = typer.Typer()

# Options of the whole benchmark that a part of it has no use for.
_NOT_OF_DEVICE = ("reference", "reference_vertices", "reference_steps", "gradient_vertices")
_NOT_OF_RUNNER = ("vertices", "full", "rounds", "batch", "springs", "law", "device", "device_only", *_NOT_OF_DEVICE)


@app.command()
@user_errors
def benchmark(
    context: typer.Context,
    vertices: VerticesList = None,
    full: Annotated[
        bool, simulation_option("--full", help="Also large meshes and batches, and more rounds: a quarter of an hour.")
    ] = False,
    rounds: Annotated[
        int | None,
        simulation_option(min=1, max=1000, help="Times of each case, taken in turn: by default 3, in full 5."),
    ] = None,
    batch: Annotated[
        list[int] | None, simulation_option(min=1, max=4096, help="Members of a batch; repeatable.")
    ] = None,
    springs: Annotated[
        bool, simulation_option(help="Hold the plate by springs, as published, instead of fixing it.")
    ] = False,
    law: Law = LawName.paper,
    reference: Annotated[
        Path | None,
        simulation_option(help="Table of reference drapes: also time laws plate and paper at equal error against it."),
    ] = None,
    reference_vertices: Annotated[
        list[int] | None, simulation_option(min=60, max=MOST_VERTICES, help="Mesh size tried for it; repeatable.")
    ] = None,
    reference_steps: Annotated[
        int, simulation_option(min=1, max=MOST_STEPS, help="Steps compared with plain autograd.")
    ] = 10,
    gradient_vertices: Annotated[
        int, simulation_option(min=60, max=MOST_VERTICES, help="Mesh size of the gradient check.")
    ] = 1205,
    device: Annotated[
        str | None,
        simulation_option(help="Also measure the torch engine on cuda, cuda:N, or cpu:torch (its code on the CPU)."),
    ] = None,
    device_only: Annotated[
        bool, simulation_option("--device-only", help="Measure nothing but --device, and the CPU beside it.")
    ] = False,
    runner_cells: Annotated[
        int | None,
        simulation_option(min=40, max=1_000_000, help="Measure only the runner, in a grid of this many trivial cells."),
    ] = None,
    out: Annotated[
        Path | None,
        output_option(
            help="File for the JSON document, by default benchmark.json; Markdown tables go beside it. With "
            "--runner-cells only the document, and by default none."
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Time drops, gradients, warm equilibria, batches and silhouettes against the bare linear algebra and autograd.

    Takes some minutes on two cores. Results are written to --out as soon as they are measured; `missing` in that file
    names the parts that an interrupted benchmark lacks.
    """
    from cusick_bench.benchmark.plan import FULL, Plan, work
    from cusick_bench.benchmark.suite import benchmark as run_benchmark
    from cusick_bench.benchmark.text import markdown
    from cusick_bench.datasets.files.plate_drapes import read_plate_drapes

    if out is not None and out.suffix == ".md":
        raise CusickError(
            f"the tables would replace the document {out}; name the document, for instance benchmark.json"
        )
    if out is not None and out.is_dir():
        raise CusickError(f"{out} is a folder; name the document in it, for instance {out / 'benchmark.json'}")
    if reference_vertices and reference is None:
        raise CusickError(
            "--reference-vertices is about the table that --reference names; add --reference, or leave it out"
        )
    if runner_cells is not None:
        _refuse(context, _NOT_OF_RUNNER, "--runner-cells, which measures the runner alone")
        _measure_runner(runner_cells, out, as_json)
        return
    if device_only:
        _refuse(context, _NOT_OF_DEVICE, "--device-only, which compares drops and silhouettes alone")
    out = out or Path("benchmark.json")
    asked: dict[str, Any] = dict(FULL) if full else {}
    asked |= {"vertices": tuple(dict.fromkeys(vertices))} if vertices else {}
    asked |= {"rounds": rounds} if rounds else {}
    asked |= dict.fromkeys(("batches", "device_batches"), tuple(dict.fromkeys(batch))) if batch else {}
    asked |= {"reference": read_plate_drapes(reference)} if reference else {}
    asked |= {"reference_vertices": tuple(dict.fromkeys(reference_vertices))} if reference_vertices else {}
    plan = Plan(
        law=law.value, support="springs" if springs else "fixed", reference_steps=reference_steps,
        gradient_vertices=gradient_vertices, device=device, device_only=device_only, **asked,
    )  # fmt: skip
    if not device_only:
        _tell_left_out(plan)
    kept = _Kept(out)
    with interruptible(kept.said), folder_made(out.parent), progress_bar("measuring", work(plan)) as bar:

        def done(name: str, share: float) -> None:
            bar.say(name)
            bar.advance(share)

        document = run_benchmark(plan, done, kept.keep)
    page = out.with_suffix(".md")
    write_atomically(page, markdown(document, command_line()).encode())
    tell(f"wrote {out} and {page}")
    if as_json:
        print_json(document)
        return
    for mesh in document["device"].get("meshes", []):
        print_device(mesh, document["device"])
    if device_only:
        return
    for mesh in document["meshes"]:
        _print_mesh(mesh)
    _print_laws(document["laws"])
    _print_gradients(document["gradient_error"])
    _print_targets(document["targets"])


def _refuse(context: typer.Context, names: Collection[str], beside: str) -> None:
    """Refuses options that stand on the command line and would do nothing."""
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if parameter.name in names and source is not None and source.name == "COMMANDLINE":
            raise CusickError(f"{parameter.opts[0]} does nothing beside {beside}; leave one of them out")


def _tell_left_out(plan: "Plan") -> None:
    """Tells of batches on the CPU that the benchmark does without."""
    from cusick_bench.benchmark.plan import MOST_BATCHED

    for vertices in plan.vertices:
        measured = plan.batches_on(vertices)
        if left := [str(members) for members in plan.batches if members not in measured]:
            tell(
                f"batches of {', '.join(left)} with {vertices} vertices are not measured on the CPU: they have more "
                f"than {MOST_BATCHED} vertices together, and take minutes"
            )


def _measure_runner(cells: int, out: Path | None, as_json: bool) -> None:
    from cusick_bench.benchmark.runner_overhead import runner_overhead

    with (
        TemporaryDirectory(prefix="cusick-bench-") as folder,
        interruptible("nothing was written"),
        folder_made(None if out is None else out.parent),
        progress_bar("cells", cells) as bar,
    ):
        overhead = runner_overhead(cells, Path(folder), progress=bar.show)
    document = {"runner": asdict(overhead) | {"memory_a_cell_kib": overhead.memory_a_cell_kib}}
    if out is not None:
        write_atomically(out, json_text(document, indent=2).encode())
        tell(f"wrote {out}")
    if as_json:
        print_json(document)
        return
    output.print(
        f"{cells} trivial cells: {overhead.wall_ms:.1f} ms each ({overhead.processor_ms:.1f} ms of processor time), "
        f"{overhead.again_ms:.2f} ms where finished already; {overhead.memory_a_cell_kib:.1f} KiB of memory a cell"
    )


class _Kept:
    """Document of the benchmark, which is written whenever something has been measured.

    Attributes:
        path: The document's file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._missing: list[str] | None = None

    def keep(self, document: dict[str, Any]) -> None:
        """Writes the document as far as it is made."""
        write_atomically(self.path, json_text(document, indent=2).encode())
        self._missing = list(document["missing"])

    def said(self) -> str:
        """What an interrupted benchmark leaves behind."""
        if self._missing is None:
            return "nothing was measured yet"
        return f"what is measured is in {self.path}; it lacks {', '.join(self._missing) or 'nothing'}"


def _print_mesh(mesh: dict[str, Any]) -> None:
    kept, again = (mesh["memory_bytes"][name] / 1e6 for name in ("kept", "checkpointed"))
    title = f"{mesh['vertices']} vertices; memory of a gradient {kept:.0f} MB, checkpointed {again:.0f} MB"
    table = Table("case", title=title)
    for name in ("median ms", "range ms", "of floor or drops"):
        table.add_column(name, justify="right")
    ratios = {name.split(" / ")[0]: ratio for name, ratio in mesh["ratios"].items()}
    for name, timing in {**mesh["cases"], **mesh["phases"]}.items():
        low, high = 1e3 * timing["low_s"], 1e3 * timing["high_s"]
        ratio = f"{ratios[name]['median']:.2f}" if name in ratios else ""
        table.add_row(name, f"{1e3 * timing['median_s']:.2f}", f"{low:.2f} - {high:.2f}", ratio)
    output.print(table)


def print_device(mesh: dict[str, Any], device: dict[str, Any]) -> None:
    """One mesh on a device.

    Args:
        mesh: An entry of the document's `device`.
        device: That `device`.
    """
    name = device.get("name", device["device"])
    table = Table("case", title=f"{mesh['vertices']} vertices, torch engine on {name}")
    for column in ("median ms", "range ms", "peak MB"):
        table.add_column(column, justify="right")
    for case, timing in mesh["cases"].items():
        low, high, peak = 1e3 * timing["low_s"], 1e3 * timing["high_s"], mesh["peak_memory_bytes"][case]
        held = "-" if peak is None else f"{peak / 1e6:.0f}"
        table.add_row(case, f"{1e3 * timing['median_s']:.1f}", f"{low:.1f} - {high:.1f}", held)
    for case, reason in mesh["left_out"].items():
        table.add_row(case, "left out", reason, "")
    output.print(table)
    for what, rate in mesh["drapes_per_second"].items():
        output.print(
            f"{what}: {rate['device']:.3g} drapes/s, the CPU's engine {rate['cpu']:.3g}: "
            f"{mesh['times_faster'][what]:.3g} times as fast"
        )
    worst = max(mesh["agreement"]["gradient"].values())
    output.print(f"engines differ by {mesh['agreement']['positions_m']:.1e} m, gradients by {worst:.1e} of the largest")


def _print_laws(laws: dict[str, Any]) -> None:
    names = list(laws["meshes"][0]["step"]) if laws["meshes"] else []
    table = Table("step, by law", title="laws side by side")
    for column in (*(f"{name} ms" for name in names), "ratio"):
        table.add_column(column, justify="right")
    for mesh in laws["meshes"]:
        steps = (f"{1e3 * mesh['step'][name]['median_s']:.2f}" for name in names)
        table.add_row(f"{mesh['vertices']} vertices", *steps, f"{mesh['ratio']['median']:.2f}")
    output.print(table)
    near = laws["equal_error"]
    for name in names if near else ():
        rows, found = near[name]["rows"], near[name]
        reached = sum(row["reached"] for row in rows)
        largest = max(row["vertices"] for row in rows)
        output.print(
            f"law {name}: {reached} of {len(rows)} reference drapes within {near['near_enough_points']:g} points on "
            f"meshes of at most {largest} vertices, {found['seconds']:.3g} s for those that law {names[0]} brings there"
        )


def _print_gradients(rows: list[dict[str, Any]]) -> None:
    table = Table("mode", "parameter", "direction", title="gradient of the whole pipeline against central differences")
    table.add_column("relative error", justify="right")
    table.add_column("folds changed")
    for row in rows:
        direction = "per element" if row["per_element"] else "all together"
        changed = "yes" if row["branch_changed"] else "no"
        table.add_row(row["mode"], row["parameter"], direction, f"{row['relative_error']:.1e}", changed)
    output.print(table)


def _print_targets(rows: list[dict[str, Any]]) -> None:
    table = Table("target", title="targets")
    for name in ("measured", "limit", "met"):
        table.add_column(name, justify="right")
    for row in rows:
        measured = "-" if row["measured"] is None else f"{row['measured']:.3g}"
        table.add_row(row["target"], measured, row["limit"], {True: "yes", False: "no", None: "-"}[row["met"]])
    output.print(table)
