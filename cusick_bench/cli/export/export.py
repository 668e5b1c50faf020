"""`cusick-bench export`: for other programs. One module a subcommand."""

import typer

from cusick_bench.cli.export.benchopt import benchopt
from cusick_bench.cli.export.huggingface import huggingface
from cusick_bench.cli.export.material import material

app = typer.Typer(
    help="Write tasks, materials and data sets for other programs.", no_args_is_help=True, add_completion=False
)
app.command()(benchopt)
app.command()(huggingface)
app.command()(material)
