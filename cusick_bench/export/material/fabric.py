"""What of a fabric goes to other programs, and the means that isotropic ones take."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from cusick_bench.export.errors import ExportError
from cusick_bench.metrics.found_stiffness import Quantity
from cusick_bench.metrics.stiffness import BENDING, STRETCH
from cusick_bench.sim.constants import HEAVIEST_CLOTH, LIGHTEST_CLOTH


@dataclass(frozen=True)
class FabricMaterial:
    """A fabric's stiffness and weight.

    Attributes:
        name: The fabric.
        solver: Who found the stiffness, with the effects that the simulator knew of.
        source: The result that it is from.
        density: Areal density [kg/m2].
        bending: Bending stiffness of warp, weft and bias [N m].
        stretch: Membrane stiffness of warp, weft and shear: the second derivative of the energy per area by the strain
            (or shear angle), at rest [N/m].
        curve: Bending stiffness by direction at curvatures of 0, 10, 20, 30 and 40 /m [N m]; empty where the result
            does not say.
        fitted_density: Areal density of the result, by which the stiffness was scaled to this one [kg/m2]; None where
            it was not.

    Raises:
        ExportError: A stiffness that is not above 0, or a weight that no cloth has.
    """

    name: str
    solver: str
    source: str
    density: float
    bending: Mapping[str, Quantity]
    stretch: Mapping[str, Quantity]
    curve: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    fitted_density: float | None = None

    def __post_init__(self) -> None:
        if not LIGHTEST_CLOTH <= self.density <= HEAVIEST_CLOTH:
            raise ExportError(
                f"areal density must be {LIGHTEST_CLOTH} to {HEAVIEST_CLOTH} kg/m2, got {self.density}; correct "
                "--density or the weight in the data"
            )
        for names, values, kind in ((BENDING, self.bending, "bending"), (STRETCH, self.stretch, "stretch")):
            for name in names:
                if name not in values:
                    raise ExportError(f"{self.source}: {kind} stiffness of {name} is missing; make the result again")
                one = values[name]
                low, high = one.ci90 or (one.value, one.value)
                if not (one.value > 0 and 0 < low <= high < math.inf):
                    raise ExportError(
                        f"{self.source}: {kind} stiffness of {name} must be > 0 with an ordered interval, got "
                        f"{one.value} {list(one.ci90 or ())}; make the result again"
                    )

    def weighing(self, density: float) -> FabricMaterial:
        """The fabric of another weight that drapes alike: its stiffness changes as its weight does.

        Args:
            density: Its areal density [kg/m2].

        Returns:
            The fabric.

        Raises:
            ExportError: A weight that no cloth has.
        """
        if density == self.density:
            return self
        factor = density / self.density
        return replace(
            self,
            density=density,
            bending={name: one.times(factor) for name, one in self.bending.items()},
            stretch={name: one.times(factor) for name, one in self.stretch.items()},
            curve={name: tuple(factor * value for value in values) for name, values in self.curve.items()},
            fitted_density=self.density,
        )

    @property
    def mean_bending(self) -> Quantity:
        """Geometric mean over warp, weft and both diagonals [N m]."""
        return _geometric_mean([self.bending[name] for name in ("warp", "weft", "bias", "bias")])

    @property
    def mean_stretch(self) -> Quantity:
        """Geometric mean of warp and weft [N/m]."""
        return _geometric_mean([self.stretch["warp"], self.stretch["weft"]])

    @property
    def anisotropy(self) -> float:
        """The stiffest direction of bending over the softest."""
        values = [one.value for one in self.bending.values()]
        return max(values) / min(values)


def _geometric_mean(quantities: Sequence[Quantity]) -> Quantity:
    """The mean; its interval takes all low ends together and all high ends, and is so never too narrow."""

    def mean(numbers: Sequence[float]) -> float:
        return math.exp(sum(map(math.log, numbers)) / len(numbers))

    intervals = [one.ci90 for one in quantities if one.ci90 is not None]
    value = mean([one.value for one in quantities])
    if len(intervals) < len(quantities):
        return Quantity(value)
    return Quantity(value, (mean([low for low, _ in intervals]), mean([high for _, high in intervals])))
