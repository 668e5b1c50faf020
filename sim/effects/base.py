"""Base class of effects: something that the base model leaves out, expressed as a change of a `Setup`.

A new effect is one file with one subclass of `Effect` and one line in `registry.py` (or an entry point in the group
`cusick_bench.effects`); the contract tests pick it up.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, get_args

from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.units import shown_unit

if TYPE_CHECKING:
    from torch import Tensor

    from cusick_bench.sim.setup import Setup


EffectClass = Literal["material", "history", "boundary", "contact", "imaging"]
Role = Literal["severity", "direction", "radius", "size"]
Place = Literal["", "direction", "patch", "ring"]
GradientWay = Literal["adjoint", "differences"]
KINDS: tuple[str, ...] = get_args(EffectClass)
"""Classes of effects."""
Values = Mapping[str, "float | Tensor"]
"""Parameters of an effect by name."""


@dataclass(frozen=True)
class Parameter:
    """A number that an effect takes.

    Attributes:
        name: E.g. `curvature`.
        unit: E.g. `1/m`; `1` of a pure number.
        low, high: Bounds; finite, and those of a severity hold 0.
        typical: A value that is met in practice; of a severity not 0.
        source: Where `typical` comes from.
        role: `severity` (0 = the effect is absent; each effect has exactly one), `direction` [deg], `radius` or
            `size` [m].
        default: Used where the parameter is not given; for the severity it is `typical`.
        summary: What it is.
    """

    name: str
    unit: str
    low: float
    high: float
    typical: float
    source: str
    role: Role = "severity"
    default: float = 0.0
    summary: str = ""

    @property
    def unit_text(self) -> str:
        """The unit behind a number, with a space before it; empty of a pure number."""
        unit = shown_unit(self.unit)
        return f" {unit}" if unit else ""

    @property
    def usual(self) -> float:
        """The value that is used where none is given."""
        return self.typical if self.role == "severity" else self.default


class Effect(ABC):
    """Something that the base model leaves out.

    Attributes:
        name: Fixed, used in answers and labels.
        kind: Class.
        summary: One line.
        physics: What it does, in a sentence with its equation.
        reference: Source of the equation.
        parameters: Exactly one has the role `severity`.
        located: Where it acts: nowhere in particular, along a direction, in a patch, in a ring. A parameter with the
            role `direction` is that of a direction or a patch.
        gradient: `adjoint` where drapes are differentiable to its parameters, else `differences` with common random
            numbers.
        face_odd: Whether it acts with the opposite sign when the cloth is turned over.
        repeatable: Whether it may be given twice; False where the second would not add to the first.
        version: Raised when it changes drapes in another way; finished cells with it are then computed again.
    """

    name: ClassVar[str]
    kind: ClassVar[EffectClass]
    summary: ClassVar[str]
    physics: ClassVar[str]
    reference: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    located: ClassVar[Place] = ""
    gradient: ClassVar[GradientWay] = "differences"
    face_odd: ClassVar[bool] = False
    repeatable: ClassVar[bool] = True
    version: ClassVar[int] = 1

    @abstractmethod
    def _apply(self, setup: Setup, value: Values) -> Setup:
        """The setup with the effect; `value` holds every parameter, severity not 0."""

    @property
    def severity(self) -> Parameter:
        """The parameter that is 0 where the effect is absent."""
        return next(p for p in self.parameters if p.role == "severity")

    @property
    def signed(self) -> bool:
        """Whether negative severities mean something: whether its bounds allow them."""
        return self.severity.low < 0

    def complete(self, value: Values) -> dict[str, float | Tensor]:
        """All parameters: the given ones, defaults for the others.

        Args:
            value: Parameters by name.

        Returns:
            Every parameter by name.

        Raises:
            SimulationError: An unknown name, or a value out of bounds.
        """
        known = {p.name: p for p in self.parameters}
        for name in value:
            if name not in known:
                raise SimulationError(f"effect {self.name} has no parameter {name!r}; use {', '.join(known)}")
        full = {p.name: value.get(p.name, p.usual) for p in self.parameters}
        for name, given in full.items():
            p, number = known[name], _number(given)
            if not p.low <= number <= p.high:  # also refuses NaN
                bounds = f"{p.low:g} to {p.high:g}{p.unit_text}"
                raise SimulationError(f"effect {self.name}: {name} must lie within {bounds}, got {number:g}")
        return full

    def apply(self, setup: Setup, value: Values) -> Setup:
        """The setup with this effect.

        Args:
            setup: A drape about to be made.
            value: Parameters by name; those left out take their defaults.

        Returns:
            Another setup; the given one stays as it is.

        Raises:
            SimulationError: An unknown parameter, a value out of bounds, or an effect that makes no setup.
        """
        full = self.complete(value)
        severity = full[self.severity.name]
        if not _is_tensor(severity) and severity == 0:
            return setup
        changed = self._apply(setup, full)
        if not isinstance(changed, type(setup)):
            raise SimulationError(
                f"effect {self.name}: _apply must return a Setup, got {changed!r:.60}; return one made by "
                "dataclasses.replace"
            )
        return changed


def _is_tensor(value: float | Tensor) -> bool:
    return hasattr(value, "detach")  # who only reads numbers does not wait for torch


def _number(value: float | Tensor) -> float:
    return float(value.detach() if _is_tensor(value) else value)  # pyright: ignore[reportAttributeAccessIssue]
