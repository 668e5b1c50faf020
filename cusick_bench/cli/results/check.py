"""`cusick-bench check`: the regression gate.

Exit status 1 where a solver has become worse than the baseline, 3 where nothing could be decided.
"""

from __future__ import annotations

from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich import box
from rich.table import Table

from cusick_bench.cli.common import UNDECIDED, command_with, output, print_json, tell, user_errors
from cusick_bench.cli.options import Json, Seed, output_option
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.written_paths import outside_package
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.leaderboard.metric_name import GATED, metric_called

if TYPE_CHECKING:
    from cusick_bench.leaderboard.gate.check import Finding, Outcome


_TESTS = {"permutation": "perm.", "t": "t", "none": "none"}
_STYLES = {"regression": "bold red", "undecided": "yellow", "new": "cyan"}

app = typer.Typer()


@app.command("check")
@user_errors
def check_command(
    run: Annotated[Path, typer.Argument(help="Folder of `run --out`, or a CSV or JSON file of cells.", metavar="RUN")],
    against: Annotated[Path, typer.Option(help="Baseline: a CSV or JSON file of cells, or another run's folder.")],
    metric: Annotated[
        list[str] | None,
        typer.Option(
            help="Metric to compare, of which smaller is better, in full or short; repeatable; "
            f"by default {', '.join(GATED)}."
        ),
    ] = None,
    level: Annotated[float, typer.Option(help="Family-wise probability of a false alarm.")] = 0.05,
    minimum: Annotated[float, typer.Option("--minimum-effect", help="Least relative change that matters.")] = 0.02,
    write: Annotated[bool, typer.Option("--write", help="Make the baseline of RUN instead of comparing.")] = False,
    junit: Annotated[
        Path | None, output_option(help="File for the verdicts as JUnit XML, which CI shows as tests.")
    ] = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Find which solvers have become worse than a committed baseline.

    Exit status 0 if none has, 1 if any has, 2 if an input is bad (a metric that is NaN or impossible, a solver without
    a name), 3 if nothing could be decided: no cells in common, or too few.

    Runs with the same or with other seeds can be compared: cells are paired by cloth, and by seed where both have it.
    Make a baseline with --write, and commit it.
    """
    from cusick_bench.leaderboard.gate.baseline import read_cells, write_baseline
    from cusick_bench.leaderboard.gate.check import Gate, check, metrics_of_both

    if write and (metric or junit is not None):
        raise LeaderboardError(
            "--write compares nothing: leave --metric and --junit out; a baseline keeps all that can be compared"
        )
    gate = Gate(level=level, minimum=minimum, seed=seed)
    with progress_bar("reading cells") as bar:
        cells = read_cells(run, progress=bar.show)
    if write:
        outside_package(against)
        write_baseline(cells, against, _facts(run))
        tell(f"wrote {against}: {len(cells)} cells")
        if as_json:
            print_json({"baseline": against, "cells": len(cells)})
        return
    if not against.exists():
        raise LeaderboardError(
            f"no baseline at {against}; make one with `{command_with('check', run, '--against', against, '--write')}`"
        )
    with progress_bar("reading the baseline") as bar:
        baseline = read_cells(against, progress=bar.show)
    if metric:
        both = metrics_of_both(cells, baseline)
        gate = replace(gate, metrics=tuple(metric_called(name, both) for name in metric))
    with progress_bar("comparing"):
        outcome = check(cells, baseline, gate)
    if junit is not None:
        from cusick_bench.leaderboard.gate.junit import junit as junit_xml
        from cusick_bench.runner.store import write_atomically

        junit.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(junit, junit_xml(outcome))
        tell(f"wrote {junit}")
    _show(outcome, as_json)
    if outcome.regressions:
        raise typer.Exit(1)
    if not outcome.decided:
        raise typer.Exit(UNDECIDED)


def _facts(run: Path) -> list[str]:
    """Head of a baseline: what made it."""
    from cusick_bench.leaderboard.cells.commands import typed
    from cusick_bench.leaderboard.cells.loading import read_run
    from cusick_bench.runner.environment import code_text

    facts = ["Baseline of `cusick-bench check`: metrics of every cell; compare a run with `check RUN --against` this."]
    made = read_run(run) if run.is_dir() else {}
    for earlier in [*made.get("history", []), made] if made else []:
        facts.append(f"command: {typed(earlier.get('command', ''))}")
    if made:
        hardware = (made.get(key) for key in ("processor", "platform", "cores"))
        facts.append(f"made: {made.get('time')}, code: {code_text(made)}, on {' '.join(map(str, hardware))} cores")
    return list(dict.fromkeys(facts))


def _show(outcome: Outcome, as_json: bool) -> None:
    if as_json:
        findings = [finding.record() for finding in outcome.findings]
        print_json(
            {
                "regressions": len(outcome.regressions),
                "decided": outcome.decided,
                "findings": findings,
                "notes": list(outcome.notes),
            }
        )
        return
    output.print(_table(outcome))
    for note in outcome.notes:
        output.print(note, style="dim", soft_wrap=True)
    if outcome.regressions:
        output.print(f"{len(outcome.regressions)} regressions", style="bold red")
    elif outcome.decided:
        output.print("no regression", style="bold green")
    else:
        output.print("nothing could be decided: no cells in common, or too few", style="bold yellow")


def _table(outcome: Outcome) -> Table:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for head in ("verdict", "solver", "metric", "before", "now", "ratio [95 %]", "p (Holm)", "test", "could see", ""):
        folded = head in ("solver", "")
        table.add_column(head, no_wrap=not folded, overflow="fold", min_width=18 if head == "solver" else None)
    for finding in outcome.findings:
        test = finding.comparison
        table.add_row(
            finding.verdict,
            finding.solver,
            finding.metric,
            _number(finding.before),
            _number(finding.after),
            _ratio(finding),
            _p(finding.p),
            f"{_TESTS[test.test]}, n = {test.units}" if test else "",
            _times(test.detectable) if test else "",
            finding.detail,
            style=_STYLES.get(finding.verdict, ""),
        )
    return table


def _number(value: float) -> str:
    return f"{value:.5f}" if isfinite(value) else ""


def _p(value: float) -> str:
    return "" if not isfinite(value) else "< .001" if value < 1e-3 else f"{value:.3f}"


def _times(value: float) -> str:
    return f"x {value:.3g}" if isfinite(value) else ""


def _ratio(finding: Finding) -> str:
    ratio = finding.ratio
    interval = f" [{ratio.low:.3g}, {ratio.high:.3g}]" if isfinite(ratio.low) else ""
    return f"{_times(ratio.value)}{interval}" if isfinite(ratio.value) else ""
