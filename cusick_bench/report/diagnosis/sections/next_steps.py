"""What to measure next, which causes these drapes cannot tell apart, and what was left out."""

from dataclasses import dataclass

from cusick_bench.diagnosis.document.model import DiagnosisDocument, Indistinguishable
from cusick_bench.report.diagnosis.wording.words import entropy_of, worth

_NO_MEASUREMENT = {
    "none": "Nothing is open that a measurement on the list would settle.",
    "effect": "No measurement on the list would lower the doubt.",
    "several": "No measurement on the list would lower the doubt.",
    "ambiguous": "No measurement on the list would lower the doubt.",
    "unknown": "The measurements on the list separate known causes, and this is none of them. The statistics that "
    "differ most say what to look for in the sample and on the bench.",
    "refused": "First of all what the refusal asks for.",
}
_ALL_TOLD_APART = "Nothing among the likely causes."
_TOLD_APART_IN_PRINCIPLE = "None by their nature: the likely causes differ, but not enough in these drapes."


@dataclass(frozen=True)
class Measurement:
    """A measurement that would lower the doubt.

    Attributes:
        name: Short name.
        what: What to do.
        worth: How much of the uncertainty it would remove, in words.
        about: The causes that it speaks about, as a list in words.
    """

    name: str
    what: str
    worth: str
    about: str


@dataclass(frozen=True)
class NextSection:
    """What to do next, and what these drapes leave open.

    Attributes:
        measurements: The most informative first.
        no_measurement: Sentence to show where there is no measurement.
        indistinguishable: Causes that no silhouette tells apart.
        told_apart: Sentence to show where there are none.
        without: Effects that were not considered.
        notes: What was left out or is in doubt.
    """

    measurements: list[Measurement]
    no_measurement: str
    indistinguishable: tuple[Indistinguishable, ...]
    told_apart: str
    without: tuple[str, ...]
    notes: tuple[str, ...]


def next_section(document: DiagnosisDocument) -> NextSection:
    """What to measure next, and what these drapes leave open.

    Args:
        document: The diagnosis.

    Returns:
        The content of the section.
    """
    entropy = entropy_of([cause.probability for cause in document.causes])
    return NextSection(
        measurements=[
            Measurement(one.name, one.what, worth(one.bits, entropy), ", ".join(one.about)) for one in document.next
        ],
        no_measurement=_NO_MEASUREMENT[document.verdict],
        indistinguishable=document.indistinguishable,
        told_apart=_TOLD_APART_IN_PRINCIPLE if document.verdict == "ambiguous" else _ALL_TOLD_APART,
        without=document.without,
        notes=document.notes,
    )
