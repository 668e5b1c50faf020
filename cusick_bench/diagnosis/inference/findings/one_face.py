"""Directions of the laboratory's effects where all samples lie on one face.

An effect of plate or camera may keep its direction on the bench when the cloth is turned over, or turn with the cloth
(`Hypothesis.frame`). Pictures of one face cannot tell: both move them alike. So the direction is stated on the bench,
where `--with-effect` simulates it.
"""

from dataclasses import replace

from cusick_bench.diagnosis.atlas.effect_timing import in_lab
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate


def on_the_bench(one: Candidate, single: int) -> Candidate:
    """A cause as data state it that may show one face only.

    Args:
        one: The cause.
        single: -1 where only the upper face is known, 1 where only the lower one, 0 where both are.

    Returns:
        The same cause; of an effect of the laboratory, where only the upper face is known, with a direction that keeps
        to the bench.
    """
    if single >= 0 or not in_lab(one.hypothesis.effect):
        return one
    return replace(one, hypothesis=replace(one.hypothesis, frame="lab"))
