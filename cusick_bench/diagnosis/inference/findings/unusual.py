"""Effects that would have to be far stronger than they usually are.

What is on no list may look like a listed effect that is many times as strong as is usual: a draught leans the cloth as
a camera would that stands centimetres beside its place.
"""

from collections.abc import Sequence

from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate

_UNUSUAL = 6.0  # typical severities; no atlas has draped stronger effects


def unusual(causes: Sequence[Candidate]) -> list[str]:
    """Which effects are to be measured before they are believed.

    Args:
        causes: Effects at their likeliest parameters.

    Returns:
        A note for each that is far stronger than usual.
    """
    notes = []
    for one in causes:
        p = one.hypothesis.effect.severity
        times = abs(one.value[p.name]) / p.typical
        if times > _UNUSUAL:
            notes.append(
                f"{one.hypothesis.name}: {p.name} {one.value[p.name]:.3g} {p.unit} is {times:.0f} times what is usual; "
                "measure it: if it is not so, something that is not on the list acts instead"
            )
    return notes
