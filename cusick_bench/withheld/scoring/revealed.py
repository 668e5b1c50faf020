"""Opens the labels beside the answers: every case in both, every label as it was sealed."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cusick_bench.withheld.answers.leave_out import LEAVE_OUT, asked_of, least_of
from cusick_bench.withheld.answers.twins import Shown
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.answer import Answer, read_answer
from cusick_bench.withheld.format.checked_json import entries, read_object
from cusick_bench.withheld.format.label import DETECTABLE, LABELS, NULL, Label, read_labels
from cusick_bench.withheld.format.seal import holds
from cusick_bench.withheld.scoring.measures import DISTINCT

_SHOWN = 3  # names in a message


@dataclass(frozen=True)
class Revealed:
    """Answers with their labels, by case.

    Attributes:
        answers: What was said.
        labels: What is true.
        notes: What a reader must know of the files.
    """

    answers: Mapping[str, Answer]
    labels: Mapping[str, Label]
    notes: tuple[str, ...]


def reveal(answers: Path, labels: Path, commitment: Path | None = None) -> Revealed:
    """Reads both files and checks that they belong together.

    Args:
        answers: Frozen answers.
        labels: Labels, with salt and seal.
        commitment: The seals as they were published before any answer.

    Raises:
        WithheldError: A file that cannot be read, a case in one file only, or a label that is not the sealed one.
    """
    said, true = read_object(answers), read_object(labels)
    answered = {case: read_answer(found, f"{answers}: {case}") for case, found in entries(said, _ANSWERS).items()}
    labelled = asked_of(said, answered, read_labels(true, str(labels)))
    _require_same_cases(set(answered), set(labelled), answers, labels)
    notes = [_check_seals(entries(true, LABELS), commitment)]
    if LEAVE_OUT in said:
        notes.append(
            f"Leave-one-effect-out: {len(labelled)} cases with one effect of at least {least_of(said):g} times the "
            f"{next(iter(labelled.values())).unit}, each answered without it: the right answer is unknown."
        )
    if facts := [f"{key} {said[key]}" for key in _FACTS if isinstance(said.get(key), str | int | float)]:
        notes.append(f"Answers were frozen with {', '.join(facts)}.")
    return Revealed(answered, labelled, tuple(notes))


def by_shown(revealed: Revealed, shown: Mapping[str, Shown], where: str) -> Revealed:
    """The labels with the severities that the silhouettes do show.

    Args:
        revealed: Answers and labels.
        shown: From `read_twins`.
        where: Its path, for messages.

    Raises:
        WithheldError: A case with an effect that it lacks.
    """
    labels = dict(revealed.labels)
    for case, label in labels.items():
        if label.kind == NULL:
            continue
        if case not in shown:
            raise WithheldError(f"{where} lacks {case}; run `withheld twins` again, it goes on")
        labels[case] = replace(label, multiple=shown[case].multiple, unit=DETECTABLE, unlike=shown[case].unlike)
    return replace(revealed, labels=labels, notes=(*revealed.notes, _BY_SHOWN))


_BY_SHOWN = (
    "Severities are measured: the shift of the case against its twin without the effect, in detectable shifts. "
    f"`{DISTINCT}`: at least one of these is left when the other effect that is most like it is taken off."
)
_ANSWERS = ("answers", "cases")
_FACTS = ("code_version", "time", "frozen")


def _require_same_cases(answered: set[str], labelled: set[str], answers: Path, labels: Path) -> None:
    if not labelled:
        raise WithheldError(f"{labels} must hold at least one case, got none; give the labels of the answered cases")
    for lacking, what, remedy in (
        (labelled - answered, f"{answers} lacks", "answer every case; a refusal has the verdict unknown"),
        (answered - labelled, f"{labels} lacks", "score answers with the labels of the same cases"),
    ):
        if lacking:
            names = ", ".join(sorted(lacking)[:_SHOWN]) + (", ..." if len(lacking) > _SHOWN else "")
            raise WithheldError(f"every case must have an answer and a label; {what} {len(lacking)}: {names}; {remedy}")


def _check_seals(labels: Mapping[str, Any], commitment: Path | None) -> str:
    """What the seals prove, in a sentence.

    Raises:
        WithheldError: A label that is not the one whose seal was published.
    """
    if commitment is None:
        whole = sum(holds(label, str(label.get("sha256"))) for label in labels.values())
        return (
            f"Seals were not compared with published ones (--commitment); {whole} of {len(labels)} labels fit the seal "
            "that they carry."
        )
    published = _published(commitment)
    for case, label in labels.items():
        if case not in published:
            raise WithheldError(f"every label must have been sealed; {commitment} lacks {case}; give these cases' own")
        if not holds(label, published[case]):
            raise WithheldError(
                f"the label of {case} must be the one that was sealed; its SHA-256 is not that of {commitment}: it was "
                "changed, or belongs to other cases; fetch both files anew"
            )
    return f"All {len(labels)} labels fit the seals published in {commitment.name}."


def _published(path: Path) -> dict[str, str]:
    """Published seals by case, at the top of the file or one level below."""
    document = read_object(path)
    inner = next((value for value in document.values() if isinstance(value, dict)), document)
    return {case: seal for case, seal in inner.items() if isinstance(seal, str)}
