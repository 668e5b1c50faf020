"""`cusick-bench withheld score`: opens the labels, and prints how good the answers were."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cusick_bench.cli.common import output, print_json, tell, user_errors
from cusick_bench.cli.diagnose.marked_table import marked_table
from cusick_bench.cli.options import Json, Labels, Seed, output_option
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.written_paths import require_csv
from cusick_bench.files.digest import file_digest, names_digest
from cusick_bench.runner.store import write_atomically
from cusick_bench.withheld import NUMERICS_VERSION

if TYPE_CHECKING:
    from pandas import DataFrame

    from cusick_bench.withheld.scoring.failures import Failure
    from cusick_bench.withheld.scoring.score import Scores


_SHOWN = 20  # failures on the terminal; files have them all


@user_errors
def score(
    answers: Annotated[Path, typer.Argument(help="answers.json, as frozen.", metavar="ANSWERS")],
    labels: Labels,
    commitment: Annotated[
        Path | None, typer.Option(help="commitment.json with the published seals; each label must fit its own.")
    ] = None,
    oracle: Annotated[Path | None, typer.Option(help="Closures by the true causes, from `withheld oracle`.")] = None,
    twins: Annotated[
        Path | None, typer.Option(help="How much the cases show, from `withheld twins`; used as their severities.")
    ] = None,
    out: Annotated[Path | None, output_option(help="CSV file for all rows; a page of Markdown goes beside it.")] = None,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Score answers to withheld cases against their labels, beside chance and the baselines within the answers.

    Severities are multiples of the detectable shift if the labels have them, otherwise of the typical severity. With
    --twins they are measured from the silhouettes, as multiples of the detectable shift, also for effects outside the
    list; cases that no other effect can imitate are then counted separately.
    """
    from cusick_bench.withheld.answers.oracle import read_oracle_closures
    from cusick_bench.withheld.answers.shown_shift import read_shown_shifts
    from cusick_bench.withheld.scoring.failures import failures
    from cusick_bench.withheld.scoring.labelled_answers import (
        read_labelled_answers,
        with_measured_severities,
        with_oracle_closures,
    )
    from cusick_bench.withheld.scoring.score import score as score_answers
    from cusick_bench.withheld.scoring.table import document

    require_csv(out, "withheld.csv")
    answered = read_labelled_answers(answers, labels, commitment)
    if oracle is not None:
        answered = with_oracle_closures(answered, read_oracle_closures(oracle), str(oracle))
    if twins is not None:
        answered = with_measured_severities(answered, read_shown_shifts(twins), str(twins))
    with progress_bar("scoring methods") as bar:
        scores = score_answers(answered, seed, progress=bar.show)
    failed = failures(answered, scores.cases)
    facts = _facts(answers, labels, seed, commitment=commitment, oracle=oracle, twins=twins)
    if answered.files:
        facts["cases_sha256"] = names_digest(answered.files)
    if out is not None:
        _write(out, scores, failed, facts)
    if as_json:
        print_json(document(scores, failed, facts))
    else:
        _show(scores, failed)


def _facts(answers: Path, labels: Path, seed: int, **given: Path | None) -> dict[str, Any]:
    """Provenance of the numbers."""
    from cusick_bench.runner.environment import version_text

    digests = map(file_digest, (answers, labels))
    more = "".join(f" --{name} {path.name}" for name, path in given.items() if path is not None)
    return {
        "command": f"cusick-bench withheld score {answers.name} {labels.name} --seed {seed}{more}",
        **dict(zip(("answers_sha256", "labels_sha256"), digests, strict=True)),
        "code_version": version_text({"withheld": NUMERICS_VERSION}),
    }


def _write(out: Path, scores: Scores, failed: list[Failure], facts: dict[str, Any]) -> None:
    from cusick_bench.withheld.scoring.table import markdown, rows

    write_scores(out, rows(scores, failed, facts))
    page = out.with_suffix(".md")
    write_atomically(page, markdown(scores, failed, facts).encode())
    tell(f"wrote {out} and {page}")


def write_scores(out: Path, table: DataFrame) -> None:
    """Writes rows of scores as CSV, in a new folder if need be.

    Args:
        out: The file.
        table: The rows.
    """
    from cusick_bench.files.csv_text import csv_text

    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(out, csv_text(table, float_format="%.6g").encode())


def _show(scores: Scores, failed: list[Failure]) -> None:
    from cusick_bench.withheld.scoring.table import by_severity, headline

    print_scores(headline(scores))
    if levels := by_severity(scores):
        output.print(marked_table(levels))
    listed = [[item.case, ", ".join(item.faults), item.label, item.answer] for item in failed[:_SHOWN]]
    output.print(marked_table([["case", "what is wrong", "label", "answer"], *listed]))
    if len(failed) > _SHOWN:
        output.print(f"... {len(failed) - _SHOWN} more failures: --out FILE.csv lists them all", style="dim")
    for note in scores.notes:
        output.print(note, style="dim", soft_wrap=True)


def print_scores(lines: list[list[str]]) -> None:
    """Prints the main table, lines coloured by whether their goal is reached.

    Args:
        lines: Heading, with a column `reached`, and lines.
    """
    output.print(marked_table(lines, "reached"))
