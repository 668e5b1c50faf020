"""Before and after: the graphs of data, base model and base model with the cause, with what is to be seen in them."""

from collections.abc import Mapping
from typing import Any

from markupsafe import Markup

from cusick_bench.report.diagnosis.causes import named_cause, with_cause
from cusick_bench.report.diagnosis.profiles import (
    SHAPE_MODES,
    Sided,
    every_graph,
    mean_difference,
    mean_graph,
    read_profiles,
    silhouette_graph,
    sorted_graph,
)
from cusick_bench.report.diagnosis.values import plain

_FACES = {"up": "face up", "down": "face down"}
_SOURCES = {"data": "data", "base": "base model", "effect": "with the cause"}


def before_after(document: Mapping[str, Any]) -> dict[str, Any]:
    """What the page's template asks for on the profiles."""
    sided = read_profiles(document.get("profiles"))
    if "data" not in sided:
        return {
            "means": [],
            "why": "the document holds none of the data" if not sided else "those of the data are absent",
        }
    sided = _on_faces_of_data(sided)
    sides = [side for side in _FACES if side in sided["data"]]
    sources = [source for source in _SOURCES if source in sided]
    cause = named_cause(document)
    names = _SOURCES | ({"effect": f"with {cause}"} if cause else {})
    heads = _SOURCES | {"effect": with_cause(document)}
    outlines = [(_FACES[s], silhouette_graph(sided, s, f"Silhouettes of typical drapes, {_FACES[s]}")) for s in sides]
    outlines.append(("Sorted radii", sorted_graph(sided, "Mean sorted radii of " + _listed(sources, names))))
    return {
        "words": _difference(sided, names),
        "key": _key(sources, names),
        "means": [(_FACES[s], mean_graph(sided, s, f"Mean radius over angle, {_FACES[s]}")) for s in sides],
        "every": [(heads[s], every_graph(sided, s, f"Radius over angle of every drape: {names[s]}")) for s in sources],
        "outlines": outlines,
        "modes": SHAPE_MODES,
        "faces": " and ".join(_FACES[side] for side in sides),
        "band": any(len(drapes) > 1 for drapes in sided["data"].values()),
        "damaged": _damaged(sided),
    }


def _on_faces_of_data(sided: Sided) -> Sided:
    """Drapes on the faces that the data show; a model drapes both, and only like can be compared with like."""
    shared = {source: {s: own[s] for s in sided["data"] if s in own} for source, own in sided.items()}
    return {source: own for source, own in shared.items() if own}


def _listed(sources: list[str], names: Mapping[str, str]) -> str:
    return ", ".join(names[source] for source in sources)


def _key(sources: list[str], names: Mapping[str, str]) -> Markup:
    return Markup("").join(Markup('<span class="key {}"></span>{}').format(source, names[source]) for source in sources)


def _difference(sided: Sided, names: Mapping[str, str]) -> str:
    found = {source: mean_difference(sided, source) for source in ("base", "effect")}
    known = {source: one for source, one in found.items() if one is not None}
    if not known:
        return ""
    words = [
        f"{plain(1e3 * difference)} mm {'with the base model' if source == 'base' else names[source]}"
        for source, (difference, _) in known.items()
    ]
    by_chance = max(error for _, error in known.values())
    return (
        f"Mean outlines differ from the data's by {' and '.join(words)} (root mean square); "
        f"the spread between drapes alone would make about {plain(1e3 * by_chance)} mm."
    )


def _damaged(sided: Sided) -> str:
    count = sum(drapes.damaged for own in sided.values() for drapes in own.values())
    return f"{count} drape{'s' * (count > 1)} without a usable outline left out." if count else ""
