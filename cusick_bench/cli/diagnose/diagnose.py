"""`cusick-bench diagnose`: where simulation and data differ, what causes it, how far the gap shrinks."""

import json
import re
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import typer
from rich.table import Table

from cusick_bench.cli.common import output, plain, print_json, progress_bar, user_errors
from cusick_bench.datasets import load
from cusick_bench.diagnosis.atlas.store import SHIPPED
from cusick_bench.diagnosis.atlas.store import load as load_atlas
from cusick_bench.diagnosis.diagnose import Options, diagnose
from cusick_bench.diagnosis.document import document, table
from cusick_bench.diagnosis.measure.captures import read_captures
from cusick_bench.report.diagnosis.page import write_diagnosis_page
from cusick_bench.runner.environment import code_version
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.effects import effect
from cusick_bench.sim.setup import Simulators

app = typer.Typer()
_OUT = Path("runs/diagnosis")


@app.command("diagnose")
@user_errors
def diagnose_data(
    data: Annotated[
        str,
        typer.Argument(help="Data set: name or folder; by default the release in CUSICK_DATA.", metavar="DATA"),
    ] = "cusick",
    fabric: Annotated[
        list[str] | None, typer.Option(help="Fabric to diagnose (repeatable); by default all with three samples.")
    ] = None,
    samples: Annotated[
        int, typer.Option(min=0, help="Simulated samples of each model; 0 leaves gap and closure out (seconds).")
    ] = Options.samples,
    without: Annotated[list[str] | None, typer.Option(help="Effect not to consider (repeatable).")] = None,
    atlas: Annotated[Path, typer.Option(help="Fitted atlas.")] = SHIPPED,
    out: Annotated[Path, typer.Option(help="Folder of diagnosis.json and a page for each fabric.")] = Path(
        "runs/diagnosis"
    ),
    summary: Annotated[Path | None, typer.Option("--table", help="CSV file of a row for each fabric.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of simulations and tests.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on standard output.")] = False,
) -> None:
    """Finds what the simulator leaves out of a fabric's drapes, from silhouettes of several samples."""
    options = Options(samples, True, tuple(effect(name).name for name in without or ()), seed)
    emulator, calibration = load_atlas(atlas)
    dataset = load(data)
    chosen = fabric or _with_samples(dataset)
    simulators, found = Simulators(most=20), []
    with progress_bar("reading data", len(chosen)) as bar:
        for number, name in enumerate(chosen):
            captures = read_captures(dataset, name)

            def step(what: str, share: float, name: str = name, number: int = number) -> None:
                bar.say(f"{name}: {what}")
                bar.show(number + share)

            result = diagnose(captures, emulator, calibration, options, simulators=simulators, progress=step)
            command = f"cusick-bench diagnose {data} --fabric {name} --samples {samples} --seed {seed}"
            one = document(result, captures, emulator, command=command, version=code_version("diagnosis"))
            found.append(_written(one, out))
    if summary is not None:
        _summarise(found, summary)
    if as_json:
        print_json({"fabrics": found})
        return
    for one in found:
        _print(one)


def _with_samples(dataset: Any) -> list[str]:
    """Fabrics with at least three samples."""
    counts = dataset.index.groupby("cloth", sort=False)["sample"].nunique()
    return [str(name) for name, count in counts.items() if count >= 3] or dataset.cloths


def _written(one: dict[str, Any], out: Path) -> dict[str, Any]:
    """The document with the paths of its files."""
    folder = out / re.sub(r"[^\w.-]+", "_", one["fabric"])
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "diagnosis.json"
    write_atomically(path, json.dumps(plain(one), allow_nan=False).encode())
    page = write_diagnosis_page(plain(one), folder / "diagnosis.html")
    return one | {"path": path, "page": page}


def _summarise(found: list[dict[str, Any]], path: Path) -> None:
    """A row for each fabric."""
    rows = []
    for one in found:
        gap, closure = one["gap"], one["closure"]
        low, high = closure["ci90"] or (None, None)
        leading = next((c for c in one["causes"] if c["effect"] not in ("none", "unknown")), None)
        rows.append(
            {
                "fabric": one["fabric"],
                "samples": one["data"]["samples"],
                "captures": one["data"]["captures"],
                "verdict": one["verdict"],
                "p": gap["p"],
                "cause": leading["effect"] if leading else "",
                "probability": leading["probability"] if leading else None,
                "parameters": _words(leading["parameters"]) if leading else "",
                "set90": " ".join(one["set90"]),
                "gap_base": gap["base"],
                "gap_floor": gap["floor"],
                "gap_with_cause": gap["effect"],
                "closure": closure["fraction"],
                "closure_low": low,
                "closure_high": high,
                "needs": " + ".join(step["effect"] for step in one["steps"]["causes"]),
                "needs_closure": one["steps"]["closure"],
                "needs_closure_low": (one["steps"]["ci90"] or [None, None])[0],
                "needs_closure_high": (one["steps"]["ci90"] or [None, None])[1],
                "command": one["made"]["command"],
                "code": one["made"]["version"],
            }
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, pd.DataFrame(rows).to_csv(index=False, float_format="%.4g").encode())


def _words(parameters: dict[str, dict[str, Any]]) -> str:
    return "; ".join(f"{name} {one['value']:.3g} {one['unit']}".strip() for name, one in parameters.items())


def _print(one: dict[str, Any]) -> None:
    gap = one["gap"]
    output.print(f"\n[bold]{one['fabric']}[/]: {one['headline']}")
    if gap["base"] is not None:
        output.print(f"gap {gap['base']:.3f} (floor {gap['floor']:.3f}), p = {gap['p']:.3g}")
    causes = Table("cause", "class", "probability", "parameters")
    for row in table(one):
        causes.add_row(*row)
    output.print(causes)
    closure = one["closure"]
    if closure["fraction"] is not None:
        low, high = closure["ci90"]
        output.print(
            f"with {closure['effect']} the gap on unseen samples shrinks by {closure['fraction']:.0%} "
            f"(90 %: {low:.0%} to {high:.0%})"
        )
    taken = one["steps"]
    if len(taken["causes"]) > 1:
        names = ", ".join(step["effect"] for step in taken["causes"])
        left = taken["causes"][-1]["misfit_left"]
        closed = "" if taken["closure"] is None else f"; together they close {taken['closure']:.0%} of the gap"
        output.print(f"one after the other: {names} (misfit {taken['misfit']:.1f} -> {left:.1f}){closed}")
    for advice in one["next"]:
        output.print(f"next: {advice['name']} ({advice['bits']:.2f} bits). {advice['what']}")
    for note in one["notes"]:
        output.print(f"note: {note}")
    output.print(f"page: {one['page']}")
