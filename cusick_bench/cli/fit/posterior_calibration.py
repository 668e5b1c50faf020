"""`cusick-bench posterior-calibration`: do solvers' intervals of stiffness hold the truth as often as they say?"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from cusick_bench.cli.common import command_line, interruptible, output, print_json, tell, user_errors
from cusick_bench.cli.options import (
    LAW,
    MOST_CASES,
    Budget,
    Json,
    Law,
    Seed,
    Solvers,
    Vertices,
    Workers,
    fit_option,
    output_option,
)
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.written_paths import folder_made

if TYPE_CHECKING:
    from cusick_bench.benchmark.posterior_calibration.calibration import CalibrationFit, CalibrationPlan, FailedFit
    from cusick_bench.benchmark.posterior_calibration.table import FitFile

app = typer.Typer()
_VERTICES = 297  # on much coarser meshes limp cloth stands stiffly, and a silhouette no longer tells its stiffness


@app.command(name="posterior-calibration")
@user_errors
def posterior_calibration(
    solver: Solvers = None,
    fits: Annotated[int, fit_option(min=1, max=MOST_CASES, help="Cloths drawn from its prior, and fitted.")] = 100,
    budget: Budget = 1000.0,
    law: Law = LAW,
    vertices: Vertices = _VERTICES,
    seed: Seed = 0,
    workers: Workers = 2,
    out: Annotated[
        Path | None, output_option(help="Folder for finished fits, and a table of them as CSV and Markdown.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Fit cloths whose stiffness is known, and count how often the intervals hold it (simulation-based calibration).

    Cloths are drawn from the prior that a solver assumes, so that only its inference is tested. With --out, repeating
    the command goes on where it was stopped. A fit that fails is not in the table; the exit status is then 1.
    """
    from cusick_bench.benchmark.posterior_calibration.calibration import CalibrationPlan, calibration_table
    from cusick_bench.benchmark.posterior_calibration.table import FitFile

    solvers = dict.fromkeys(solver or [CalibrationPlan.solver])
    plans = [CalibrationPlan(one, fits, vertices, budget, law.value, seed) for one in solvers]
    file = None if out is None else FitFile(out)
    finished: dict[CalibrationPlan, list[CalibrationFit]] = {}
    failed: list[str] = []
    for plan in plans:
        finished[plan], without_answer = _fitted(plan, file, workers)
        failed += [f"{plan.solver}, fit {one.number}: {one.failure}" for one in without_answer]
    for text in failed:
        tell(f"failed: {text}; it is not in the table")
    rows = [
        {"solver": plan.solver, **row} for plan, some in finished.items() if some for row in calibration_table(some)
    ]
    if file is not None and rows:
        for path in file.write_table(rows, plans, command_line()):
            tell(f"wrote {path}")
    if as_json:
        plain = [{**asdict(plan), "made": [asdict(one) for one in some]} for plan, some in finished.items()]
        print_json({"directions": rows, "plans": plain, "failed": failed})
    else:
        _print_table(rows, plans[0])
    if failed:
        raise typer.Exit(1)


def _fitted(plan: CalibrationPlan, file: FitFile | None, workers: int) -> tuple[list[CalibrationFit], list[FailedFit]]:
    """Makes the fits that the file lacks; all that are finished, in order, and those that failed."""
    from cusick_bench.benchmark.posterior_calibration.calibration import FailedFit, calibration_fits

    fits, failed = {} if file is None else file.read(plan), []
    lacking = [number for number in range(plan.fits) if number not in fits]
    kept = "nothing was written" if file is None else f"finished fits are kept in {file.out}"
    room = folder_made(None if file is None else file.out)
    with room, progress_bar("fitting", len(lacking)) as bar, interruptible(kept, go_on=file is not None):
        for fit in calibration_fits(plan, lacking, workers):
            if isinstance(fit, FailedFit):
                failed.append(fit)
            else:
                fits[fit.number] = fit
                if file is not None:
                    file.keep(fit)
            bar.advance()
    return [fits[number] for number in sorted(fits)], failed


def _print_table(rows: list[dict[str, Any]], plan: CalibrationPlan) -> None:
    title = f"{plan.fits} cloths of each solver's prior, {plan.vertices} vertices, law {plan.law}"
    table = Table(
        "solver", "bending", "fits", "50 % interval holds", "90 % interval holds", "ranks", "p", "found / true",
        title=title,
    )  # fmt: skip
    for row in rows:
        table.add_row(
            row["solver"],
            row["direction"],
            str(row["fits"]),
            *(_share(row, name) for name in ("cover_50", "cover_90")),
            " ".join(map(str, row["ranks"])),
            f"{row['p_uniform']:.2g}",
            f"{row['bias']:.2f} (×/÷ {row['error']:.2f})",
        )
    output.print(table)


def _share(row: dict[str, Any], name: str) -> str:
    return f"{row[name]:.0%} [{row[f'{name}_low']:.0%}, {row[f'{name}_high']:.0%}]"
