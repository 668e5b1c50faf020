"""`cusick-bench atlas`: drapes over the base model's parameters, from which diagnoses are made."""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from rich.table import Table

from cusick_bench.cli.common import command_with, interruptible, output, print_json, tell, user_errors
from cusick_bench.cli.options import (
    MOST_CASES,
    MOST_SAMPLES,
    MOST_VERTICES,
    Atlas,
    Json,
    Seed,
    Workers,
    output_option,
    simulation_option,
)
from cusick_bench.cli.progress import progress_bar
from cusick_bench.diagnosis.atlas.design import NOT_SIMULATED, Design
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.options import SHIPPED
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.units import shown_unit
from cusick_bench.withheld.errors import WithheldError

if TYPE_CHECKING:
    from cusick_bench.diagnosis.measure.captures import Captures


app = typer.Typer(help="Drapes over the base model's parameters, from which diagnoses are made.")
_PLAN = Design()
_fabrics_option = partial(typer.Option, rich_help_panel="Fabrics")


@app.callback()
def _root() -> None:
    """Drapes over the base model's parameters, from which diagnoses are made."""


@app.command("build")
@user_errors
def build_atlas(
    out: Annotated[Path, output_option(help="Folder of its points; a build that was stopped goes on there.")],
    points: Annotated[
        int, _fabrics_option(min=60, max=MOST_CASES, help="Fabrics, spread over the range of the base model.")
    ] = _PLAN.points,
    stiff_points: Annotated[
        int, _fabrics_option(min=0, max=MOST_CASES, help="Further fabrics that are stiff in shear.")
    ] = _PLAN.stiff_points,
    effect_points: Annotated[
        int, _fabrics_option(min=0, max=MOST_CASES, help="Fabrics draped with every effect too.")
    ] = _PLAN.effect_points,
    fine_points: Annotated[
        int, _fabrics_option(min=0, max=MOST_CASES, help="Fabrics draped by law plate on a finer mesh too.")
    ] = _PLAN.fine_points,
    finest_points: Annotated[
        int, _fabrics_option(min=0, max=MOST_CASES, help="Fabrics draped on a still finer mesh too, if limp.")
    ] = _PLAN.finest_points,
    fine_effect_points: Annotated[
        int, _fabrics_option(min=0, max=MOST_CASES, help="Fabrics draped with every effect on the finer mesh too.")
    ] = _PLAN.fine_effect_points,
    law_points: Annotated[
        int, _fabrics_option(min=0, max=MOST_CASES, help="Fabrics draped under other laws too.")
    ] = _PLAN.law_points,
    one_mesh_points: Annotated[
        int, _fabrics_option(min=0, max=MOST_CASES, help="Fabrics draped with all samples on one mesh too.")
    ] = _PLAN.one_mesh_points,
    samples: Annotated[int, _fabrics_option(min=2, max=MOST_SAMPLES, help="Samples of each fabric.")] = _PLAN.samples,
    vertices: Annotated[
        int, simulation_option(min=100, max=MOST_VERTICES, help="Vertices of the cloth's mesh.")
    ] = _PLAN.vertices,
    workers: Workers = 2,
    as_json: Json = False,
) -> None:
    """Drape fabrics over the base model's range, with and without every effect (about an hour on two cores)."""
    from cusick_bench.diagnosis.atlas.drapes import build

    design = Design(
        points, stiff_points, effect_points, fine_points, finest_points, fine_effect_points, law_points,
        one_mesh_points, samples, vertices,
    )  # fmt: skip
    kept = interruptible(f"the drapes that were ready are kept in {out}", go_on=True)
    with progress_bar("draping") as bar, kept:
        build(out, design, workers=workers, progress=bar.show)
    if as_json:
        print_json({"path": out, "points": points, "tasks": len(design.tasks())})
    else:
        following = command_with("atlas", "fit", out, "--out", "ATLAS.npz")
        output.print(f"{out}: {len(design.tasks())} sets of drapes; next: {following}")


@app.command("fit")
@user_errors
def fit_atlas(
    folder: Annotated[Path, typer.Argument(help="Folder of `build`, complete or not.", metavar="FOLDER")],
    out: Annotated[Path, output_option(help="File to write, outside the installed package.")],
    check: Annotated[bool, typer.Option(help="Also measure what fits leave unexplained in fabrics left out.")] = False,
    as_json: Json = False,
) -> None:
    """Fit smooth functions to the points and write them as one small file, not calibrated yet."""
    from cusick_bench.diagnosis.atlas.emulator_fit import LEAST_POINTS, fit
    from cusick_bench.diagnosis.atlas.points import read_points
    from cusick_bench.diagnosis.atlas.response_check import THIRDS, error_of_means, unexplained
    from cusick_bench.diagnosis.atlas.store import Calibration, save
    from cusick_bench.sim.effects import registered

    design, points = read_points(folder)
    with progress_bar("fitting effects") as bar:
        emulator = fit(design, points, progress=bar.show)
    mismatch = {name: one.mismatch for name, one in emulator.responses.items() if one.mismatch}
    save(out, emulator, Calibration(law_mismatch=mismatch))
    counts = {name: len(found) for name, found in points.items()}
    missing = [name for name in registered() if name not in emulator.responses and name not in NOT_SIMULATED]
    terms = len(emulator.base.fits[0].weights)
    if counts["base"] < 2 * terms:
        tell(
            f"{counts['base']} fabrics are few for means of {terms} terms: fits go nearly through them, so what these "
            f"leave unexplained is not seen, and diagnoses will be too sure; {2 * terms} would do"
        )
    if missing:
        listed = ", ".join(f"{name} ({counts.get(name, 0)})" for name in missing)
        tell(
            f"effects draped with fewer than {LEAST_POINTS} fabrics are left out, no diagnosis will find them: {listed}"
        )
    shares: dict[str, list[float]] = {}
    errors: dict[str, list[float]] = {}
    if check:
        with progress_bar("checking the fits"), interruptible(f"the atlas is written to {out}, but not checked"):
            shares = {name: one.tolist() for name, one in unexplained(design, points, emulator).items()}
            errors = {name: one.tolist() for name, one in error_of_means(design, points, emulator).items()}
    if as_json:
        print_json({"path": out, "points": counts, "unexplained": shares, "error_of_means": errors})
    else:
        if check:
            table = Table("effect", *THIRDS, title="share of the shifts not explained, by thirds of stiffness")
            for name, row in shares.items():
                table.add_row(name, *(f"{share:.2f}" for share in row))
            output.print(table)
            means = Table("statistics", *THIRDS, title="error of the means without effect, in sd between samples")
            for name, row in errors.items():
                means.add_row(name, *(f"{error:.2f}" for error in row))
            output.print(means)
        output.print(
            f"{out}: {counts.get('base', 0)} fabrics; next: "
            f"{command_with('atlas', 'calibrate', 'CASES', 'LABELS', '--atlas', out)}"
        )


@app.command("calibrate")
@user_errors
def calibrate_atlas(
    suites: Annotated[
        list[Path],
        typer.Argument(help="Folder of a suite's cases and its labels.json, in turn.", metavar="CASES LABELS"),
    ],
    atlas: Annotated[
        Path, output_option(help="Fitted atlas, outside the installed package; rewritten with its calibration.")
    ],
    workers: Workers = 2,
    as_json: Json = False,
) -> None:
    """Estimate the noise from suites whose labels are open; answers to these suites must not be scored afterwards."""
    from cusick_bench.diagnosis.atlas.store import load_uncalibrated, save
    from cusick_bench.diagnosis.calibrate import calibrate, looks

    emulator, before = load_uncalibrated(atlas)
    found = [case for cases, labels in _pairs(suites) for case in _open_cases(cases, labels)]
    with progress_bar("cases", looks([truth for _, truth in found])) as bar:
        after = calibrate(found, emulator, before, workers=workers, step=bar.advance)
    save(atlas, emulator, after)
    if as_json:
        print_json({"path": atlas, "before": asdict(before), "after": asdict(after)})
    else:
        output.print(
            f"{atlas}: {after.discrepancy:g} of the atlas' discrepancy, noise x {after.inflation:g}, "
            f"from {after.cases} cases without effect"
        )


def _pairs(suites: list[Path]) -> list[tuple[Path, Path]]:
    """Cases and labels of every suite."""
    if len(suites) % 2:
        raise DiagnosisError(
            f"every suite needs its folder of cases and its labels.json, got {len(suites)} paths; give CASES LABELS "
            "of one suite after the other"
        )
    return list(zip(suites[::2], suites[1::2], strict=True))


def _open_cases(cases: Path, labels: Path) -> list[tuple[Captures, str]]:
    """Silhouettes of a suite's cases with the name of what acts there, without pairs, which have no single name."""
    from cusick_bench.withheld.answers.blind import case_captures, case_folders
    from cusick_bench.withheld.format.label import read_label_documents

    known = read_label_documents(labels)
    found: list[tuple[Captures, str]] = []
    for folder in case_folders(cases):
        if folder.name not in known:
            raise WithheldError(f"{labels} lacks {folder.name}; give the labels of these cases")
        truth = known[folder.name].effects
        if len(truth) == 1:  # pairs have two
            found.append((case_captures(folder), truth[0]))
    return found


@app.command("power")
@user_errors
def power(
    atlas: Atlas = SHIPPED,
    out: Annotated[
        Path | None, output_option(help="JSON file of the severities, as `withheld generate --detectable` takes.")
    ] = None,
    samples: Annotated[
        int, typer.Option(min=2, max=MOST_SAMPLES, help="Samples of a fabric, on both sides, each captured twice.")
    ] = 12,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Detectable severity of every effect: found in 80 % of fabrics, at 5 % false alarms over all causes together."""
    from cusick_bench.diagnosis.atlas.store import load
    from cusick_bench.diagnosis.inference.detectability.power import FABRICS, STIFFNESS, detectable, needed
    from cusick_bench.sim.effects import registered

    emulator, calibration = load(atlas)
    with progress_bar("fabrics", len(STIFFNESS) * FABRICS) as bar:
        shift = needed(emulator, calibration, np.random.default_rng(seed))
        inflation = calibration.inflation
        severity = detectable(emulator, shift, inflation=inflation, samples=samples, step=bar.advance)
    found = {"stiffness": STIFFNESS, "severity": dict(severity)}
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(out, (json.dumps(found, indent=1) + "\n").encode())
    if as_json:
        print_json({**found, "needed": shift, "samples": samples})
        return
    levels = [f"{level:g}" for level in STIFFNESS]
    table = Table("effect", "unit", *levels, "|d|", title="by ln B / (rho g R^3); |d| it takes", padding=(0, 0))
    for name, one in registered().items():
        row = found["severity"].get(name, (None,) * len(levels))
        unit, factor = ("mm", 1e3) if one.severity.unit == "m" else (shown_unit(one.severity.unit), 1.0)
        cells = ["" if value is None else f"{factor * value:.2g}" for value in row]
        table.add_row(name, unit, *cells, f"{shift[name]:.1f}" if name in shift else "")
    output.print(table)


@app.command("separation")
@user_errors
def separation(
    atlas: Atlas = SHIPPED,
    out: Annotated[
        Path | None, output_option(help="Table of all pairs, comma-separated, with a line for each pair and stiffness.")
    ] = None,
    leave_out: Annotated[
        list[str] | None,
        typer.Option(help="Group of statistics to leave out, again for each; by default what tells pairs apart best."),
    ] = None,
    shown: Annotated[int, typer.Option(min=0, max=MOST_CASES, help="Pairs to print, the most alike first.")] = 20,
    samples: Annotated[
        int, typer.Option(min=2, max=MOST_SAMPLES, help="Samples of a fabric, on both sides, each captured twice.")
    ] = 12,
    as_json: Json = False,
) -> None:
    """Separation of every pair of effects at three stiffnesses, with all statistics and without some groups."""
    from cusick_bench.diagnosis.atlas.store import load
    from cusick_bench.diagnosis.inference.detectability.separation import LEVELS, NEW_GROUPS, separations, summary

    emulator, _ = load(atlas)
    left_out = tuple(leave_out or NEW_GROUPS)
    found = []
    with progress_bar("stiffnesses", len(LEVELS)) as bar:
        for level in LEVELS:
            found += separations(emulator, level, left_out=left_out, samples=samples)
            bar.advance()
    if out is not None:
        lines = [f"{one.level:g},{one.first},{one.second},{one.without:.2f},{one.full:.2f}" for one in found]
        out.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(out, ("\n".join(["bending,first,second,without,all", *lines]) + "\n").encode())
    figures = {f"{level:g}": summary([one for one in found if one.level == level]) for level in LEVELS}
    if as_json:
        print_json(
            {"left_out": left_out, "samples": samples, "levels": figures, "pairs": [asdict(one) for one in found]}
        )
        return
    table = Table("bending", "first", "second", "without", "all", title="separation [sd of noise]")
    for one in sorted(found, key=lambda one: one.without)[:shown]:
        table.add_row(f"{one.level:g}", one.first, one.second, f"{one.without:.1f}", f"{one.full:.1f}")
    output.print(table)
    for level, row in figures.items():
        output.print(
            f"bending {level}: median {row['median_full']:.1f}, {row['median_without']:.1f} without "
            f"{', '.join(left_out)}; below 2: {100 * row['alike_full']:.0f} % of pairs, "
            f"{100 * row['alike_without']:.0f} % without"
        )
