"""`cusick-bench withheld`: cases whose effect is sealed."""

import secrets
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from cusick_bench.cli.common import interruptible, output, print_json, user_errors
from cusick_bench.cli.diagnose.withheld_answer import answer, oracle, twins
from cusick_bench.cli.diagnose.withheld_leave_out import leave_out
from cusick_bench.cli.diagnose.withheld_pool import pool
from cusick_bench.cli.diagnose.withheld_score import score
from cusick_bench.cli.options import (
    MOST_CASES,
    MOST_SAMPLES,
    MOST_VERTICES,
    Json,
    Workers,
    output_option,
    running_option,
    simulation_option,
)
from cusick_bench.cli.progress import progress_bar
from cusick_bench.cli.written_paths import folder_made
from cusick_bench.withheld.suite.design import DRAWN, MULTIPLES
from cusick_bench.withheld.world.registry import DEFAULT, WORLDS

_cases_option = partial(typer.Option, rich_help_panel="Cases")

app = typer.Typer(help="Cases whose effect is sealed: make them, answer them blind, score the answers.")


@app.callback()
def _root() -> None:
    """Cases whose effect is sealed: make them, answer them blind, score the answers."""


app.command("answer")(answer)
app.command("oracle")(oracle)
app.command("twins")(twins)
app.command("leave-out")(leave_out)
app.command("score")(score)
app.command("pool")(pool)


@app.command("generate")
@user_errors
def generate_suite(
    out: Annotated[Path, output_option(help="Folder of the cases and of the commitment to their labels.")],
    labels: Annotated[Path, output_option(help="Folder of the labels, outside the folder of the cases.")],
    seed: Annotated[
        int | None,
        running_option(
            min=0, help="Seed of all random choices, which reveals the labels. By default random, kept in LABELS."
        ),
    ] = None,
    nulls: Annotated[int, _cases_option(min=0, max=MOST_CASES, help="Cases without any effect.")] = 200,
    singles: Annotated[
        int,
        _cases_option(min=0, max=MOST_CASES, help="Cases with one effect; all effects and severities in turn."),
    ] = len(DRAWN) * len(MULTIPLES),
    pairs: Annotated[int, _cases_option(min=0, max=MOST_CASES, help="Cases with two effects.")] = 22,
    unknown: Annotated[
        int,
        _cases_option(min=0, max=MOST_CASES, help="Cases with an effect that is not on the list of effects."),
    ] = 48,
    multiples: Annotated[
        list[float] | None,
        _cases_option(
            "--multiple",
            min=0.05,
            max=20,
            help="Severity of single effects, in typical or detectable ones; repeatable. "
            f"[default: {', '.join(f'{one:g}' for one in MULTIPLES)}]",
        ),
    ] = None,
    detectable: Annotated[
        Path | None,
        _cases_option(help="Table from `atlas power --out`, as unit of severities; by default typical severities."),
    ] = None,
    world: Annotated[
        str,
        simulation_option(
            help=f"World that the cases lie in: {', '.join(WORLDS)}.", autocompletion=lambda: list(WORLDS)
        ),
    ] = DEFAULT,
    vertices: Annotated[
        int | None,
        simulation_option(min=100, max=MOST_VERTICES, help="Vertices of the cloth's mesh; by default the world's."),
    ] = None,
    samples: Annotated[
        int,
        _cases_option(min=1, max=MOST_SAMPLES, help="Samples of each case, with two faces and two captures."),
    ] = 12,
    workers: Workers = 2,
    as_json: Json = False,
) -> None:
    """Make a suite of cases, or go on with one; nothing that is printed reveals what they hold."""
    from cusick_bench.withheld.format.seal import COMMITMENT
    from cusick_bench.withheld.suite.detectable import read_detectable
    from cusick_bench.withheld.suite.generate import LABELS, Suite, generate
    from cusick_bench.withheld.world.registry import world_of

    counts = {"null": nulls, "single": singles, "pair": pairs, "unknown": unknown}
    size = vertices or world_of(world).vertices
    table = detectable and read_detectable(detectable)
    severities = tuple(multiples or MULTIPLES)
    asked = Suite(_seed(seed, labels), counts, size, samples, table, world, severities)  # pyright: ignore[reportArgumentType]
    kept = interruptible(f"the cases that were ready are kept in {out}", go_on=True)
    with progress_bar("cases", sum(counts.values())) as bar, kept, folder_made(out):
        made = generate(asked, out, labels, workers=workers, step=lambda case: bar.advance())
    if as_json:
        print_json({"cases": [str(case) for case in made], "commitment": out / COMMITMENT, "labels": labels / LABELS})
    else:
        output.print(f"{len(made)} cases in {out}, bound to their labels by {out / COMMITMENT}; labels in {labels}")


def _seed(given: int | None, labels: Path) -> int:
    """The given seed, or else that of the unfinished suite, or else a new one that cannot be guessed."""
    from cusick_bench.withheld.suite.generate import SUITE, read_suite

    if given is not None:
        return given
    path = labels / SUITE
    return read_suite(path).seed if path.exists() else secrets.randbits(128)
