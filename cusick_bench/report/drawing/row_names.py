"""Names of the rows of a graph, cut to the room beside it so that no two of them become alike."""

from collections.abc import Sequence
from itertools import zip_longest

from cusick_bench.report.drawing.inline_svg import printable

_LONGEST = 30  # letters of a name
_SHORTEST = 4  # letters below which a name is not cut to tell it from another
_BEGINNING = 1 / 3  # of the letters, kept of the beginning where only the end tells a name from another


def row_names(labels: Sequence[str]) -> list[str]:
    """Labels as they stand beside a graph.

    Args:
        labels: The labels of all rows.

    Returns:
        The labels; long ones without their end or, where that would make two alike, without their middle.
    """
    return _shortened([printable(label) for label in labels], _LONGEST)


def _shortened(names: Sequence[str], longest: int) -> list[str]:
    short = [name if len(name) <= longest else name[: longest - 1] + "…" for name in names]
    for text in {one for one in short if short.count(one) > 1}:
        places = [place for place, one in enumerate(short) if one == text]
        alike = [names[place] for place in places]
        if len(set(alike)) == 1 or longest < _SHORTEST:
            continue
        beginning = round(_BEGINNING * longest)
        room = longest - beginning - 1
        differ = next(place for place, letters in enumerate(zip_longest(*alike)) if len(set(letters)) > 1)
        start = min(differ, max(map(len, alike)) - room)
        ends = _shortened([name[start:] for name in alike], room)
        for place, name, end in zip(places, alike, ends, strict=True):
            short[place] = f"{name[:beginning]}…{end}"
    return short
