"""Before and after: graphs of data, base model and base model with the cause, with what is to be seen in them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from markupsafe import Markup

from cusick_bench.diagnosis.document.model import DiagnosisDocument
from cusick_bench.report.diagnosis.graphs.profile_graphs import (
    MOST_LINES,
    every_graph,
    mean_graph,
    silhouette_graph,
    sorted_graph,
)
from cusick_bench.report.diagnosis.graphs.profiles import SHAPE_MODES, Sided, mean_difference, sided_profiles
from cusick_bench.report.diagnosis.wording.named_causes import model_with_cause, named_cause
from cusick_bench.report.diagnosis.wording.number_format import plain
from cusick_bench.report.drawing.inline_svg import inline_svg

_FACES = {"up": "face up", "down": "face down"}
_SOURCES = {"data": "data", "base": "base model", "effect": "with the cause"}
_KEYS = {"data": "real", "base": "model dashed", "effect": "with-cause"}
"""Class of each source's key in the style sheet."""

NamedGraph = tuple[str, Markup]


@dataclass(frozen=True)
class ProfileSection:
    """Drapes of data and models.

    Attributes:
        why_empty: Why there is nothing to show; "" where there is.
        words: How far the models' mean outlines are from those of the data.
        key: Class of a line's key and its meaning.
        means: Mean outline by face.
        drapes: Radius over angle of drapes, by source.
        shown: Which drapes these are.
        outlines: Silhouettes by face, and the sorted radii.
        modes: Most waves around a mean outline.
        faces: The faces that the data show, in words.
        has_band: Whether `means` show the range of the data's samples.
        damaged: A sentence on drapes without a usable outline.
    """

    why_empty: str = ""
    words: str = ""
    key: list[tuple[str, str]] = field(default_factory=list)
    means: list[NamedGraph] = field(default_factory=list)
    drapes: list[NamedGraph] = field(default_factory=list)
    shown: str = ""
    outlines: list[NamedGraph] = field(default_factory=list)
    modes: int = SHAPE_MODES
    faces: str = ""
    has_band: bool = False
    damaged: str = ""


def profile_section(document: DiagnosisDocument) -> ProfileSection:
    """Graphs of the drapes on the faces that the data show.

    Args:
        document: The diagnosis.

    Returns:
        The content of the section.
    """
    sided = sided_profiles(document.profiles)
    if "data" not in sided:
        why = "those of the data are absent" if sided else "the document holds none of the data"
        return ProfileSection(why_empty=why)
    sided = _on_faces_of_data(sided)
    sides = [side for side in _FACES if side in sided["data"]]
    cause = named_cause(document)
    names = _SOURCES | ({"effect": f"with {cause}"} if cause else {})
    names = {source: name for source, name in names.items() if source in sided}
    return ProfileSection(
        words=_difference(sided, names),
        key=[(_KEYS[source], name) for source, name in names.items()],
        means=[(_FACES[side], _mean(sided, side)) for side in sides],
        drapes=_drapes(sided, names, {**_SOURCES, "effect": model_with_cause(document)}),
        shown=_shown(sided),
        outlines=[*((_FACES[side], _outline(sided, side)) for side in sides), ("Sorted radii", _sorted(sided, names))],
        faces=" and ".join(_FACES[side] for side in sides),
        has_band=any(len(drapes) > 1 for drapes in sided["data"].values()),
        damaged=_damaged(sided),
    )


def _on_faces_of_data(sided: Sided) -> Sided:
    """Drapes on the faces that the data show; a model drapes both, and only like can be compared with like."""
    shared = {source: {s: own[s] for s in sided["data"] if s in own} for source, own in sided.items()}
    return {source: own for source, own in shared.items() if own}


def _mean(sided: Sided, side: str) -> Markup:
    return inline_svg(mean_graph(sided, side), f"Mean radius over angle, {_FACES[side]}")


def _outline(sided: Sided, side: str) -> Markup:
    return inline_svg(silhouette_graph(sided, side), f"Silhouettes of typical drapes, {_FACES[side]}")


def _sorted(sided: Sided, names: Mapping[str, str]) -> Markup:
    return inline_svg(sorted_graph(sided), "Mean sorted radii of " + ", ".join(names.values()))


def _drapes(sided: Sided, names: Mapping[str, str], headings: Mapping[str, str]) -> list[NamedGraph]:
    return [
        (headings[source], inline_svg(every_graph(sided, source), f"{_drapes_in_words(sided, source)}: {name}"))
        for source, name in names.items()
    ]


def _count(sided: Sided, source: str) -> int:
    return sum(map(len, sided[source].values()))


def _drapes_in_words(sided: Sided, source: str) -> str:
    count = _count(sided, source)
    return f"Radius over angle of {'every drape' if count <= MOST_LINES else f'{MOST_LINES} of {count} drapes'}"


def _shown(sided: Sided) -> str:
    if all(_count(sided, source) <= MOST_LINES for source in sided):
        return "Every drape"
    return f"At most {MOST_LINES} drapes of each, evenly chosen"


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
