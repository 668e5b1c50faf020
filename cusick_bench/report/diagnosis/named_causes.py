"""Names of the causes that a diagnosis singles out: none, one, or two that act together."""

from cusick_bench.diagnosis.document.model import Cause, DiagnosisDocument
from cusick_bench.sim.effects import registered

_CARRIES = 0.5  # probability above which the likeliest cause is the named one
_HEADING = 26  # letters of a name that a heading has room for


def ranked_causes(document: DiagnosisDocument) -> list[Cause]:
    """The causes of a diagnosis.

    Args:
        document: The diagnosis.

    Returns:
        Its causes, likeliest first.
    """
    return sorted(document.causes, key=lambda cause: -cause.probability)


def named_causes(document: DiagnosisDocument) -> list[str]:
    """The registered effects that were simulated: none, one, or two that act together.

    A pair's probability stands with its likelier half, which need not be the half that the closure names.

    Args:
        document: The diagnosis.

    Returns:
        Their names.
    """
    simulated, ranked = document.closure.effect, ranked_causes(document)
    carries = document.verdict == "effect" and bool(ranked) and ranked[0].probability > _CARRIES
    leading = [cause for cause in ranked if cause.effect == simulated or (carries and cause is ranked[0])]
    names = [simulated, *(name for cause in leading for name in (cause.effect, cause.pair_with))]
    return [name for name in dict.fromkeys(names) if name is not None and name in registered()]


def are_two(document: DiagnosisDocument) -> bool:
    """Whether two causes that act together are named.

    Args:
        document: The diagnosis.

    Returns:
        True for a pair.
    """
    return len(named_causes(document)) > 1


def named_cause(document: DiagnosisDocument) -> str:
    """The named causes as one name.

    Args:
        document: The diagnosis.

    Returns:
        Such as "creep + plate-tilt"; "" without any.
    """
    return " + ".join(named_causes(document))


def model_with_cause(document: DiagnosisDocument) -> str:
    """Name of the base model with the causes, short enough for a heading.

    Args:
        document: The diagnosis.

    Returns:
        Such as "with creep" or "with both causes".
    """
    name = named_cause(document)
    if name and len(name) <= _HEADING:
        return f"with {name}"
    return "with both causes" if are_two(document) else "with the cause"
