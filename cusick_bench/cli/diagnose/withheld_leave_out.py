"""`cusick-bench withheld leave-out`: answers cases again without their own effect; `unknown` is then right."""

from pathlib import Path
from typing import Annotated

import typer

from cusick_bench.cli.common import interruptible, output, print_json, user_errors
from cusick_bench.cli.options import Atlas, Cases, Json, Labels, Seed, SimulatedSamples, Workers, output_option
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.written_paths import room_for_file
from cusick_bench.diagnosis.options import SHIPPED, Options


@user_errors
def leave_out(
    cases: Cases,
    labels: Labels,
    out: Annotated[Path, output_option(help="File for the answers.")] = Path("leave-out.json"),
    least: Annotated[
        float,
        typer.Option(
            "--minimum-severity",
            min=0,
            help="Least severity, in the unit of the labels: detectable shifts or typical severities.",
        ),
    ] = 2.0,
    samples: SimulatedSamples = 0,
    atlas: Atlas = SHIPPED,
    seed: Seed = 0,
    workers: Workers = 2,
    as_json: Json = False,
) -> None:
    """Answer cases with one effect as if that effect were not on the list, so that `unknown` is the right answer.

    Run it after `answer`, as it opens the labels to know which effect to leave out, and takes only effects that are
    strong enough to be seen. Answers that are there already are kept; `score` takes the file like any other.
    """
    from cusick_bench.withheld.answers.leave_out import answer_left_out, left_out_effects
    from cusick_bench.withheld.answers.parts import require_labels_of
    from cusick_bench.withheld.format.label import read_label_documents, truth_of

    documents = read_label_documents(labels)
    require_labels_of(cases, documents)
    known = {case: truth_of(label) for case, label in documents.items()}
    kept = interruptible(f"the answers that were ready are kept beside {out}", go_on=True)
    with progress_bar("cases", len(left_out_effects(known, least))) as bar, kept, room_for_file(out):
        found = answer_left_out(
            cases, known, out, atlas, Options(samples, False, (), seed), least,
            workers=workers, step=lambda case: bar.advance(),
        )  # fmt: skip
    verdicts = [answer.verdict for answer in found.answers.values()]
    if as_json:
        counts = {verdict: verdicts.count(verdict) for verdict in sorted(set(verdicts))}
        print_json({"path": out, "cases": len(verdicts), "verdicts": counts, "code_version": found.code_version})
    else:
        output.print(
            f"{out}: {len(verdicts)} answers without the case's own effect, {verdicts.count('unknown')} unknown"
        )
