"""Reads answers together with their labels, and checks that both have the same cases and that seals are intact."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from cusick_bench.files.first_names import first_names
from cusick_bench.withheld.answers.leave_out import labels_to_answer
from cusick_bench.withheld.answers.oracle import OracleClosures
from cusick_bench.withheld.answers.shown_shift import ShownShift
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.format.answer import REFUSED, Answer, AnswersDocument, read_answers
from cusick_bench.withheld.format.fields import finite_or_nan
from cusick_bench.withheld.format.label import (
    DETECTABLE,
    NULL,
    PAIR,
    SINGLE,
    Label,
    LabelDocument,
    read_label_documents,
    truth_of,
)
from cusick_bench.withheld.format.seal import (
    holds,
    published_files,
    published_seals,
    require_one_suite,
    require_published_files,
)
from cusick_bench.withheld.scoring.measures import DISTINCT


@dataclass(frozen=True)
class LabelledAnswers:
    """Answers with their labels, by case.

    Attributes:
        answers: The answers.
        labels: The labels.
        notes: Remarks on the files for readers.
        files: SHA-256 of the files of each case when it was answered; empty in older documents.
    """

    answers: Mapping[str, Answer]
    labels: Mapping[str, Label]
    notes: tuple[str, ...]
    files: Mapping[str, str] = field(default_factory=dict)


def read_labelled_answers(answers: Path, labels: Path, commitment: Path | None = None) -> LabelledAnswers:
    """Reads both files and checks that they belong together.

    Args:
        answers: Frozen answers.
        labels: Labels, with salt and seal.
        commitment: The seals as they were published before any answer.

    Returns:
        Answers and labels of the same cases.

    Raises:
        WithheldError: A file that cannot be read, a case in one file only (but a refused one without label and seal,
            which is left out), labels of another suite than the answered cases, a label that is not the sealed one, or
            answers to other files than the sealed ones.
    """
    answered, labelled = read_answers(answers), read_label_documents(labels)
    truth = labels_to_answer(answered, {case: truth_of(label) for case, label in labelled.items()})
    sealed = answered.seals.keys() | ({} if commitment is None else published_seals(commitment)).keys()
    others = answered.answers.keys() - labelled.keys() - sealed  # no cases, unless an answer says more of them
    unlabelled = sorted(case for case in others if answered.answers[case].verdict == REFUSED)
    said = {case: one for case, one in answered.answers.items() if case not in unlabelled}
    _require_same_cases(set(said), set(truth), answers, labels)
    carried = {case: label.sha256 for case, label in labelled.items()}
    require_one_suite(carried, answered.seals, str(labels), f"the cases that {answers} answers")
    notes = [_check_seals(labelled, commitment), *_check_files(answered, str(answers), commitment)]
    if unlabelled:
        notes.append(f"{len(unlabelled)} refusals without a label are not scored: {first_names(unlabelled)}.")
    if answered.leave_out is not None:
        notes.append(
            f"Leave-one-effect-out: {len(truth)} cases with one effect of at least {answered.leave_out.least:g} times "
            f"the {next(iter(truth.values())).unit}, each answered without it: the right answer is unknown."
        )
    if facts := _provenance(answered):
        notes.append(f"Answers were frozen with {', '.join(facts)}.")
    return LabelledAnswers(said, truth, tuple(notes), answered.files)


def _provenance(document: AnswersDocument) -> list[str]:
    """Facts about the answers that their file states."""
    stated = {"code_version": document.code_version, **(document.model_extra or {})}
    return [f"{key} {stated[key]}" for key in _FACTS if isinstance(stated.get(key), str | int | float)]


def with_measured_severities(
    answered: LabelledAnswers, shifts: Mapping[str, ShownShift], where: str
) -> LabelledAnswers:
    """Replaces the severities of the labels by those that the silhouettes do show.

    Args:
        answered: Answers and labels.
        shifts: What each case shows, from `read_shown_shifts`.
        where: Path of their file, for messages.

    Returns:
        The same answers with changed labels.

    Raises:
        WithheldError: A case with an effect that the file lacks, or shifts of another suite.
    """
    for case, label in answered.labels.items():
        shown = shifts.get(case)
        if shown is None:
            continue
        if label.kind == NULL or shown.nearest in label.effects or set(shown.each) - set(label.effects):
            raise _of_another_suite(where, case, label)
    labels = dict(answered.labels)
    for case, label in labels.items():
        if label.kind == NULL:
            continue
        if case not in shifts:
            raise WithheldError(f"{where} lacks {case}; run `withheld twins` again, it goes on")
        labels[case] = replace(label, multiple=shifts[case].multiple, unit=DETECTABLE, unlike=shifts[case].unlike)
    return replace(answered, labels=labels, notes=(*answered.notes, _MEASURED))


def with_oracle_closures(answered: LabelledAnswers, closures: OracleClosures, where: str) -> LabelledAnswers:
    """Adds the closures by the true causes to the labels; they are known only after the answers.

    Args:
        answered: Answers and labels.
        closures: Closure of each case, from `read_oracle_closures`.
        where: Path of their file, for messages.

    Returns:
        The same answers with changed labels, and a note where closures are missing.

    Raises:
        WithheldError: Closures of another suite.
    """
    for case, label in answered.labels.items():
        if case in closures and label.kind == NULL:
            raise _of_another_suite(where, case, label)
    labels = {
        case: replace(label, oracle_closure=finite_or_nan(closures[case])) if case in closures else label
        for case, label in answered.labels.items()
    }
    due = [case for case, label in labels.items() if label.kind in (SINGLE, PAIR)]
    known = sum(case in closures for case in due)
    lacking = (f"{where} has the closures of {known} of {len(due)} cases; `withheld oracle` goes on with the others.",)
    return replace(answered, labels=labels, notes=answered.notes + (lacking if known < len(due) else ()))


def _of_another_suite(where: str, case: str, label: Label) -> WithheldError:
    """The error where a file tells of other effects of a case than its label names."""
    return WithheldError(
        f"{where} must be of the suite that is scored, but it tells of other effects in {case}, whose label is "
        f"{label.truth}; give the file that was made with these labels (cases of all suites have the same names)"
    )


_MEASURED = (
    "Severities are measured: the shift of the case against its twin without the effect, in detectable shifts. "
    f"`{DISTINCT}`: at least one of these is left when the other effects that are most like it are taken off."
)
_FACTS = ("code_version", "time", "frozen")


def _require_same_cases(answered: set[str], labelled: set[str], answers: Path, labels: Path) -> None:
    if not labelled:
        raise WithheldError(f"{labels} must hold at least one case, got none; give the labels of the answered cases")
    for lacking, what, remedy in (
        (labelled - answered, f"{answers} lacks", f"answer every case; a refusal has the verdict {REFUSED}"),
        (answered - labelled, f"{labels} lacks", "score answers with the labels of the same cases"),
    ):
        if lacking:
            raise WithheldError(
                f"every case must have an answer and a label; {what} {len(lacking)}: "
                f"{first_names(sorted(lacking))}; {remedy}"
            )


def _check_seals(labels: Mapping[str, LabelDocument], commitment: Path | None) -> str:
    """Sentence on what the seals prove.

    Raises:
        WithheldError: A label that is not the one whose seal was published.
    """
    if commitment is None:
        whole = sum(holds(label.content(), str(label.sha256)) for label in labels.values())
        return (
            f"Seals were not compared with published ones (--commitment); {whole} of {len(labels)} labels fit the seal "
            "that they carry."
        )
    published = published_seals(commitment)
    for case, label in labels.items():
        if case not in published:
            raise WithheldError(f"every label must have been sealed; {commitment} lacks {case}; give these cases' own")
        if not holds(label.content(), published[case]):
            raise WithheldError(
                f"the label of {case} must be the one that was sealed; its SHA-256 is not that of {commitment}: it was "
                "changed, or belongs to other cases; fetch both files anew"
            )
    fit = f"All {len(labels)} labels fit the seals published in {commitment.name}"
    left = sorted(published.keys() - labels.keys())
    return f"{fit}; {len(left)} cases sealed there are not scored: {first_names(left)}." if left else f"{fit}."


def _check_files(answered: AnswersDocument, answers: str, commitment: Path | None) -> list[str]:
    """What the seals prove of the cases' files, in sentences; nothing where either side has none.

    Raises:
        WithheldError: A case was answered that has other files than those that were published.
    """
    published = {} if commitment is None else published_files(commitment)
    require_published_files(answered.files, published, f"the cases that {answers} answers")
    sealed = published.keys() & answered.files.keys() & answered.answers.keys()
    return [f"The files of {len(sealed)} answered cases are those that were published."] if sealed else []
