"""The verdict of a diagnosis in one sentence."""

from cusick_bench.diagnosis.diagnose import Diagnosis
from cusick_bench.diagnosis.inference.evidence import NONE, UNKNOWN
from cusick_bench.diagnosis.inference.verdict import single_causes
from cusick_bench.sim.effects import registered

_BESIDE = {UNKNOWN: "something that is not on the list", NONE: "chance alone"}
"""What an ambiguous set may hold beside effects."""


def headline(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence.

    Args:
        diagnosis: The diagnosis.

    Returns:
        The sentence; where no known effect explains the data, a second one that names parts of an explanation.
    """
    p = single_causes(diagnosis.probability)
    if diagnosis.verdict == NONE:
        return "No unmodelled effect shows: the drapes differ from the base model no more than chance allows."
    if diagnosis.verdict == UNKNOWN:
        parts = [step.candidate.hypothesis.name for step in diagnosis.steps]
        share = f" Parts of it, one after the other: {', '.join(parts)}{_closed(diagnosis)}." if parts else ""
        return f"The drapes differ from the base model, and no known effect, nor two of them, explains how.{share}"
    names = [one.hypothesis.name for one in diagnosis.cause]
    summary = "; and ".join(registered()[name].summary for name in names)
    if diagnosis.verdict == "effect":
        return f"{' + '.join(names)}, with probability {p[names[0]]:.0%}: {summary}."
    several = ", ".join(name for name in diagnosis.set90 if name not in _BESIDE)
    beside = "".join(f", or {what} ({p[name]:.0%})" for name, what in _BESIDE.items() if name in diagnosis.set90)
    return f"Something shows that these drapes alone cannot tell apart: one of {several}{beside}."


def _closed(diagnosis: Diagnosis) -> str:
    """How far all steps together close the gap, where that was simulated and its interval lies above 0."""
    gap = diagnosis.together and diagnosis.together.gap
    if gap is None or not gap.closure_interval[0] > 0:
        return ""
    low, high = gap.closure_interval
    return f"; together they close {gap.closure:.0%} of the gap [{low:.0%}, {high:.0%}]"
