"""Finished runs of optimisers on test functions, kept a line each, and the table that is made of all of them.

OUT/optimisers.jsonl   a line a run, whole or absent: a command that was stopped goes on where it was
OUT/optimisers.csv     a line a method and function, in full
OUT/optimisers.md      the same to read, and where we differ from what was published

Runs count as long as the versions of their numerics are those of the code at hand: after a change of a solver's numbers
its runs are made again.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pydantic import TypeAdapter
from scipy.stats import t as student

from cusick_bench.benchmark.optimisers.functions import FUNCTIONS, BenchmarkError
from cusick_bench.benchmark.optimisers.runs import (
    METHODS,
    PUBLISHED,
    PUBLISHED_RUNS,
    Finished,
    Published,
    run_numerics,
    summary,
)
from cusick_bench.files import parse_json, read_text
from cusick_bench.files.csv_text import csv_text
from cusick_bench.runner.store import append_line, write_atomically

_MOST_BYTES = 64 << 20
_FINISHED = TypeAdapter(Finished)
_BEFORE_VERSIONS = {field.name for field in fields(Finished)} - {"numerics", "code"} | {"code_version"}
"""Keys of a run of before the numerics had versions, which counts no more."""

APART = 2.0  # standard errors of the difference beyond which two means of many runs are said to differ
_TAIL = 0.025  # beyond which they are by Student's t, where few runs tell little of the standard error
REMARKS = {
    (
        "branin",
        "sobol",
    ): "The published 5.179 of Sobol points is what 10 uniform points reach (5.7); 50 reach 1.43, whatever D",
}
"""What a reader must know of a published figure, by function and method."""

_Question = tuple[str, int, int]  # function, dimension, evaluations


@dataclass(frozen=True)
class RunFile:
    """File of finished runs.

    Attributes:
        out: Folder.
    """

    out: Path

    @property
    def path(self) -> Path:
        """The file with a line a run."""
        return self.out / "optimisers.jsonl"

    def read(self) -> list[Finished]:
        """Runs made with the numerics of this code, each once; a last line that a crash cut off is left out.

        Raises:
            BenchmarkError: The file holds something else.
        """
        if not self.path.exists():
            return []
        names, found = {field.name for field in fields(Finished)}, []
        remedy = "delete it, or choose another --out"
        *lines, _ = read_text(self.path, most_bytes=_MOST_BYTES, remedy=remedy).split("\n")
        for number, line in enumerate(lines, start=1):
            try:
                record = parse_json(line, self.path, remedy=remedy)
                if set(record) == _BEFORE_VERSIONS:
                    continue
                if set(record) != names:
                    raise ValueError(f"its keys must be {', '.join(sorted(names))}")
                run = _FINISHED.validate_json(line, strict=True)
            except (ValueError, TypeError) as error:
                raise BenchmarkError(
                    f"{self.path}, line {number} is no finished run ({error}); delete it, or choose another --out"
                ) from error
            found.append(run)
        once = {(run.function, run.dimension, run.evaluations, run.method, run.seed, run.run): run for run in found}
        known = [run for run in once.values() if run.method in METHODS and run.function in FUNCTIONS]
        return [run for run in known if run.numerics == run_numerics(run.function, run.method)]

    def keep(self, run: Finished) -> None:
        """Adds a finished run.

        Args:
            run: The finished run.
        """
        append_line(self.path, json.dumps(asdict(run)))


def table_rows(runs: Iterable[Finished]) -> list[dict[str, Any]]:
    """A line a function and method: ours, theirs, and whether they differ.

    Args:
        runs: Finished runs.

    Returns:
        Lines in the order of `METHODS`; `differs` is "lower" or "higher" where our mean is more than `APART` standard
        errors of the difference from the published one, of few runs more than Student's t has at 5 %, "no" where it is
        not, and "" where nothing is published, or where one run has no standard error.
    """
    groups: dict[_Question, dict[str, list[Finished]]] = {}
    for run in runs:
        groups.setdefault((run.function, run.dimension, run.evaluations), {}).setdefault(run.method, []).append(run)
    lines = []
    for question, by_method in sorted(groups.items()):
        for method in sorted(by_method, key=list(METHODS).index):
            lines.append(_line(question, method, by_method[method]))
    return lines


def write_table(rows: Sequence[dict[str, Any]], out: Path, facts: Sequence[str]) -> list[Path]:
    """Writes the lines as CSV and as Markdown.

    Args:
        rows: From `table_rows`.
        out: Folder.
        facts: Sentences for the end of the Markdown: commands, hardware.

    Returns:
        Paths of the two files.
    """
    csv, text = out / "optimisers.csv", out / "optimisers.md"
    write_atomically(csv, csv_text(pd.DataFrame(rows)).encode())
    write_atomically(text, markdown_table(rows, facts).encode())
    return [csv, text]


def markdown_table(rows: Sequence[dict[str, Any]], facts: Sequence[str] = ()) -> str:
    """The lines as Markdown: a table a function, and below it where our means differ from the published ones.

    Args:
        rows: From `table_rows`.
        facts: Sentences for its end.

    Returns:
        Text.
    """
    parts = [
        "# Gradient-free solvers on published test functions",
        "A few coordinates of [-1, 1]^D matter, drawn anew for every run. Best value found, mean ± standard error; the "
        "published figures are of 50 runs (Letham et al., NeurIPS 2020). z is the difference of the means in its "
        f"standard errors; beyond {APART:g}, of few runs beyond Student's t at 5 %, the two are said to differ. As "
        "many runs as published, of one function: "
        "`cusick-bench optimisers --function NAME --runs 50 --out DIR`.",
    ]
    questions = dict.fromkeys((row["function"], row["dimension"], row["evaluations"]) for row in rows)
    for function, dimension, evaluations in questions:
        own = [
            row
            for row in rows
            if (row["function"], row["dimension"], row["evaluations"]) == (function, dimension, evaluations)
        ]
        optimum = FUNCTIONS[function].optimum
        parts += [
            f"## {function}, D = {dimension}, {evaluations} evaluations (optimum {optimum:.3f})",
            "\n".join(_markdown_lines(own)),
            _verdict(own),
        ]
    return "\n\n".join([*parts, *facts]) + "\n"


def _line(question: _Question, method: str, runs: list[Finished]) -> dict[str, Any]:
    function, dimension, evaluations = question
    published = PUBLISHED.get(question, {}).get(method)
    found = summary([run.best for run in sorted(runs, key=lambda run: (run.seed, run.run))], published)
    z = found["z"]
    return {
        "function": function,
        "dimension": dimension,
        "evaluations": evaluations,
        "method": method,
        "runs": len(runs),
        "mean": found["mean"],
        "standard_error": found["standard_error"],
        "median": found["median"],
        "published_mean": published.mean if published else nan,
        "published_standard_error": published.standard_error if published else nan,
        "published_median": published.median if published and published.median is not None else nan,
        "z": z,
        "differs": "" if published is None or not isfinite(z) else _differs(z, found, published, len(runs)),
        "seconds_per_run": float(np.median([run.seconds for run in runs])),  # a run may have been suspended
        "seeds": " ".join(sorted({str(run.seed) for run in runs})),
        "code_version": "; ".join([runs[0].numerics, *dict.fromkeys(run.code for run in runs)]),
    }


def _differs(z: float, found: dict[str, Any], published: Published, runs: int) -> str:
    """Where our mean lies beside the published one; degrees of freedom are Welch's."""
    own, other = found["standard_error"] ** 2, published.standard_error**2
    freedom = (own + other) ** 2 / (own**2 / (runs - 1) + other**2 / (PUBLISHED_RUNS - 1))
    if abs(z) <= max(APART, float(student.isf(_TAIL, freedom))):
        return "no"
    return "lower" if z < 0 else "higher"


def mean_in_words(mean: float, error: float) -> str:
    """A mean with its standard error.

    Args:
        mean: The mean.
        error: Its standard error; NaN of a single run.

    Returns:
        Such as "1.433 ± 0.165".
    """
    return f"{mean:.3f} ± {error:.3f}" if isfinite(error) else f"{mean:.3f}"


def _markdown_lines(rows: Sequence[dict[str, Any]]) -> list[str]:
    heads = ("method", "runs", "ours", "median", "published", "median", "z", "seconds a run")
    lines = [f"| {' | '.join(heads)} |", "| :--- |" + " ---: |" * (len(heads) - 1)]
    for row in rows:
        theirs = isfinite(row["published_mean"])
        entries = (
            row["method"],
            str(row["runs"]),
            mean_in_words(row["mean"], row["standard_error"]),
            f"{row['median']:.3f}",
            mean_in_words(row["published_mean"], row["published_standard_error"]) if theirs else "",
            f"{row['published_median']:.3f}" if isfinite(row["published_median"]) else "",
            f"{row['z']:+.1f}" if isfinite(row["z"]) else "",
            f"{row['seconds_per_run']:.1f}",
        )
        lines.append(f"| {' | '.join(entries)} |")
    return lines


def _verdict(rows: Sequence[dict[str, Any]]) -> str:
    """Sentences on which methods agree with the published results, and which do not."""
    words = {
        "no": "no difference is shown",
        "lower": "find less, which is better",
        "higher": "find more, which is worse",
    }
    said = []
    for differs, meaning in words.items():
        if names := [f"{row['method']} (z {row['z']:+.1f})" for row in rows if row["differs"] == differs]:
            said.append(f"{meaning}: {', '.join(names)}")
    open_rows = [row for row in rows if row["differs"] == ""]
    for why, published in (("too few runs to compare", True), ("nothing is published to compare with", False)):
        if names := [row["method"] for row in open_rows if isfinite(row["published_mean"]) == published]:
            said.append(f"{why}: {', '.join(names)}")
    if missing := [name for name in METHODS if name not in {row["method"] for row in rows}]:
        said.append(f"not run here: {', '.join(missing)}")
    remarks = [REMARKS[key] for row in rows if (key := (row["function"], row["method"])) in REMARKS]
    return "".join([f"Beside the published means, {'; '.join(said)}.", *(f" {text}." for text in remarks)])
