"""Ways to make a drape, each other by one factor from the base, and the factors with their levels.

A cloth of given stiffness is laid down in a random smooth shape and released. What the base has is what the standard
drape of this project has; the levels span what is known of laboratories and cloths, or what a simulation may choose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from cusick_bench.benchmark.convergence.plate_cloth import STRETCH
from cusick_bench.sim.release import STEP_SECONDS, STEPS

if TYPE_CHECKING:
    from cusick_bench.sim.constants import Law

SLOW_STAGES = 8  # parts in which the weight is laid on the cloth where it is released slowly


@dataclass(frozen=True)
class Condition:
    """One way to make a drape.

    Attributes:
        law: Material law.
        vertices: Mesh size.
        ln_bending: ln of bending stiffness over rho g R^3.
        laying_length: Correlation length of the shape in which the cloth is laid down [m].
        laying_height: Standard deviation of its height [m].
        step_seconds: Step of the drop [s]; implicit Euler damps motion by its step.
        fall_seconds: Time of fall [s].
        stages: 0 for a drop; otherwise the weight is laid on in so many equal parts and the cloth comes to rest after
            each, without inertia.
        slide: How far from the plate's axis the cloth's centre lies, in a direction drawn anew for each drape [m].
        rest_height: Standard deviation of the height of the rest shape [m].
        shear: Shear stiffness of the cloth of 0.2 kg/m2 [N/m].
    """

    law: Law = "plate"
    vertices: int = 700
    ln_bending: float = -7.0
    laying_length: float = 0.02
    laying_height: float = 1e-3
    step_seconds: float = STEP_SECONDS
    fall_seconds: float = STEPS * STEP_SECONDS
    stages: int = 0
    slide: float = 0.0
    rest_height: float = 0.0
    shear: float = STRETCH / 2

    @property
    def steps(self) -> int:
        """Number of steps of the drop."""
        return max(1, round(self.fall_seconds / self.step_seconds))


@dataclass(frozen=True)
class Level:
    """A condition as a level of a factor.

    Attributes:
        factor: Name of the factor, among `FACTORS`.
        label: What it is set to, with its unit.
        condition: The way to make a drape.
    """

    factor: str
    label: str
    condition: Condition


_LENGTHS, _HEIGHTS = (0.005, 0.01, 0.02, 0.045), (1e-4, 4e-4, 1e-3, 3e-3, 6e-3)
_BENDINGS = (-8.5, -7.0, -5.5)
_BENDING_LENGTHS = (0.01, 0.02, 0.045)
_STEPS = (0.025, 0.05, 0.1, 0.2)
_RELEASES = {0: "drop", 1: "to rest, all weight at once", SLOW_STAGES: f"to rest, weight in {SLOW_STAGES} parts"}
_SLIDES, _REST_HEIGHTS = (0.0, 3e-3, 1e-2), (0.0, 3e-4, 1e-3)
_SHEARS = (15.0, 45.0, STRETCH / 2)  # [N/m]; woven cloth has 17 to 170 (Kawabata's G of .3 to 3 gf/(cm deg))
_PAPER_SIZES, _PLATE_SIZES = (480, 700, 1205), (700, 1205, 2699)

FACTORS: Mapping[str, str] = {
    "stiffness": "bending stiffness at three laid wave lengths",
    "mesh": "material law and mesh size",
    "laying-length": "correlation length of the laid shape",
    "laying-height": "height of the laid shape",
    "release": "drop, or rests under growing weight",
    "step": "time step over the same time of fall: numerical damping",
    "slide": "how far off the plate's axis the cloth lies: friction that keeps it where it was laid",
    "rest-shape": "height of the rest shape",
    "shear": "shear stiffness of the cloth",
}
"""The factors, and what they are."""


def levels(base: Condition, factors: Sequence[str] = tuple(FACTORS)) -> list[Level]:
    """The conditions to compare: every level of every factor, all else as in the base.

    Args:
        base: Law, mesh size, and everything that a factor does not set.
        factors: Names among `FACTORS`.

    Returns:
        The levels; the base itself is one in every factor but, where it is of another law, the mesh.
    """
    made: dict[str, list[tuple[str, Condition]]] = {
        "stiffness": [
            (f"ln B {bending:g}, length {1e3 * length:g} mm", replace(base, ln_bending=bending, laying_length=length))
            for length in _BENDING_LENGTHS
            for bending in _BENDINGS
        ],
        "mesh": [
            *((f"paper, {size} vertices", replace(base, law="paper", vertices=size)) for size in _PAPER_SIZES),
            *((f"plate, {size} vertices", replace(base, law="plate", vertices=size)) for size in _PLATE_SIZES),
        ],
        "laying-length": [(f"{1e3 * value:g} mm", replace(base, laying_length=value)) for value in _LENGTHS],
        "laying-height": [(f"{1e3 * value:g} mm", replace(base, laying_height=value)) for value in _HEIGHTS],
        "release": [(name, replace(base, stages=value)) for value, name in _RELEASES.items()],
        "step": [(f"{1e3 * value:g} ms", replace(base, step_seconds=value)) for value in _STEPS],
        "slide": [(f"{1e3 * value:g} mm", replace(base, slide=value)) for value in _SLIDES],
        "rest-shape": [(f"{1e3 * value:g} mm", replace(base, rest_height=value)) for value in _REST_HEIGHTS],
        "shear": [(f"{value:g} N/m", replace(base, shear=value)) for value in _SHEARS],
    }
    return [Level(factor, label, condition) for factor in factors for label, condition in made[factor]]
