"""`cusick-bench diagnose`: where simulation and data differ, what causes it, how far the gap shrinks."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from cusick_bench.cli.common import interruptible, output, print_json, user_errors
from cusick_bench.cli.options import Atlas, Force, Json, Seed, SimulatedSamples, WithoutEffect, output_option
from cusick_bench.cli.progress import progress_bar
from cusick_bench.diagnosis import NUMERICS_VERSION
from cusick_bench.diagnosis.options import SHIPPED, Options
from cusick_bench.runner.store import write_atomically

if TYPE_CHECKING:
    from cusick_bench.diagnosis.document.model import Cause, DiagnosisDocument, ParameterValue


app = typer.Typer()
_MOST_CAUSES = 8  # that the terminal shows


@app.command("diagnose")
@user_errors
def diagnose_data(
    data: Annotated[
        str,
        typer.Argument(help="Data set: name or folder; by default the release in CUSICK_DATA.", metavar="DATA"),
    ] = "cusick",
    fabric: Annotated[
        list[str] | None,
        typer.Option("--cloth", "--fabric", help="Cloth to diagnose; repeatable; by default all with three samples."),
    ] = None,
    samples: SimulatedSamples = Options.samples,
    without_effect: WithoutEffect = None,
    atlas: Atlas = SHIPPED,
    out: Annotated[Path, output_option(help="Folder of diagnosis.json and a page for each cloth.")] = Path(
        "runs/diagnosis"
    ),
    summary: Annotated[Path | None, output_option("--table", help="CSV file with a row for each cloth.")] = None,
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Finds what the simulator leaves out of a fabric's drapes, from silhouettes of several samples."""
    from cusick_bench.datasets import load
    from cusick_bench.diagnosis.atlas.store import load as load_atlas
    from cusick_bench.diagnosis.diagnose import diagnose
    from cusick_bench.diagnosis.document.build import document
    from cusick_bench.diagnosis.measure.captures import read_captures
    from cusick_bench.runner.environment import version_text
    from cusick_bench.runner.numerics import diagnosis_numerics
    from cusick_bench.sim.effects import effect
    from cusick_bench.sim.setup import Simulators

    options = Options(samples, True, tuple(effect(name).name for name in without_effect or ()), seed)
    emulator, calibration = load_atlas(atlas)
    with progress_bar("reading data") as bar:
        dataset = load(data, progress=bar.show)
    chosen = fabric or _with_samples(dataset)
    out.mkdir(parents=True, exist_ok=True)  # before minutes of work, not after
    simulators, written = Simulators(most=20), []
    version = version_text(diagnosis_numerics(diagnosis=NUMERICS_VERSION))
    kept = interruptible(lambda: f"{len(written)} of {len(chosen)} fabrics are written to {out}")
    with progress_bar("reading data", len(chosen)) as bar, kept:
        for number, name in enumerate(chosen):
            captures = read_captures(dataset, name, force=force)

            def step(what: str, share: float, name: str = name, number: int = number) -> None:
                bar.say(f"{name}: {what}")
                bar.show(number + share)

            result = diagnose(captures, emulator, calibration, options, simulators=simulators, progress=step)
            command = f"cusick-bench diagnose {data} --fabric {name} --samples {samples} --seed {seed}"
            command += " --force" if force else ""
            one = document(result, captures, emulator, command=command, version=version)
            written.append(_write(one, out))
    if summary is not None:
        _summarise([one.document for one in written], summary)
    if as_json:
        print_json({"fabrics": [one.content() for one in written]})
        return
    for one in written:
        _print(one)


def _with_samples(dataset: Any) -> list[str]:
    """Fabrics with at least three samples."""
    counts = dataset.index.groupby("cloth", sort=False)["sample"].nunique()
    return [str(name) for name, count in counts.items() if count >= 3] or dataset.cloths


@dataclass(frozen=True)
class _Written:
    """A document and the files that hold it."""

    document: DiagnosisDocument
    path: Path
    page: Path

    def content(self) -> dict[str, Any]:
        """The document with the paths of its files."""
        return self.document.content() | {"path": self.path, "page": self.page}


def _write(one: DiagnosisDocument, out: Path) -> _Written:
    """Writes document and page into a folder of their own."""
    from cusick_bench.report.diagnosis.page import write_diagnosis_page

    folder = out / re.sub(r"[^\w.-]+", "_", one.fabric)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "diagnosis.json"
    one.write(path)
    return _Written(one, path, write_diagnosis_page(one, folder / "diagnosis.html"))


def _summarise(documents: list[DiagnosisDocument], path: Path) -> None:
    """A row for each fabric."""
    import pandas as pd

    from cusick_bench.files.csv_text import csv_text

    rows = []
    for one in documents:
        low, high = one.closure.ci90 or (None, None)
        steps_low, steps_high = one.steps.ci90 or (None, None)
        leading = next((cause for cause in one.causes if cause.effect not in ("none", "unknown")), None)
        rows.append(
            {
                "fabric": one.fabric,
                "samples": one.data.samples,
                "captures": one.data.captures,
                "verdict": one.verdict,
                "p": one.gap.p,
                "cause": leading.effect if leading else "",
                "probability": leading.probability if leading else None,
                "parameters": "; ".join(_parameters(leading)) if leading else "",
                "set90": " ".join(one.set90),
                "gap_base": one.gap.base,
                "gap_floor": one.gap.floor,
                "gap_with_cause": one.gap.effect,
                "closure": one.closure.fraction,
                "closure_low": low,
                "closure_high": high,
                "needs": " + ".join(step.effect for step in one.steps.causes),
                "needs_closure": one.steps.closure,
                "needs_closure_low": steps_low,
                "needs_closure_high": steps_high,
                "command": one.provenance.command,
                "code": one.provenance.version,
            }
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, csv_text(pd.DataFrame(rows), float_format="%.4g").encode())


def _parameters(cause: Cause) -> list[str]:
    """Its parameters with their units, in words."""
    return [f"{name} {_shown(one)}" for name, one in cause.parameters.items()]


def _shown(parameter: ParameterValue) -> str:
    return "unknown" if parameter.value is None else f"{parameter.value:.3g} {parameter.unit}".strip()


def _print(written: _Written) -> None:
    one = written.document
    output.print(f"\n{one.fabric}: {one.headline}", style="bold")
    if one.gap.base is not None and one.gap.floor is not None:
        output.print(f"gap {one.gap.base:.3f} (floor {one.gap.floor:.3f}), p = {one.gap.p:.3g}")
    causes = Table("cause", "class", "probability", "parameters")
    for cause in one.causes[:_MOST_CAUSES]:
        causes.add_row(cause.effect, cause.stage, f"{cause.probability:.2f}", ", ".join(_parameters(cause)))
    output.print(causes)
    if one.closure.fraction is not None and one.closure.ci90 is not None:
        low, high = one.closure.ci90
        output.print(
            f"with {one.closure.effect} the gap on unseen samples shrinks by {one.closure.fraction:.0%} "
            f"(90 %: {low:.0%} to {high:.0%})"
        )
    _print_steps(one)
    for measurement in one.next:
        output.print(f"next: {measurement.name} ({measurement.bits:.2f} bits). {measurement.what}")
    for note in one.notes:
        output.print(f"note: {note}")
    output.print(f"page: {written.page}")


def _print_steps(one: DiagnosisDocument) -> None:
    """The causes that were taken off one after the other, where there are several."""
    if len(one.steps.causes) > 1:
        names = ", ".join(step.effect for step in one.steps.causes)
        left = one.steps.causes[-1].misfit_left
        closure = one.steps.closure
        closed = "" if closure is None else f"; together they close {closure:.0%} of the gap"
        output.print(f"one after the other: {names} (misfit {one.steps.misfit:.1f} -> {left:.1f}){closed}")
