"""Settings of a simulated drape: law, mode (drop or equilibrium), support, laid-down shape and rest shape."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral, Real
from typing import Literal, get_args

import numpy as np

from cusick_bench.sim.constants import GRAVITY, PLATE_RADIUS, Law
from cusick_bench.sim.engine.pace import PaceName
from cusick_bench.sim.errors import SimulationError

Clamp = Literal["half", "whole"]
"""How hinges on the plate's edge bend: their free half alone, or all of them."""

Membrane = Literal["softened", "given"]
"""Whether the membrane is softened to what the mesh can bend (`sim.cloth.membrane`), or as the cloth's table says."""

MOST_HALVINGS = 2
"""How often a drop that flies apart is begun again with half the step. Of 1000 random cloths 17 fly apart in steps of
50 ms (law `plate`, 297 vertices), and none in shorter ones."""


_WHOLE = ("steps", "iterations", "seed")
_REAL = (
    "step_seconds",
    "gravity",
    "plate_radius",
    "laying_amplitude",
    "laying_length",
    "rest_amplitude",
    "rest_length",
    "self_contact",
    "tolerance",
)


def _require_number(name: str, value: object, kind: type, what: str) -> None:
    """Refuses what is no number of a kind: text, nothing, a tensor, or a truth value, which Python takes for 0 or 1."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, kind):
        raise SimulationError(f"{name} must be {what}, got {value!r:.60}; leave it out for the usual one")


@dataclass(frozen=True)
class DrapeSettings:
    """Settings of a simulated drape.

    Attributes:
        law: `plate` (an orthotropic plate that converges with the mesh), `paper` (hinges; derives from an energy) or
            `published` (the published program's, quirks included).
        mode: `drop` (implicit Euler from the laid-down cloth) or `equilibrium` (Newton to rest, from a drop's end or
            from a given drape).
        steps: Steps of a drop.
        step_seconds: Step of a drop [s]; a cloth that flies apart is dropped again in shorter ones (`halvings`).
        pace: `steady` (all of the steps) or `brisk` (two thirds, with a push between the folds' forming and the end,
            see `pace`): for many drapes whose distribution counts, not the single drape. A brisk drop has no gradient.
        gravity: [m/s2].
        plate_radius: [m].
        support: `fixed` (plate vertices eliminated) or `springs` (held by 1 kN/m, as published; the plate's edge free).
        clamp: How hinges on the edge of a plate of support `fixed` bend. `half`: in their free half alone, for the
            other half lies on the plate; `whole`: in both, as in the published program, which is half as stiff there
            and lets the cloth hang too low. By default `half` under law `paper`, `whole` under law `published`.
            Springs are no clamp: on them the edge bends as all of the cloth. Law `plate` has no hinges, and its clamp
            is exact.
        membrane: `softened` on coarse meshes, so that limp cloth does not lock (`sim.cloth.membrane`; law `plate`
            alone, its default), or `given` by the cloth's table.
        laying_amplitude: Standard deviation of the height in which the cloth is laid down [m].
        laying_length: Its correlation length [m].
        rest_amplitude: Standard deviation of the rest shape's height [m].
        rest_length: Its correlation length [m].
        seed: Seed of the laid-down and the rest shape.
        self_contact: Thickness within which the cloth keeps off itself [m], in mode `equilibrium` (needs the extra
            `contact`); 0 lets folds pass through each other, as the paper does.
        tolerance: Net force at which an equilibrium counts as reached, as a fraction of the weight.
        iterations: Most Newton steps of an equilibrium.
        backend: Linear solver.

    Raises:
        SimulationError: A value out of range or of another type; it is a ValueError.
    """

    law: Law = "paper"
    mode: Literal["drop", "equilibrium"] = "drop"
    steps: int = 100
    step_seconds: float = 0.05
    pace: PaceName = "steady"
    gravity: float = GRAVITY
    plate_radius: float = PLATE_RADIUS
    support: Literal["fixed", "springs"] = "fixed"
    clamp: Clamp | None = None
    membrane: Membrane | None = None
    laying_amplitude: float = 1e-3
    laying_length: float = 0.03
    rest_amplitude: float = 0.0
    rest_length: float = 0.03
    seed: int = 0
    self_contact: float = 0.0
    tolerance: float = 1e-9
    iterations: int = 500
    backend: str = "auto"

    def __post_init__(self) -> None:
        from cusick_bench.sim.cloth.shape import smooth_field

        for name, options in (
            ("law", get_args(Law)),
            ("mode", ("drop", "equilibrium")),
            ("support", ("fixed", "springs")),
            ("pace", ("steady", "brisk")),
        ):
            if getattr(self, name) not in options:
                raise SimulationError(f"{name} must be one of {', '.join(options)}, got {getattr(self, name)!r}")
        if self.clamp not in (None, "half", "whole"):
            raise SimulationError(f"clamp must be half or whole, got {self.clamp!r}")
        if self.clamp == "half" and (self.law != "paper" or self.support != "fixed"):
            raise SimulationError(
                "clamp 'half' is for law 'paper' on support 'fixed', "
                f"got law {self.law!r} on support {self.support!r}; use clamp 'whole', or leave it out"
            )
        if self.membrane not in (None, "softened", "given"):
            raise SimulationError(f"membrane must be softened or given, got {self.membrane!r}")
        if self.membrane == "softened" and self.law != "plate":
            raise SimulationError(
                f"membrane 'softened' is for law 'plate', got law {self.law!r}; use membrane 'given', or leave it out"
            )
        for name in _WHOLE:
            _require_number(name, getattr(self, name), Integral, "a whole number")
        for name in _REAL:
            _require_number(name, getattr(self, name), Real, "a number")
        if not isinstance(self.backend, str):
            raise SimulationError(f"backend must be the name of a linear solver, or auto, got {self.backend!r}")
        for name in ("steps", "step_seconds", "gravity", "plate_radius", "tolerance", "iterations"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise SimulationError(f"{name} must be > 0 and finite, got {value}")
        if self.seed < 0:
            raise SimulationError(f"seed must be >= 0, got {self.seed}")
        for name in ("laying", "rest"):
            smooth_field(getattr(self, f"{name}_amplitude"), getattr(self, f"{name}_length"), np.random.default_rng(0))
        if not (np.isfinite(self.self_contact) and self.self_contact >= 0):
            raise SimulationError(f"self_contact must be >= 0 m and finite, got {self.self_contact}")
        if self.self_contact > 0 and self.law == "published":
            raise SimulationError(
                "self-contact needs a law that derives from an energy, got law 'published'; use law 'plate' or "
                "'paper', or leave self-contact out"
            )
        if self.self_contact > 0 and self.mode == "drop":
            raise SimulationError("self-contact is for mode 'equilibrium', whose gradients know of it; got mode 'drop'")
        if self.law == "plate" and self.support != "fixed":
            raise SimulationError("law 'plate' is clamped on the plate, got support 'springs'; use support 'fixed'")
        if self.pace == "brisk" and self.mode == "equilibrium":
            raise SimulationError("pace 'brisk' is for mode 'drop', got mode 'equilibrium'; use pace 'steady'")
        if self.mode == "equilibrium" and self.law == "published":
            raise SimulationError(
                "law 'published' has no energy, so no equilibrium mode; use mode 'drop', or law 'plate' or 'paper'"
            )

    @property
    def half_hinges(self) -> bool:
        """Whether hinges on the plate's edge bend in their free half alone."""
        return self.clamp != "whole" and self.law == "paper" and self.support == "fixed"

    @property
    def softens_membrane(self) -> bool:
        """Whether cloth is draped with the membrane that its mesh can bend."""
        return self.law == "plate" and self.membrane != "given"

    @property
    def halvings(self) -> int:
        """Largest number of times that a cloth which flies apart is dropped again with half the step.

        Never by the settings of the published program, whose drops fail then: its law, its springs, or its hinges that
        bend as a whole on the clamp.
        """
        whole = self.law == "paper" and self.clamp == "whole"
        return 0 if self.law == "published" or self.support == "springs" or whole else MOST_HALVINGS
