"""`cusick-bench diagnose`: where simulation and data differ, what causes it, how far the gap shrinks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from cusick_bench.cli.common import interruptible, output, print_json, tell, user_errors
from cusick_bench.cli.completion import complete_cloth
from cusick_bench.cli.options import (
    Atlas,
    DiagnosedData,
    Force,
    Json,
    Seed,
    SimulatedSamples,
    WithoutEffect,
    output_option,
)
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.written_paths import folder_made
from cusick_bench.diagnosis.options import SHIPPED, Options
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.units import shown_unit

if TYPE_CHECKING:
    from cusick_bench.diagnosis.document.laboratory import LaboratoryDocument
    from cusick_bench.diagnosis.document.model import Cause, DiagnosisDocument, ParameterValue
    from cusick_bench.diagnosis.measure.captures import Captures


app = typer.Typer()
_DOCUMENT = "diagnosis.json"
_MOST_CAUSES = 8  # that the terminal shows


@app.command("diagnose")
@user_errors
def diagnose_data(
    data: DiagnosedData = "cusick",
    fabric: Annotated[
        list[str] | None,
        typer.Option(
            "--cloth",
            "--fabric",
            help="Cloth to diagnose; repeatable; by default all with three samples or more.",
            autocompletion=complete_cloth,
        ),
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
    """Find which effects the simulator lacks for a fabric's drapes, from silhouettes of several samples."""
    from cusick_bench.datasets import load
    from cusick_bench.diagnosis.atlas.store import load as load_atlas
    from cusick_bench.diagnosis.data_set import data_set_diagnosis
    from cusick_bench.diagnosis.document.laboratory import write_laboratory
    from cusick_bench.diagnosis.errors import DiagnosisError, Refused
    from cusick_bench.diagnosis.measure.captures import read_captures
    from cusick_bench.files.plain_names import plain_names
    from cusick_bench.sim.effects import effect

    options = Options(samples, True, tuple(effect(name).name for name in without_effect or ()), seed)
    emulator, calibration = load_atlas(atlas)
    with progress_bar("reading data") as bar:
        dataset = load(data, progress=bar.show)
    chosen = list(dict.fromkeys(fabric or _with_samples(dataset)))
    if summary is not None and summary.is_dir():
        raise DiagnosisError(f"--table must name a file, got the folder {summary}; give for instance diagnosis.csv")
    written: list[_Written] = []
    folders = plain_names(dataset.cloths)
    kept = interruptible(lambda: f"{len(written)} of {len(chosen)} fabrics are written to {out}")
    room = (folder_made(out), folder_made(None if summary is None else summary.parent))
    with progress_bar("reading data", len(chosen) + 1) as bar, kept, room[0], room[1]:
        if fabric:
            captures = {name: read_captures(dataset, name, force=force) for name in chosen}
        else:
            captures = _with_usable_samples(dataset, chosen, force=force)
            chosen = list(captures)
        diagnosis = data_set_diagnosis(captures, emulator, calibration, options, bar.tell)
        shared = diagnosis.shared
        write_laboratory(shared, out)
        for number, name in enumerate(chosen):

            def step(what: str, share: float, name: str = name, number: int = number) -> None:
                bar.tell(f"{name}: {what}", number + 1 + share)

            command = options.command(data, diagnosis.together(name), atlas, force=force)
            one = diagnosis.document(name, command=command, progress=step)
            if one.refused is not None and len(chosen) == 1:
                if (earlier := out / folders[name] / _DOCUMENT).exists():
                    tell(f"{earlier} is an earlier command's")
                raise Refused(one.refused)
            written.append(_write(one, out / folders[name]))
            if summary is not None:  # after each of them: a fabric takes minutes
                _summarise([one.document for one in written], summary)
    if as_json:
        laboratory = {} if shared is None else {"laboratory": shared.content()}
        print_json({**laboratory, "fabrics": [one.content() for one in written]})
        return
    if shared is not None:
        _print_laboratory(shared)
    for one in written:
        _print(one)


def _with_samples(dataset: Any) -> list[str]:
    """Fabrics with enough samples to be diagnosed unasked, or all where none has."""
    from cusick_bench.diagnosis.options import LEAST_SAMPLES

    counts = dataset.index.groupby("cloth", sort=False)["sample"].nunique()
    return [str(name) for name, count in counts.items() if count >= LEAST_SAMPLES] or dataset.cloths


def _with_usable_samples(dataset: Any, names: list[str], *, force: bool) -> dict[str, Captures]:
    """Silhouettes of those with enough samples that can be used, or of all where none has; the others are told."""
    from cusick_bench.diagnosis.measure.captures import read_usable_captures
    from cusick_bench.diagnosis.options import LEAST_SAMPLES

    found, unusable = read_usable_captures(dataset, names, force=force)
    if not found:
        raise next(iter(unusable.values()))
    usable = {name: len(set(own.sample.tolist())) for name, own in found.items()}
    enough = {name: own for name, own in found.items() if usable[name] >= LEAST_SAMPLES} or found
    for name in [one for one in names if one not in enough]:
        tell(
            f"{name} is left out: pictures of {usable.get(name, 0)} of its samples can be used, and {LEAST_SAMPLES} "
            "are needed; see `data audit`, or name it with --fabric"
        )
    return enough


@dataclass(frozen=True)
class _Written:
    """A document and the files that hold it."""

    document: DiagnosisDocument
    path: Path
    page: Path

    def content(self) -> dict[str, Any]:
        """The document with the paths of its files."""
        return self.document.content() | {"path": self.path, "page": self.page}


def _write(one: DiagnosisDocument, folder: Path) -> _Written:
    """Writes document and page into a folder of their own."""
    from cusick_bench.report.diagnosis.page import write_diagnosis_page

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / _DOCUMENT
    one.write(path)
    return _Written(one, path, write_diagnosis_page(one, folder / "diagnosis.html"))


def _summarise(documents: list[DiagnosisDocument], path: Path) -> None:
    """A row for each fabric."""
    import pandas as pd

    from cusick_bench.files.csv_text import csv_text

    rows = []
    for one in documents:
        low, high = one.closure.ci90 or (None, None)
        left_low, left_high = (None, None) if one.share_left is None else one.unexplained.ci90 or (None, None)
        by_name = {cause.effect: cause for cause in one.causes}
        named = [by_name[name] for name in one.effects if name in by_name]
        rows.append(
            {
                "fabric": one.fabric,
                "samples": one.data.samples,
                "captures": one.data.captures,
                "verdict": one.verdict,
                "p": one.gap.p,
                "effects": " + ".join(one.effects),
                "one_of": " + ".join("|".join(group) for group in one.groups),
                "probability": " ".join(f"{cause.acting or 0:.2f}" for cause in named),
                "parameters": "; ".join(f"{cause.effect}: {', '.join(_parameters(cause))}" for cause in named),
                "budget": " ".join(f"{share.effect}={share.share:.2f}" for share in one.budget),
                "unexplained": one.share_left,
                "unexplained_low": left_low,
                "unexplained_high": left_high,
                "novelty_p": one.fit.novelty_p,
                "set90": " ".join(one.set90),
                "gap_base": one.gap.base,
                "gap_floor": one.gap.floor,
                "gap_with_effects": one.gap.effect,
                "closure": one.closure.fraction,
                "closure_low": low,
                "closure_high": high,
                "refused": one.refused or "",
                "command": one.provenance.command,
                "code": one.provenance.version,
            }
        )
    write_atomically(path, csv_text(pd.DataFrame(rows), float_format="%.4g").encode())


def _parameters(cause: Cause) -> list[str]:
    """Its parameters with their units, in words."""
    return [f"{name} {_shown(one)}" for name, one in cause.parameters.items()]


def _shown(parameter: ParameterValue) -> str:
    return "unknown" if parameter.value is None else f"{parameter.value:.3g} {shown_unit(parameter.unit)}".strip()


def _print_laboratory(shared: LaboratoryDocument) -> None:
    """What all fabrics share, before any of them."""
    output.print(f"\nlaboratory of {len(shared.fabrics)} fabrics: effects that all may share", style="bold")
    table = Table("effect", "class", "probability", "parameters", "evidence by fabric [nat]")
    for one in shared.effects:
        parameters = ", ".join(f"{name} {_shown(value)}" for name, value in one.parameters.items())
        evidence = ", ".join(f"{name} {value:.1f}" for name, value in one.evidence.items())
        name = " or ".join((one.effect, *one.look_alikes))
        table.add_row(name, one.stage, f"{one.probability:.2f}", parameters, evidence)
    output.print(table)
    for note in shared.notes:
        output.print(f"note: {note}")


def _print(written: _Written) -> None:
    one = written.document
    output.print(f"\n{one.fabric}: {one.headline}", style="bold")
    if one.gap.base is not None and one.gap.floor is not None:
        output.print(f"gap {one.gap.base:.3f} (floor {one.gap.floor:.3f}), p = {one.gap.p:.3g}")
    if one.causes:
        causes = Table("cause", "class", "acts", "leads", "parameters", "share of the gap")
        shares = {share.effect: _span(share.share, share.ci90) for share in one.budget}
        for cause in one.ranked_causes[:_MOST_CAUSES]:
            acts = "" if cause.acting is None else f"{cause.acting:.2f}"
            name = f"{cause.effect} *" if cause.named else cause.effect
            cells = (f"{cause.probability:.2f}", ", ".join(_parameters(cause)), shares.get(cause.effect, ""))
            causes.add_row(name, cause.stage, acts, *cells)
        output.print(causes)
    if one.share_left is not None:
        output.print(f"unexplained of the gap on unseen samples: {_span(one.share_left, one.unexplained.ci90)}")
    if one.closure.fraction is not None and one.closure.ci90 is not None:
        low, high = one.closure.ci90
        output.print(
            f"with {' + '.join(one.closure.effect)} the gap on unseen samples shrinks by {one.closure.fraction:.0%} "
            f"(90 %: {low:.0%} to {high:.0%})"
        )
    for argument in one.with_effect:
        output.print(f"simulate with: --with-effect {argument}")
    for measurement in one.next:
        output.print(f"next: {measurement.name} ({measurement.bits:.2f} bits). {measurement.what}")
    for note in one.notes:
        output.print(f"note: {note}")
    output.print(f"page: {written.page}")


def _span(share: float, interval: tuple[float, float] | None) -> str:
    """A share with its interval."""
    if interval is None:
        return f"{share:.0%}"
    return f"{share:.0%} ({interval[0]:.0%} to {interval[1]:.0%})"
