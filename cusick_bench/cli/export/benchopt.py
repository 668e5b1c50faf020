"""`cusick-bench export benchopt`: the benchmark in the form of benchopt."""

from pathlib import Path
from typing import Annotated

import typer

from cusick_bench.cli.common import command_line, print_json, tell, user_errors
from cusick_bench.cli.options import LAW, Data, Json, Law, Solvers, Steps, VerticesByLaw, fit_option, vertices_by_law
from cusick_bench.cli.written_paths import outside_package
from cusick_bench.files.shell_word import shell_word
from cusick_bench.problem.spaces import DEFAULT_SPACE, SPACES
from cusick_bench.sim.constants import VERTICES_TO_FIT


@user_errors
def benchopt(
    folder: Annotated[
        Path, typer.Argument(help="New folder for the benchmark.", metavar="DIR", callback=outside_package)
    ],
    data: Data = "synthetic",
    solver: Solvers = None,
    space: Annotated[str, fit_option(help=f"Parameter space: {', '.join(SPACES)}.")] = DEFAULT_SPACE,
    vertices: VerticesByLaw = None,
    steps: Steps = 100,
    law: Law = LAW,
    json: Json = False,
) -> None:
    """Write a benchopt benchmark: objective, data sets and solvers, which call this package.

    `benchopt test DIR` and `benchopt run DIR` need benchopt (pip install "benchopt[test]"); this command does not. The
    shipped data set is always included, since tests run on it; --data adds another one. --solver chooses the solvers
    (by default one of each kind); to add one later, put a file into DIR/solvers.
    """
    from cusick_bench.export.benchopt import SOLVERS, write_benchmark
    from cusick_bench.runner import ProblemSettings
    from cusick_bench.sim.engine.settings import DrapeSettings

    settings = ProblemSettings(
        space=space,
        vertices=vertices_by_law(vertices, law, VERTICES_TO_FIT),
        drape=DrapeSettings(law=law.value, steps=steps),
    )
    files = write_benchmark(folder, solvers=solver or SOLVERS, data=data, settings=settings, command=command_line())
    tell(f"wrote {len(files)} files to {folder}")
    tell(f"next: benchopt test {shell_word(folder)}")
    if json:
        print_json({"path": folder, "files": files})
