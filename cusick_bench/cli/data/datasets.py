"""`cusick-bench datasets`: what is registered, and whether it is here."""

from typing import Any

import typer
from rich.table import Column, Table

from cusick_bench.cli.common import output, print_json, user_errors
from cusick_bench.cli.options import Json
from cusick_bench.datasets.errors import DataError
from cusick_bench.datasets.registry import REGISTRY, Registered

_COUNTS = ("fabrics", "samples", "silhouettes", "meshes")

app = typer.Typer()


@app.command("datasets")
@user_errors
def datasets(
    json: Json = False,
) -> None:
    """List the registered data sets: what they hold, their licence, where to get them, what to cite.

    Wherever a command takes --data, any folder in the public release's layout does as well: see `data audit PATH`.
    """
    rows = [_document(name, registered) for name, registered in REGISTRY.items()]
    if json:
        print_json({"datasets": rows})
        return
    table = Table("name", Column("what is known of it", overflow="fold"), show_lines=True)
    for row in rows:
        table.add_row(row["name"], _text(row))
    output.print(table)
    output.print("Any folder in the layout of `cusick` is a data set, too: `cusick-bench data info PATH`.")


def _document(name: str, registered: Registered) -> dict[str, Any]:
    """What is known of a data set; counts and `folder` are null, and `missing` says why, where it is not here."""
    from cusick_bench.datasets.files.layout import scan

    document = {
        "name": name,
        "summary": registered.summary,
        "licence": registered.licence,
        "source": registered.source,
        "reference": registered.citation,
        "folder": None,
        **dict.fromkeys(_COUNTS),
        "missing": None,
    }
    try:
        layout = scan(registered.folder())
    except DataError as error:
        return document | {"missing": str(error)}
    return document | layout.counts | {"folder": layout.root}


def _text(row: dict[str, Any]) -> str:
    counts = ", ".join(f"{row[name]} {name}" for name in _COUNTS)
    lines = {
        "here": f"no; {row['missing']}" if row["missing"] else f"{counts} in {row['folder']}",
        "licence": row["licence"],
        "from": row["source"],
        "reference": row["reference"],
    }
    return "\n".join((row["summary"], *(f"{name}: {text}" for name, text in lines.items())))
