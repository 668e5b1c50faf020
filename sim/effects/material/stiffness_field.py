"""Stiffness varies smoothly over the specimen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from jaxtyping import Float

from cusick_bench.sim.constants import FIELD_LENGTH
from cusick_bench.sim.effects.base import Effect, Parameter, Values

if TYPE_CHECKING:
    from torch import Tensor

    from cusick_bench.sim.cloth.shape import SmoothField
    from cusick_bench.sim.setup import Setup


_STREAM = 0x5F1E1D  # makes these random numbers independent of others for the same specimen


@dataclass(frozen=True, eq=False)
class LogField:
    """A realised field, differentiable in its spread and length.

    Attributes:
        unit: The realisation of unit spread and unit length.
        spread: Standard deviation [1].
        length: Correlation length [m]: the correlation is exp(-d^2 / (2 length^2)).
    """

    unit: SmoothField
    spread: float | Tensor
    length: float | Tensor

    def __call__(self, points: Float[Tensor, "points 2"]) -> Float[Tensor, " points"]:
        import torch

        waves, phases = torch.from_numpy(self.unit.wave_vectors), torch.from_numpy(self.unit.phases)
        x, y = points[:, :1] / self.length, points[:, 1:] / self.length
        cosines = torch.cos(x * waves[:, 0] + y * waves[:, 1] + phases)  # no BLAS, as in `SmoothField`
        return self.spread * (2 / len(phases)) ** 0.5 * cosines.sum(1)


class StiffnessField(Effect):
    """Independent smooth fields of stretch and bending stiffness, new for every specimen."""

    name = "stiffness-field"
    kind = "material"
    summary = "stiffness varies smoothly over the cloth"
    physics = (
        "C and B are multiplied by exp(q), q two independent Gaussian fields of standard deviation `spread` and "
        "covariance exp(-d^2 / (2 length^2)), drawn anew for every specimen."
    )
    reference = "Rahimi, Recht. Random features for large-scale kernel machines. NeurIPS 2007 (how fields are drawn)."
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "spread", "1", 0.0, 2.0, 0.2, "assumed: 20 %, as between faces and specimens of one cloth",
            summary="standard deviation of log stiffness",
        ),
        Parameter(
            "length", "m", 0.005, 0.3, FIELD_LENGTH, "assumed: some ten yarn repeats", "size", FIELD_LENGTH,
            "correlation length",
        ),
    )  # fmt: skip
    gradient = "adjoint"

    def _apply(self, setup: Setup, value: Values) -> Setup:
        from cusick_bench.sim.cloth.shape import smooth_field

        generator = np.random.default_rng([*setup.specimen_seed, _STREAM])
        stretch, bending = (
            LogField(smooth_field(1.0, 1.0, generator), value["spread"], value["length"]) for _ in range(2)
        )
        return setup.with_added(log_stretch=stretch, log_bending=bending)
