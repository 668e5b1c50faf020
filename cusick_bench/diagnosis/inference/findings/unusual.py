"""Notes on effects that would have to be far stronger than they usually are.

A cause that is not on the list may look like a listed effect of many times its usual strength: a draught moves the
outline as a camera does that stands centimetres off its place.
"""

from collections.abc import Sequence

from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate

_UNUSUAL = 6.0  # typical severities; no atlas has draped stronger effects


def unusual(causes: Sequence[Candidate]) -> list[str]:
    """Notes on effects that should be measured before they are believed.

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
                f"{one.hypothesis.name}: {p.name} {one.value[p.name]:.3g}{p.unit_text} is {times:.0f} times what is "
                "usual; measure it: if it is not so, something that is not on the list acts instead"
            )
    return notes
