"""`cusick-bench diagnose-controls`: whether a diagnosis of real cloth finds planted effects, and no others."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cusick_bench.cli.common import interruptible, output, print_json, tell, user_errors
from cusick_bench.cli.completion import complete_cloth
from cusick_bench.cli.diagnose.marked_table import marked_table
from cusick_bench.cli.options import Atlas, DiagnosedData, Force, Json, Seed, WithoutEffect, Workers, output_option
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.written_paths import folder_made, require_csv
from cusick_bench.diagnosis import NUMERICS_VERSION
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.options import SHIPPED, Options, repeated_option
from cusick_bench.files.digest import file_digest
from cusick_bench.runner.store import write_atomically

if TYPE_CHECKING:
    from cusick_bench.datasets.dataset import DrapeDataset
    from cusick_bench.diagnosis.controls.judgement import Judgement


app = typer.Typer()
_MOST_HALVES = 100


@app.command("diagnose-controls")
@user_errors
def diagnose_controls(
    data: DiagnosedData = "cusick",
    fabric: Annotated[
        list[str] | None,
        typer.Option(
            "--cloth",
            "--fabric",
            help="Cloth to test the diagnosis on; repeatable; by default all with six samples or more.",
            autocompletion=complete_cloth,
        ),
    ] = None,
    control: Annotated[
        list[str] | None,
        typer.Option(help="Control, such as `shift` or `halves`; repeatable; by default all."),
    ] = None,
    halves: Annotated[
        int, typer.Option(min=0, max=_MOST_HALVES, help="How often each face is divided into random halves.")
    ] = 2,
    without_effect: WithoutEffect = None,
    atlas: Atlas = SHIPPED,
    out: Annotated[
        Path, output_option(help="CSV file of all controls and shares; a page of Markdown goes beside it.")
    ] = Path("runs/diagnose-controls.csv"),
    seed: Seed = 0,
    workers: Workers = 2,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Test the diagnosis on real cloth by known effects, planted in its pictures or known from the data.

    Pictures are shifted, scaled, turned, cut at another grey level, seen by a near camera, mirrored and shuffled, at
    two strengths; halves of one face are presented as its two faces. Each is diagnosed with and without the change (no
    simulations; some minutes for each fabric). Repeating the command goes on with the fabrics that the table lacks.
    """
    from cusick_bench.datasets import load
    from cusick_bench.diagnosis.atlas.store import load as load_atlas
    from cusick_bench.diagnosis.controls.known_answers import CONTROLS, LEAST_SAMPLES
    from cusick_bench.diagnosis.controls.run import controlled, fabric_under_control, fabrics_to_control
    from cusick_bench.diagnosis.controls.table import read_judgements
    from cusick_bench.sim.effects import effect

    require_csv(out, "controls.csv")
    if unknown := [name for name in control or () if name not in CONTROLS]:
        raise DiagnosisError(f"no control is called {unknown[0]!r}; use {', '.join(CONTROLS)}")
    options = Options(0, False, tuple(effect(name).name for name in without_effect or ()), seed)
    emulator, calibration = load_atlas(atlas)
    with progress_bar("reading data") as bar:
        dataset = load(data, progress=bar.show)
    chosen = list(dict.fromkeys(fabric or fabrics_to_control(dataset)))
    if not chosen:
        raise DiagnosisError(
            f"no fabric of {data} has {LEAST_SAMPLES} samples, from which on all controls can be tried; photograph "
            "more, or name a fabric with --fabric for the controls that it allows"
        )
    words = ["cusick-bench", "diagnose-controls", data]
    words += [*repeated_option("--fabric", fabric or ()), *repeated_option("--control", control or ())]
    words += ["--halves", str(halves), *repeated_option("--without-effect", options.without)]
    words += [] if atlas == SHIPPED else ["--atlas", str(atlas)]
    words += ["--seed", str(seed), *(["--force"] if force else [])]
    facts = _facts(shlex.join(words), dataset, atlas)
    judgements = read_judgements(out, facts)
    over = {one.fabric for one in judgements}
    if over:
        tell(f"going on with {out}, which has {', '.join(sorted(over))}")
    elif out.exists():
        tell(f"{out} is of other options, data, atlas or code; it is replaced when the first fabric is ready")
    kept = interruptible(
        lambda: f"the fabrics that were ready are in {out}" if judgements else "nothing was written", go_on=True
    )
    with progress_bar("reading data", len(chosen)) as bar, kept, folder_made(out.parent):
        for number, name in enumerate(chosen):
            if name in over:
                continue
            under = fabric_under_control(dataset, name, halves=halves, seed=seed, force=force)

            def step(what: str, share: float, name: str = name, number: int = number) -> None:
                bar.tell(f"{name}: {what}", number + share)

            judgements += controlled(
                under, emulator, calibration, options, names=control or (), workers=workers, progress=step
            )
            if judgements:
                _write(out, judgements, facts)
    if not judgements:
        raise DiagnosisError(
            f"none of {', '.join(control or CONTROLS)} can be tried on {', '.join(chosen)}: controls need faces, "
            f"repeated captures, meshes or (halves) {LEAST_SAMPLES} samples that are not there; leave --control "
            "out, or name other fabrics"
        )
    _write(out, judgements, facts)  # both files again: a kill may have come between them
    tell(f"wrote {out} and {out.with_suffix('.md')}")
    _print(judgements, facts, as_json)


def _facts(command: str, dataset: DrapeDataset, atlas: Path) -> dict[str, Any]:
    """Provenance of the numbers; a table with another provenance is not continued."""
    from cusick_bench.runner.environment import version_text
    from cusick_bench.runner.numerics import diagnosis_numerics

    version = version_text(diagnosis_numerics(diagnosis=NUMERICS_VERSION))
    digests = {"data_sha256": dataset.content_hash, "atlas_sha256": file_digest(atlas)}
    return {"command": command, "code": version, **digests}


def _write(out: Path, judgements: list[Judgement], facts: dict[str, Any]) -> None:
    from cusick_bench.diagnosis.controls.figures import figures
    from cusick_bench.diagnosis.controls.table import markdown, rows
    from cusick_bench.files.csv_text import csv_text

    shares = figures(judgements)
    write_atomically(out, csv_text(rows(judgements, shares, facts)).encode())
    write_atomically(out.with_suffix(".md"), markdown(judgements, shares, facts).encode())


def _print(judgements: list[Judgement], facts: dict[str, Any], as_json: bool) -> None:
    from cusick_bench.diagnosis.controls.figures import figures
    from cusick_bench.diagnosis.controls.table import control_lines, document, share_lines

    shares = figures(judgements)
    if as_json:
        print_json(document(judgements, shares, facts))
        return
    controls = control_lines(judgements)
    output.print(marked_table(controls, "hit"))
    lines = share_lines(shares)
    output.print(marked_table(lines, "reached"))
