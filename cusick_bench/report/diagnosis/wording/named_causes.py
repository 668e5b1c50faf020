"""Names of the causes that a diagnosis singles out: none, one, or several that act together."""

from cusick_bench.diagnosis.document.model import DiagnosisDocument
from cusick_bench.sim.effects import registered

_HEADING = 26  # letters of a name that a heading has room for


def named_causes(document: DiagnosisDocument) -> list[str]:
    """The registered effects that models hold together: the named ones, and the likeliest of each group of look-alikes.

    Args:
        document: The diagnosis.

    Returns:
        Their names.
    """
    held = document.closure.effect or document.held_together or document.effects
    return [name for name in dict.fromkeys(held) if name in registered()]


def are_several(document: DiagnosisDocument) -> bool:
    """Whether several causes that act together are named.

    Args:
        document: The diagnosis.

    Returns:
        True for two and more.
    """
    return len(named_causes(document)) > 1


def stand_ins(document: DiagnosisDocument) -> dict[str, tuple[str, ...]]:
    """Look-alikes that one of them stands for in models and on the page.

    Args:
        document: The diagnosis.

    Returns:
        Each group by the one that stands for it: that which models hold, or else the first.
    """
    held = named_causes(document)
    return {next((name for name in group if name in held), group[0]): group for group in document.groups if group}


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
        Such as "with creep" or "with all causes".
    """
    name = named_cause(document)
    if name and len(name) <= _HEADING:
        return f"with {name}"
    return "with all causes" if are_several(document) else "with the cause"
