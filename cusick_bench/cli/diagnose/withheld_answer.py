"""`cusick-bench withheld answer`: diagnoses withheld cases blind and freezes the answers.

With `oracle` and `twins`, which say afterwards what the best answers could be.
"""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from cusick_bench.cli.common import output, print_json, progress_bar, user_errors
from cusick_bench.diagnosis.atlas.store import SHIPPED
from cusick_bench.diagnosis.diagnose import Options
from cusick_bench.diagnosis.simulation.closure import Draping
from cusick_bench.sim.effects import effect
from cusick_bench.withheld.answers.blind import answer_suite, case_folders
from cusick_bench.withheld.answers.oracle import oracle_closures
from cusick_bench.withheld.answers.twins import twins as make_twins
from cusick_bench.withheld.format.checked_json import read_object
from cusick_bench.withheld.suite.generate import SUITE, read_suite


@user_errors
def answer(
    cases: Annotated[Path, typer.Argument(help="Folder of the cases.", metavar="CASES")],
    out: Annotated[Path, typer.Option(help="File for the answers.")] = Path("answers.json"),
    samples: Annotated[
        int, typer.Option(min=0, help="Simulated samples where a cause is named; 0 leaves gap and closure out.")
    ] = Options.samples,
    without: Annotated[list[str] | None, typer.Option(help="Effect not to consider (repeatable).")] = None,
    atlas: Annotated[Path, typer.Option(help="Fitted atlas.")] = SHIPPED,
    seed: Annotated[int, typer.Option(min=0, help="Of simulations and tests.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 2,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on standard output.")] = False,
) -> None:
    """Answers every case from its silhouettes alone; answers that are there already are kept."""
    options = Options(samples, False, tuple(effect(name).name for name in without or ()), seed)
    with progress_bar("cases", len(case_folders(cases))) as bar:
        found = answer_suite(cases, out, atlas, options, workers=workers, step=lambda case: bar.advance())
    if as_json:
        print_json({"path": out, "cases": len(found["answers"]), "code_version": found["code_version"]})
    else:
        output.print(f"{out}: {len(found['answers'])} answers, frozen by {found['code_version']}")


@user_errors
def oracle(
    cases: Annotated[Path, typer.Argument(help="Folder of the cases.", metavar="CASES")],
    labels: Annotated[Path, typer.Argument(help="labels.json of the same cases.", metavar="LABELS")],
    out: Annotated[Path, typer.Option(help="File for the closures.")] = Path("oracle.json"),
    samples: Annotated[int, typer.Option(min=2, help="Simulated samples.")] = Options.samples,
    atlas: Annotated[Path, typer.Option(help="Fitted atlas.")] = SHIPPED,
    seed: Annotated[int, typer.Option(min=0, help="Of simulations.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 2,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on standard output.")] = False,
) -> None:
    """How far the true cause closes the gap of every case, for `score`; after the answers, as it opens the labels."""
    known = read_object(labels)
    with progress_bar("cases") as bar:
        found = oracle_closures(
            cases, known, out, atlas, Draping(samples, seed), workers=workers, step=lambda case: bar.advance()
        )
    if as_json:
        print_json({"path": out, "closures": found})
    else:
        output.print(f"{out}: {sum(value is not None for value in found.values())} of {len(found)} cases have a gap")


@user_errors
def twins(
    cases: Annotated[Path, typer.Argument(help="Folder of the cases.", metavar="CASES")],
    labels: Annotated[
        Path, typer.Argument(help="labels.json of the same cases, with suite.json beside it.", metavar="LABELS")
    ],
    out: Annotated[Path, typer.Option(help="File for what the cases show.")] = Path("twins.json"),
    atlas: Annotated[Path, typer.Option(help="Fitted atlas.")] = SHIPPED,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 2,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document on standard output.")] = False,
) -> None:
    """Drapes every case again without its effect, to tell how much of it the silhouettes show, for `score`.

    Run it after `answer`, as it opens the labels. Only for suites of `withheld generate`.
    """
    suite = read_suite(labels.with_name(SUITE))
    with progress_bar("cases", sum(bool(plan.causes) for plan in suite.plans())) as bar:
        found = make_twins(
            suite, cases, read_object(labels), out, atlas, workers=workers, step=lambda case: bar.advance()
        )
    if as_json:
        print_json({"path": out, "cases": {case: asdict(shown) for case, shown in found.items()}})
    else:
        seen = sum(shown.multiple >= 1 for shown in found.values())
        output.print(f"{out}: {seen} of {len(found)} cases show as much as is detectable")
