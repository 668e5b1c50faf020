"""The cloth slides on the plate while it is laid down."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from cusick_bench.sim.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from cusick_bench.sim.setup import Setup


_STREAM = 0x5119  # makes these random numbers independent of others for the same laying


class PlateSlip(Effect):
    """A cloth that comes to lie elsewhere each time it is laid down."""

    name = "plate-slip"
    kind = "boundary"
    summary = "the cloth slides on the plate each time it is laid down"
    physics = (
        "The cloth's centre lies at the slide's length from the plate's axis, in a direction drawn anew each time."
    )
    reference = "as off-centre, with the laying as the random unit"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("slide", "m", 0.0, 0.02, 2e-3, "assumed: as far as a cloth is misplaced", summary="of each laying"),
    )
    version = 3  # 3: beside another cut, plate or shift the cloth lies as if all came at once

    def _apply(self, setup: Setup, value: Values) -> Setup:
        from cusick_bench.sim.effects.directions import unit

        angle = math.degrees(np.random.default_rng([*setup.laying_seed, _STREAM]).uniform(0, 2 * math.pi))
        x, y = (float(value["slide"]) * unit(setup.cloth_direction(angle))).tolist()
        return setup.moved(x=x, y=y)
