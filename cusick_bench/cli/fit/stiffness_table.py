"""What `cusick-bench run` prints of the stiffness that was found: a line for each cell and direction."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table

from cusick_bench.leaderboard import significant
from cusick_bench.metrics.found_stiffness import FoundStiffness, Quantity
from cusick_bench.metrics.stiffness import BENDING, GF_CM2_PER_CM, STRETCH
from cusick_bench.runner import labelled

_NONE = "-"


def stiffness_table(rows: Sequence[Mapping[str, Any]], found: Sequence[FoundStiffness | None]) -> Table:
    """The stiffness of each cell.

    Args:
        rows: Cells, with `cloth`, `solver`, `causes` and `seed`, and `left_out` where samples are left out in turn.
        found: What each of them found, None without physics.

    Returns:
        The table.
    """
    in_turn = ["left out"] if any("left_out" in row for row in rows) else []
    table = Table("cloth", "solver", "seed", *in_turn, "direction", title="stiffness found, with 90 % intervals")
    heads = ("bending [µN m]", "[gf cm²/cm]", "/ true", "stretch [N/m]", "/ true")
    for head in heads:
        table.add_column(head, justify="right")
    for row, one in zip(rows, found, strict=True):
        identity = [row["cloth"], labelled(row["solver"], row["causes"]), str(row["seed"])]
        identity += [str(row.get("left_out", "")) for _ in in_turn]
        if one is None:
            table.add_row(*identity, _NONE, *[_NONE] * len(heads))
            continue
        for bending, stretch in zip(BENDING, STRETCH, strict=True):
            table.add_row(
                *identity,
                bending if bending == stretch else f"{bending} (stretch: {stretch})",
                _text(one.bending[bending].times(1e6)),
                _text(one.bending[bending].times(1 / GF_CM2_PER_CM)),
                _text(one.bending_ratio.get(bending)),
                _text(one.stretch[stretch]),
                _text(one.stretch_ratio.get(stretch)),
            )
    return table


def _text(one: Quantity | None) -> str:
    if one is None:
        return _NONE
    low_high = "" if one.ci90 is None else f" [{significant(one.ci90[0])}, {significant(one.ci90[1])}]"
    return significant(one.value) + low_high
