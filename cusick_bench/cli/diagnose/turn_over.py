"""`cusick-bench diagnose-turn-over`: whether samples were turned over as the protocol says."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from cusick_bench.cli.common import interruptible, output, print_json, user_errors
from cusick_bench.cli.completion import complete_cloth
from cusick_bench.cli.options import Atlas, DiagnosedData, Force, Json
from cusick_bench.cli.progress import progress_bar
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.options import SHIPPED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cusick_bench.diagnosis.inference.laboratory.turn_over import TurnOver, Way


app = typer.Typer()
_SAYS: dict[Way, str] = {
    "as-said": "samples were turned over as the protocol says",
    "other-axis": "samples were turned over about the other axis",
    "mirrored-x": "pictures of the lower face are mirror images, right for left",
    "mirrored-y": "pictures of the lower face are mirror images, top for bottom",
}


@app.command("diagnose-turn-over")
@user_errors
def diagnose_turn_over(
    data: DiagnosedData = "cusick",
    fabric: Annotated[
        list[str] | None,
        typer.Option(
            "--cloth",
            "--fabric",
            help="Cloth to look at; repeatable; by default all with both faces.",
            autocompletion=complete_cloth,
        ),
    ] = None,
    atlas: Atlas = SHIPPED,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Find out from the silhouettes whether samples were turned over as the protocol says, or pictures are mirrored.

    The lower face is read as the protocol says, as if the cloth had been turned over about the other axis, and as
    mirror images; each is compared with the atlas (half a minute for each fabric). Several fabrics tell more than one.
    """
    from cusick_bench.datasets import load
    from cusick_bench.diagnosis.atlas.store import load as load_atlas
    from cusick_bench.diagnosis.document.laboratory import shown_twice
    from cusick_bench.diagnosis.inference.laboratory.turn_over import turn_over
    from cusick_bench.diagnosis.measure.captures import read_usable_captures

    emulator, calibration = load_atlas(atlas)
    with progress_bar("reading data") as bar:
        dataset = load(data, progress=bar.show)
    chosen = list(dict.fromkeys(fabric or _with_both_faces(dataset)))
    if not chosen:
        raise DiagnosisError(f"no fabric of {data} has pictures of both faces; photograph some samples face down, too")
    with progress_bar("reading data") as bar, interruptible("nothing was written"):
        usable, unusable = read_usable_captures(dataset, chosen, force=force)
        captures = list(usable.values())
        found = turn_over(captures, emulator, calibration, progress=bar.tell)
    found = replace(found, refused={**{name: str(why) for name, why in unusable.items()}, **found.refused})
    if not found.by_fabric:
        why = "; ".join(f"{name}: {reason}" for name, reason in found.refused.items())
        raise DiagnosisError(f"no fabric of {data} can be compared with the atlas: {why}")
    about_x = captures[0].warp_seen_down == 0
    notes = list(shown_twice([one for one in captures if one.fabric in found.by_fabric]))
    if as_json:
        print_json(_document(found, about_x) | {"notes": notes})
        return
    _print(found, about_x, notes)


def _with_both_faces(dataset: Any) -> list[str]:
    sides = dataset.index.groupby("cloth", sort=False)["side"].agg(set)
    return [str(name) for name, found in sides.items() if {"up", "down"} <= found]


def _document(found: TurnOver, about_x: bool) -> dict[str, Any]:
    return {
        "told": found.told,
        "wrong": found.wrong,
        "sentence": _sentence(found, about_x),
        "least": found.least,
        "total": found.total,
        "fabrics": found.by_fabric,
        "refused": found.refused,
    }


def _sentence(found: TurnOver, about_x: bool) -> str:
    """What the silhouettes say, and what to do."""
    if found.told is None and not found.wrong:
        return (
            f"The silhouettes do not tell: no way is ahead by the {found.least:.0f} nat that are required. More "
            "fabrics, or stiffer and less even ones, tell more."
        )
    if found.told is None:
        return (
            "Pictures of the lower face are not as the protocol says; the silhouettes do not tell which way they are."
        )
    says = _SAYS[found.told]
    if found.told == "as-said":
        return f"{says[0].upper()}{says[1:]}."
    axis = "y" if about_x else "x"
    remedy = {
        "other-axis": f'write "turn_over": "about {axis}" into protocol.json',
        "mirrored-x": "flip them right for left",
        "mirrored-y": "flip them top for bottom",
    }
    return f"{says[0].upper()}{says[1:]}: {remedy[found.told]}."


def _print(found: TurnOver, about_x: bool, notes: Sequence[str]) -> None:
    from cusick_bench.diagnosis.inference.laboratory.turn_over import WAYS

    title = "ln of the joint density with the likeliest effects, minus that of pictures as the protocol says [nat]"
    table = Table("fabric", *WAYS, title=title)
    for name, values in found.by_fabric.items():
        table.add_row(name, *(f"{values[way]:.1f}" for way in WAYS))
    if len(found.by_fabric) > 1:
        table.add_section()
        table.add_row("all", *(f"{found.total[way]:.1f}" for way in WAYS), style="bold")
    output.print(table)
    for name, reason in found.refused.items():
        output.print(f"note: {name}: {reason}")
    for note in notes:
        output.print(f"note: {note}")
    output.print(_sentence(found, about_x), style="bold")
