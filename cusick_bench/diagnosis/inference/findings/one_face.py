"""Directions of the laboratory's effects where all samples lie on one face.

An effect of plate or camera may keep its direction on the bench when the cloth is turned over, or turn with the cloth
(`Hypothesis.frame`). Pictures of one face cannot tell: both move them alike. So the direction is stated on the bench,
where `--with-effect` simulates it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate
from cusick_bench.diagnosis.inference.single_effects.hypotheses import Hypothesis
from cusick_bench.sim.effects.effect_timing import in_lab


@dataclass(frozen=True)
class FacesShown:
    """Which faces the data show, and how a cloth that lies face down is seen.

    Attributes:
        single: -1 where only the upper face is known, 1 where only the lower one, 0 where both are.
        warp_seen_down: Angle at which the camera sees the warp of a cloth that lies face down [rad].
    """

    single: int = 0
    warp_seen_down: float = np.pi

    def on_the_bench(self, one: Candidate) -> Candidate:
        """A cause with its direction on the bench, where one face does not tell whether it turns with the cloth.

        Args:
            one: The cause.

        Returns:
            The same cause; as it is where both faces are known, and without a direction of the laboratory.
        """
        if not self.single or not in_lab(one.hypothesis.effect):
            return one
        value = self.stated(one.hypothesis, one.value)
        return replace(one, hypothesis=replace(one.hypothesis, frame="lab"), value=value)

    def stated(self, hypothesis: Hypothesis, value: Mapping[str, float]) -> dict[str, float]:
        """Parameters with the direction on the bench: the camera sees that of a cloth face down mirrored.

        Args:
            hypothesis: The effect and the frame of its direction.
            value: Its parameters.

        Returns:
            The parameters.
        """
        stated = dict(value)
        if self.single > 0 and in_lab(hypothesis.effect) and hypothesis.frame == "cloth":
            name = next(p.name for p in hypothesis.effect.parameters if p.role == "direction")
            stated[name] = (float(np.rad2deg(self.warp_seen_down)) - value[name]) % 360
        return stated
