"""`cusick-bench withheld answer`: diagnoses withheld cases blind and freezes the answers.

Also `oracle` and `twins`, which measure afterwards how good answers could be.
"""

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from cusick_bench.cli.common import interruptible, output, print_json, tell, user_errors
from cusick_bench.cli.options import (
    Atlas,
    Cases,
    Json,
    Labels,
    Seed,
    SimulatedSamples,
    WithoutEffect,
    Workers,
    output_option,
)
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.written_paths import room_for_file
from cusick_bench.diagnosis.options import SHIPPED, Options


@user_errors
def answer(
    cases: Cases,
    out: Annotated[Path, output_option(help="File for the answers.")] = Path("answers.json"),
    samples: SimulatedSamples = Options.samples,
    without_effect: WithoutEffect = None,
    atlas: Atlas = SHIPPED,
    seed: Seed = 0,
    workers: Workers = 2,
    as_json: Json = False,
) -> None:
    """Answer every case from its silhouettes alone; answers that are there already are kept."""
    from cusick_bench.sim.effects import effect
    from cusick_bench.withheld.answers.blind import answer_suite, case_folders

    options = Options(samples, False, tuple(effect(name).name for name in without_effect or ()), seed)
    kept = interruptible(f"the answers that were ready are kept beside {out}", go_on=True)
    with progress_bar("cases", len(case_folders(cases))) as bar, kept, room_for_file(out):
        found = answer_suite(cases, out, atlas, options, workers=workers, step=lambda case: bar.advance())
    if as_json:
        verdicts = dict(sorted(Counter(one.verdict for one in found.answers.values()).items()))
        print_json({"path": out, "cases": len(found.answers), "verdicts": verdicts, "code_version": found.code_version})
    else:
        output.print(f"{out}: {len(found.answers)} answers, frozen by {found.code_version}")
    refused = {case: one.refused for case, one in found.answers.items() if one.refused}
    if refused:
        case, reason = next(iter(refused.items()))
        tell(f"{len(refused)} of {len(found.answers)} cases are answered by a refusal, such as {case}: {reason}")


@user_errors
def oracle(
    cases: Cases,
    labels: Labels,
    out: Annotated[Path, output_option(help="File for the closures.")] = Path("oracle.json"),
    samples: Annotated[int, typer.Option(min=2, help="Simulated samples.")] = Options.samples,
    atlas: Atlas = SHIPPED,
    seed: Seed = 0,
    workers: Workers = 2,
    as_json: Json = False,
) -> None:
    """Measure how far the true cause closes the gap of every case, for `score`.

    Run it after `answer`, as it opens the labels.
    """
    from cusick_bench.diagnosis.simulation.closure import Draping
    from cusick_bench.withheld.answers.oracle import oracle_closures
    from cusick_bench.withheld.format.label import PAIR, SINGLE, read_label_documents

    known = read_label_documents(labels)
    kept = interruptible(f"the closures that were ready are kept beside {out}", go_on=True)
    cases_asked = sum(label.kind in (SINGLE, PAIR) for label in known.values())
    with progress_bar("cases", cases_asked) as bar, kept, room_for_file(out):
        found = oracle_closures(
            cases, known, out, atlas, Draping(samples, seed), workers=workers, step=lambda case: bar.advance()
        )
    if as_json:
        print_json({"path": out, "closures": found})
    else:
        output.print(f"{out}: {sum(value is not None for value in found.values())} of {len(found)} cases have a gap")


@user_errors
def twins(
    cases: Cases,
    labels: Annotated[
        Path, typer.Argument(help="labels.json of the same cases, with suite.json beside it.", metavar="LABELS")
    ],
    out: Annotated[Path, output_option(help="File for what the cases show.")] = Path("twins.json"),
    atlas: Atlas = SHIPPED,
    workers: Workers = 2,
    as_json: Json = False,
) -> None:
    """Drape every case again without its effect, to measure how much the silhouettes show of it, for `score`.

    Run it after `answer`, as it opens the labels. Only for suites of `withheld generate`.
    """
    from cusick_bench.withheld.answers.shown_shift import measure_shown_shifts
    from cusick_bench.withheld.format.label import read_label_documents
    from cusick_bench.withheld.suite.generate import SUITE, read_suite

    suite = read_suite(labels.with_name(SUITE))
    kept = interruptible(f"the cases that were ready are kept beside {out}", go_on=True)
    with progress_bar("cases", sum(bool(plan.causes) for plan in suite.plans())) as bar, kept, room_for_file(out):
        found = measure_shown_shifts(
            suite, cases, read_label_documents(labels), out, atlas, workers=workers, step=lambda case: bar.advance()
        )
    if as_json:
        print_json({"path": out, "cases": {case: asdict(shown) for case, shown in found.items()}})
    else:
        seen = sum(shown.multiple >= 1 for shown in found.values())
        output.print(f"{out}: {seen} of {len(found)} cases show as much as is detectable")
