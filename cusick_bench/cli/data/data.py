"""`cusick-bench data`: what a data set holds, what is irregular in it, and what its drapes are like."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Column, Table

from cusick_bench.cli.common import output, print_json, tell, user_errors
from cusick_bench.cli.completion import complete_data
from cusick_bench.cli.data.fabric_quantiles import fabric_quantiles
from cusick_bench.cli.data.photographs import board, photograph_errors, photographs, prepare
from cusick_bench.cli.data.synthetic import synthetic
from cusick_bench.cli.options import Cloths, FabricsCsv, Json
from cusick_bench.cli.progress import progress_bar
from cusick_bench.datasets.irregularity import KINDS
from cusick_bench.datasets.published import CLOTHS
from cusick_bench.datasets.registry import registered_in
from cusick_bench.files.shell_word import shell_word

if TYPE_CHECKING:
    from cusick_bench.datasets.audit.audit import Audit
    from cusick_bench.datasets.dataset import DrapeDataset
    from cusick_bench.datasets.stats import ClothStatistics


app = typer.Typer(help="Contents, irregularities and statistics of a data set; data sets from photographs.")
app.command()(synthetic)
app.command()(prepare)
app.command()(board)
app.command()(photographs)
app.command("photograph-errors")(photograph_errors)
app.command("fabric-quantiles")(fabric_quantiles)

_SHOWN = 3  # irregularities of a kind that are listed without --all

NameOrPath = Annotated[
    str,
    typer.Argument(
        help="Name of a data set, see `datasets`, or a folder in its layout.",
        metavar="DATA",
        autocompletion=complete_data,
    ),
]
Uncorrected = Annotated[
    bool, typer.Option("--uncorrected", help="Take files as they are named; correct no mesh or face that does not fit.")
]


@app.command("audit")
@user_errors
def audit_command(
    path: NameOrPath,
    every: Annotated[bool, typer.Option("--all", help="List every irregularity, not just some of each kind.")] = False,
    json: Json = False,
) -> None:
    """Look at every file and list what is irregular; the exit status is 0 even if the data have faults."""
    from cusick_bench.datasets.audit.audit import audit

    with progress_bar("measuring files") as bar:
        found = audit(path, progress=bar.show)
    if json:
        print_json(found.document())
    else:
        _print_audit(found, every)


def _print_audit(found: Audit, every: bool) -> None:
    output.print(
        f"{found.fabrics} fabrics, {found.samples} samples, {found.silhouettes} silhouettes, {found.meshes} meshes, "
        f"{len(found.irregularities)} irregularities"
    )
    groups = defaultdict(list)
    for item in found.irregularities:
        groups[item.kind].append(item)
    columns = (Column(name, overflow="fold") for name in ("path", "detail"))
    table = Table(Column("kind", no_wrap=True), "count", *columns)
    for kind in sorted(groups, key=lambda kind: -len(groups[kind])):
        items = groups[kind] if every else groups[kind][:_SHOWN]
        for row, item in enumerate(items):
            head = (kind, str(len(groups[kind]))) if row == 0 else ("", "")
            table.add_row(*head, item.path, item.detail)
        if len(items) < len(groups[kind]):
            table.add_row("", "", f"... {len(groups[kind]) - len(items)} more: --all", KINDS[kind], style="dim")
        table.add_section()
    if groups:
        output.print(table)
    if found.impossible:
        count = len(found.impossible)
        output.print(
            f"{count} silhouette{' shows' if count == 1 else 's show'} no cloth on its plate, which stops `run` and "
            f"`diagnose`: {found.impossible[0]}" + (f" and {count - 1} more" if count > 1 else "")
        )


@app.command("info")
@user_errors
def info_command(
    name_or_path: NameOrPath = "synthetic",
    fabrics_csv: FabricsCsv = None,
    uncorrected: Uncorrected = False,
    json: Json = False,
) -> None:
    """List what a data set holds, cloth by cloth."""
    dataset = _load(name_or_path, fabrics_csv, uncorrected)
    _tell_unreadable(dataset, range(len(dataset)))
    rows = [_contents(dataset, cloth) for cloth in dataset.cloths]
    if json:
        registered = registered_in(dataset.root)
        print_json(
            {
                "name": dataset.name,
                "root": dataset.root,
                "content_hash": dataset.content_hash,
                "licence": registered.licence if registered else None,
                "citation": registered.citation if registered else None,
                "corrected": list(dataset.corrected),
                "protocol": dataset.protocol.document(),
                "silhouettes": len(dataset),
                "cloths": rows,
            }
        )
        return
    output.print(f"{dataset.name}: {len(dataset)} silhouettes in {dataset.root}")
    output.print(f"sha256 {dataset.content_hash}")
    output.print(_nominal(dataset), soft_wrap=True)
    heads = ("fabric", "samples", "images", "meshes", "faces", "repeats", "kg/m2", "mm")
    table = Table(
        Column("cloth", no_wrap=True),
        *heads,
        caption="repeats: pairs of captures of one drape; kg/m2: density; mm: thickness",
    )
    for row in rows:
        faces = " + ".join(f"{count} {side or 'unknown'}" for side, count in row["sides"].items())
        counts = (str(row[name]) for name in ("fabric", "samples", "silhouettes", "meshes"))
        table.add_row(
            row["cloth"],
            *counts,
            faces,
            str(row["repeat_pairs"]),
            _number(row["areal_density_kg_m2"], ".3f"),
            _number(row["thickness_m"], ".2f", 1e3),
        )
    output.print(table)


def _nominal(dataset: DrapeDataset) -> str:
    """Sizes, scale and camera by which the pictures are read, and where they are from."""
    from cusick_bench.datasets.files.layout import beside
    from cusick_bench.datasets.files.protocol import FILE as PROTOCOL

    protocol = dataset.protocol
    height = f" {protocol.camera_height_m:g} m above the plate" if protocol.projection == "pinhole" else ""
    source = beside(dataset.root, PROTOCOL) or f"the public release's, since there is no {PROTOCOL}"
    return f"{protocol.sizes_text}, {protocol.projection} camera{height} ({source})"


def _contents(dataset: DrapeDataset, cloth: str) -> dict[str, Any]:
    part = dataset.select(cloth=cloth).table
    sides = list(part["side"])
    return {
        "cloth": cloth,
        "fabric": int(part["fabric"].iloc[0]),
        "samples": len(set(part["sample"])),
        "silhouettes": len(part),
        "meshes": sum(1 for mesh in part["mesh"] if mesh),
        "sides": {side: sides.count(side) for side in dict.fromkeys(sides)},
        "repeat_pairs": len(dataset.repeat_pairs(cloth)),
        "areal_density_kg_m2": float(part["areal_density"].iloc[0]),
        "thickness_m": float(part["thickness"].iloc[0]),
        "training_sample": CLOTHS[cloth].training_sample if cloth in CLOTHS else None,
        "noted": sum(1 for note in part["notes"] if note),
    }


@app.command("stats")
@user_errors
def stats_command(
    name_or_path: NameOrPath = "synthetic",
    cloth: Cloths = None,
    json: Json = False,
) -> None:
    """Measure drape coefficient, folds, spectrum and the differences between drapes; means are over sample x face."""
    from cusick_bench.datasets.audit.limits import UNMEASURED
    from cusick_bench.datasets.impossible import impossible
    from cusick_bench.datasets.stats import statistics

    dataset = _load(name_or_path, None, uncorrected=False)
    with progress_bar("reading cloths", len(dataset.cloths)) as bar:
        found = statistics(dataset, cloth, progress=lambda name: bar.advance())
    if json:
        print_json({"name": dataset.name, "cloths": [item.document() for item in found]})
    else:
        output.print(_stats_table(found))
    wanted = {item.cloth for item in found}
    rows = [row for row, name in enumerate(dataset.table["cloth"]) if name in wanted]
    _tell_unreadable(dataset, rows)
    faults = impossible(dataset, rows)
    left_out = {item.path for item in faults if item.kind in UNMEASURED}
    faults = [item for item in faults if item.path not in left_out]
    if faults:
        pictures, fault = len({item.path for item in faults}), faults[0]
        tell(
            f"{pictures} of the silhouettes show{'s' if pictures == 1 else ''} no cloth on its plate, so that these "
            f"numbers mean nothing for them: {fault.path}: {fault.detail} ({fault.kind}); look with `cusick-bench data "
            f"audit {shell_word(dataset.root)}`, and correct the pictures or protocol.json"
        )


def _tell_unreadable(dataset: DrapeDataset, rows: Sequence[int]) -> None:
    """Tells how many pictures cannot be measured, and why the first cannot: often they all have the same fault."""
    from cusick_bench.datasets.impossible import unreadable

    if faults := list(unreadable(dataset, rows)):
        tell(f"{len(faults)} of {len(rows)} silhouettes cannot be measured, such as {faults[0]}")


def _stats_table(found: list[ClothStatistics]) -> Table:
    heads = ("units", "DC", "folds", "repeat", "flip", "sample", "fabric", "down - up", "drift", "order")
    caption = (
        "DC: drape coefficient, mean ± sd over units (sample x face); repeat ... fabric: MSE between images of the "
        "same drape, the other face, another sample, another fabric; down - up, drift over time: of DC ± standard "
        "error; order: rank correlation of DC with the sample's number (p)"
    )
    table = Table(Column("cloth", no_wrap=True), *heads, caption=caption)
    for item in found:
        drift = [change for change in item.drift.values() if isfinite(change.error)]
        table.add_row(
            item.cloth,
            str(item.units) + (f" (-{item.unusable} images)" if item.unusable else ""),
            _spread(item.drape_coefficient, item.drape_coefficient_sd, ".3f"),
            _spread(item.folds, item.folds_sd, ".1f"),
            *(
                _number(value, ".4f")
                for value in (item.mse_repeat, item.mse_flip, item.mse_other_sample, item.mse_other_fabric)
            ),
            _spread(item.down_minus_up.mean, item.down_minus_up.error, "+.3f"),
            _spread(drift[-1].mean, drift[-1].error, "+.3f") if drift else "",
            f"{item.order.correlation:+.2f} ({item.order.p:.2g})" if isfinite(item.order.p) else "",
        )
    return table


def _load(name_or_path: str, fabrics_csv: Path | None, uncorrected: bool) -> DrapeDataset:
    from cusick_bench.datasets.loading import read_dataset

    options = {"correct": False} if uncorrected else {}
    with progress_bar("measuring files") as bar:
        return read_dataset(name_or_path, fabrics_csv=fabrics_csv, progress=bar.show, **options)


def _number(value: float, form: str, factor: float = 1.0) -> str:
    return format(factor * value, form) if isfinite(value) else ""


def _spread(mean: float, spread: float, form: str) -> str:
    if not isfinite(mean):
        return ""
    return f"{mean:{form}}" + (f" ± {spread:{form.lstrip('+')}}" if isfinite(spread) else "")
