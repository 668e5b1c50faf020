"""`cusick-bench withheld pool`: figures of several suites together."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from cusick_bench.cli.common import print_json, tell, user_errors
from cusick_bench.cli.diagnose.withheld_score import print_scores, write_scores
from cusick_bench.cli.options import Json, output_option
from cusick_bench.cli.written_paths import require_csv


@user_errors
def pool(
    scores: Annotated[
        list[Path], typer.Argument(help="Tables of `withheld score --out`, one of each suite.", metavar="SCORES.csv...")
    ],
    out: Annotated[Path | None, output_option(help="CSV file for all rows.")] = None,
    as_json: Json = False,
) -> None:
    """Put the scores of several suites together: every share over all of their cases, with one interval.

    Severities must be measured (`score --twins`) in all of the suites with effects or in none.
    """
    from cusick_bench.withheld.scoring.pool import pooled, pooled_lines, pooled_rows, read_score_table, suite_names

    require_csv(out, "pooled.csv")
    tables = [read_score_table(path) for path in scores]
    figures = pooled(tables)
    command = shlex.join(["cusick-bench", "withheld", "pool", *suite_names(tables)])
    if out is not None:
        write_scores(out, pooled_rows(figures, tables, command))
        tell(f"wrote {out}")
    if as_json:
        suites = suite_names(tables)
        rows = [{**one.figure.record(), "suites": dict(zip(suites, one.parts, strict=True))} for one in figures]
        print_json({"figures": rows, "command": command})
    else:
        print_scores(pooled_lines(figures, tables))
