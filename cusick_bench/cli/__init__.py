"""The `cusick-bench` command: one file per command, mounted here."""

import typer

app = typer.Typer(
    name="cusick-bench",
    help=__doc__,
    no_args_is_help=True,
    pretty_exceptions_show_locals=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main() -> None:
    """Entry point of the console script."""
    app()
