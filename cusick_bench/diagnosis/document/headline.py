"""The verdict of a diagnosis in one sentence."""

from cusick_bench.diagnosis.diagnose import Diagnosis
from cusick_bench.diagnosis.inference.single_effects.evidence import NONE, UNKNOWN
from cusick_bench.sim.effects import registered

_BESIDE = {UNKNOWN: "something that is not on the list", NONE: "chance alone"}
"""What an ambiguous set may hold beside effects."""


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence, and what stays unexplained in another.

    Args:
        diagnosis: The diagnosis.

    Returns:
        The sentences.
    """
    if diagnosis.verdict == NONE:
        return "No unmodelled effect shows: the drapes differ from the base model no more than it may be wrong."
    return f"{_verdict_sentence(diagnosis)}{_unexplained_sentence(diagnosis)}"


def _verdict_sentence(diagnosis: Diagnosis) -> str:
    acting = diagnosis.acting
    names = list(diagnosis.effects)
    alike = "".join(f", and one of {', '.join(group)}" for group in diagnosis.groups)
    if diagnosis.verdict == UNKNOWN:
        parts = ", ".join(one.hypothesis.name for one in diagnosis.causes)
        share = f" Parts of it may be {parts}." if parts else ""
        return f"The drapes differ from the base model, and no set of known effects explains how.{share}"
    if diagnosis.verdict == "effect":
        return f"{names[0]}, with probability {acting[names[0]]:.0%}: {registered()[names[0]].summary}."
    if diagnosis.verdict == "several":
        listed = ", ".join(f"{name} ({acting[name]:.0%})" for name in names)
        return f"Several effects act together: {listed}{alike}."
    if len(diagnosis.groups) > 1:
        each = ", and ".join(f"one of {', '.join(group)}" for group in diagnosis.groups)
        return f"Several effects act together that these drapes alone cannot tell from others: {each}."
    probability = diagnosis.probability
    some = ", ".join(name for name in diagnosis.set90 if name not in _BESIDE)
    beside = [f"{what} ({probability[name]:.0%})" for name, what in _BESIDE.items() if name in diagnosis.set90]
    if not some:
        return f"Something shows, but no known effect stands out: it may be {' or '.join(beside)}."
    return f"Something shows that these drapes alone cannot tell apart: {', or '.join([f'one of {some}', *beside])}."


def _unexplained_sentence(diagnosis: Diagnosis) -> str:
    """The unexplained share, where there is a gap to share."""
    if diagnosis.budget is None or not diagnosis.causes:
        return ""
    left = diagnosis.budget.unexplained
    return f" Unexplained of the gap on unseen samples: {max(left.value, 0.0):.0%}."
