"""`cusick-bench effects`: what the base model leaves out, and how to ask for it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer
from rich.table import Table

from cusick_bench.cli.common import output, print_json, user_errors
from cusick_bench.cli.options import Json

if TYPE_CHECKING:
    from cusick_bench.sim.effects import Effect, Parameter


app = typer.Typer()


@app.command("effects")
@user_errors
def effects(
    json: Json = False,
) -> None:
    """List the effects that `simulate` and `run` take as --with-effect NAME:param=value,...

    The first parameter of each is its severity, 0 where the effect is absent; if it is not given, the typical one is
    used.
    """
    from cusick_bench.sim.effects import registered

    if json:
        print_json({"effects": [_document(effect) for effect in registered().values()]})
        return
    table = Table("name", "class", "what it is", "parameters: typical (bounds), source", "gradient", "located")
    for effect in registered().values():
        numbers = "\n".join(_line(parameter) for parameter in _severity_first(effect))
        table.add_row(effect.name, effect.kind, effect.summary, numbers, effect.gradient, effect.located or "-")
    output.print(table)


def _severity_first(effect: Effect) -> list[Parameter]:
    return sorted(effect.parameters, key=lambda parameter: parameter.role != "severity")


def _line(parameter: Parameter) -> str:
    p = parameter
    source = f", {p.source}" if p.role == "severity" else ""
    return f"{p.name}: {p.usual:g}{p.unit_text} ({p.low:g} to {p.high:g}{p.unit_text}){source}"


def _document(effect: Effect) -> dict[str, Any]:
    return {
        **{name: getattr(effect, name) for name in ("name", "summary", "physics", "reference", "gradient", "signed")},
        "class": effect.kind,
        "located": effect.located,
        "parameters": [vars(parameter) | {"default": parameter.usual} for parameter in _severity_first(effect)],
    }
