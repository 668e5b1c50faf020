"""Design of a withheld suite: nulls, single effects by severity, pairs, and effects outside the list.

If a table of detectable severities is given, severities are multiples of those in the case's own fabric; where such a
multiple exceeds the bounds of the effect, another fabric is drawn. Otherwise they are multiples of typical severities.
Numbers are written out here instead of being taken from the package's effects, since a suite must keep its meaning when
those change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from cusick_bench.sim.effects import registered
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.suite.detectable import DetectableSeverities
from cusick_bench.withheld.world.registry import DEFAULT, world_of

if TYPE_CHECKING:
    from cusick_bench.withheld.world.world import World

Kind = Literal["null", "single", "pair", "unknown"]
KINDS: tuple[Kind, ...] = ("null", "single", "pair", "unknown")
MULTIPLES = (0.5, 1.0, 2.0, 4.0)
_PAIR_MULTIPLES = (2.0, 4.0)
_ALIKE = ({"plate-radius", "cut-size", "camera-scale", "threshold"}, {"creep", "bending-friction"})  # no pairs of these
_ATTEMPTS = 60  # fabrics drawn for an effect to be seen in
_DIRECTION = (0.0, 360.0)  # [deg]
_AXIS = (0.0, 180.0)  # [deg]
_PATCH = {"direction": _DIRECTION, "radius": (0.115, 0.135), "size": (0.017, 0.023)}


@dataclass(frozen=True)
class Draw:
    """How the parameters of an effect are drawn.

    Attributes:
        severity: Name of the parameter that is 0 where the effect is absent.
        typical: Value of that parameter that is met in practice, in its own unit.
        most: Largest magnitude of that parameter.
        negative: Share of cases where that parameter is negative.
        others: Ranges of the other parameters.
    """

    severity: str
    typical: float
    most: float
    negative: float = 0.0
    others: Mapping[str, tuple[float, float]] | None = None

    def parameters(self, severity: float, generator: np.random.Generator) -> dict[str, float]:
        """Draws all parameters of the effect.

        Args:
            severity: Magnitude of the severity, in the effect's own unit.
            generator: Source of randomness.

        Returns:
            The parameters, rounded as they are written.
        """
        sign = -1 if generator.uniform() < self.negative else 1
        drawn = {name: float(f"{generator.uniform(*ends):.4g}") for name, ends in (self.others or {}).items()}
        return {self.severity: sign * float(f"{min(severity, self.most):.4g}"), **drawn}


EFFECTS: dict[str, Draw] = {
    "rest-curvature": Draw("curvature", 10, 60, 0.5, {"direction": _AXIS}),
    "face-asymmetry": Draw("asymmetry", 0.2, 0.85, 0.5),
    "grain-skew": Draw("angle", 2, 45, 0.5),
    "density-bias": Draw("bias", 0.03, 0.5, 0.5),
    "stiffness-field": Draw("spread", 0.2, 1.0, 0.0, {"length": (0.03, 0.05)}),
    "local-stiff-patch": Draw("stiffening", float(np.log(3)), 3, 0.2, _PATCH),
    "local-mass-patch": Draw("mass", 1, 10, 0.0, _PATCH),
    "rim-stiffening": Draw("stiffening", float(np.log(3)), 3, 0.2, {"width": (0.008, 0.015)}),
    "creep": Draw("loss", 0.15, 0.8),
    "bending-friction": Draw("ratio", 20, 150),
    "shear-friction": Draw("ratio", 0.6, 8),
    "off-centre": Draw("shift", 2e-3, 0.02, 0.0, {"direction": _DIRECTION}),
    "plate-tilt": Draw("angle", 1, 15, 0.0, {"direction": _DIRECTION}),
    "plate-radius": Draw("error", 1e-3, 0.01, 0.5),
    "plate-slip": Draw("slide", 2e-3, 0.015),
    "cut-size": Draw("error", 1e-3, 0.01, 0.5),
    "self-contact": Draw("thickness", 1e-3, 5e-3),
    "camera-scale": Draw("error", 0.02, 0.15, 0.5),
    "camera-offset": Draw("shift", 1.4e-3, 0.02, 0.0, {"direction": _DIRECTION}),
    "camera-tilt": Draw("angle", 2, 25, 0.0, {"direction": _DIRECTION}),
    "perspective": Draw("inverse_height", 0.7, 2.5),
    "threshold": Draw("shift", 0.7e-3, 4e-3, 0.5),
}
"""Draws of the package's effects."""

DRAWN = tuple(name for name in EFFECTS if name != "self-contact")
"""What suites hold. Folds of a 30 cm cloth hang too far apart to touch (nowhere nearer than 6 mm, down to the limpest
fabric drawn), so self-contact up to its bound changes no pixel, and a label that names it would be false."""

OUTSIDE: dict[str, Draw] = {
    "draught": Draw("speed", 0.5, 3, 0.0, {"direction": _DIRECTION}),
    "charge": Draw("share", 0.1, 1),
    "seam": Draw("size", 0.7, 3, 0.0, {"direction": _AXIS, "offset": (-0.1, 0.1)}),
    "crease-ring": Draw("angle", 20, 90, 0.5, {"radius": (0.105, 0.135)}),
    "elliptical-cut": Draw("elongation", 0.01, 0.05, 0.0, {"direction": _AXIS}),
    "lens": Draw("strength", 1.5, 8, 0.3),
    "smear": Draw("length", 4, 16, 0.0, {"direction": _AXIS}),
    "frilled": Draw("growth", 0.02, 0.08),
}
"""Draws of effects outside the list, at 1, 2 and 4 times the typical severity."""


@dataclass(frozen=True)
class Plan:
    """Plan of a case: its kind, effects and severities.

    Attributes:
        case: Name of the case.
        number: Number of the case, from 1; with the suite's seed it decides the fabric and all chance.
        kind: What the case is for.
        causes: Effects with their parameters.
        multiple: Severity in multiples of the reference; 0 for a null.
        reference: What the severities are multiples of.
        attempt: Number of the draw of its fabric that is taken.
    """

    case: str
    number: int
    kind: Kind
    causes: Mapping[str, Mapping[str, float]]
    multiple: float
    reference: Literal["detectable", "typical"]
    attempt: int = 0


def plan_suite(
    seed: int,
    counts: Mapping[Kind, int],
    detectable: DetectableSeverities | None = None,
    world_name: str = DEFAULT,
    multiples: Sequence[float] = MULTIPLES,
) -> list[Plan]:
    """Draws the cases of a suite, in an order that tells nothing.

    Args:
        seed: Seed of the suite.
        counts: How many cases of each kind. Single effects and severities are spread evenly.
        detectable: Severities at which each effect is detected in most cases.
        world_name: World that the cases lie in; they hold effects that it can do.
        multiples: Severities of single effects, in multiples of the reference.

    Returns:
        The cases.

    Raises:
        WithheldError: No cases, no such world, or a detectable severity of an unknown effect.
    """
    _check(counts, detectable)
    generator, world = np.random.default_rng([seed, 0]), world_of(world_name)
    listed, outside = (tuple(name for name in names if name in world.laws) for names in (DRAWN, OUTSIDE))
    drawn: list[tuple[Kind, tuple[str, ...], float]] = [("null", (), 0.0)] * counts["null"]
    for name, multiple in _spread(listed, multiples, counts["single"], generator):
        drawn.append(("single", (name,), multiple))
    for first, multiple in _spread(listed, _PAIR_MULTIPLES, counts["pair"], generator):
        second = _partner(first, listed, generator)
        drawn.append(("pair", tuple(name for name in EFFECTS if name in (first, second)), multiple))
    for name, multiple in _spread(outside, MULTIPLES[1:], counts["unknown"], generator):
        drawn.append(("unknown", (name,), multiple))
    plans = []
    for number, which in enumerate(generator.permutation(len(drawn)), 1):
        kind, names, multiple = drawn[which]
        severities, reference, attempt = _severities(world, (seed, number), names, multiple, detectable)
        causes = {name: _draw(name).parameters(severity, generator) for name, severity in severities.items()}
        plans.append(Plan(f"case_{number:04d}", number, kind, causes, multiple, reference, attempt))
    return plans


def _severities(
    world: World,
    seed: tuple[int, int],
    names: Sequence[str],
    multiple: float,
    detectable: DetectableSeverities | None,
) -> tuple[dict[str, float], Literal["detectable", "typical"], int]:
    """Severities of a case's effects, what they are multiples of, and the fabric in which they can be so large."""
    if detectable is not None and names and all(name in detectable.severity for name in names):
        for attempt in range(_ATTEMPTS):
            stiffness = world.fabric_of(seed, attempt).stiffness
            severities = {name: detectable.at(name, stiffness) for name in names}
            wanted = {name: multiple * value for name, value in severities.items() if value is not None}
            if len(wanted) == len(names) and all(value <= EFFECTS[name].most for name, value in wanted.items()):
                return wanted, "detectable", attempt
    return {name: multiple * _draw(name).typical for name in names}, "typical", 0


def _draw(name: str) -> Draw:
    return EFFECTS[name] if name in EFFECTS else OUTSIDE[name]


def _check(counts: Mapping[Kind, int], detectable: DetectableSeverities | None) -> None:
    if sum(counts.values()) < 1 or min(counts.values()) < 0:
        raise WithheldError(f"a suite needs at least one case, got {dict(counts)}; ask for nulls, singles or others")
    for name in detectable.severity if detectable else ():
        if name not in EFFECTS and name not in registered():  # no world has those of other packages
            raise WithheldError(
                f"detectable severities are those of known effects, got {name!r}; known are {', '.join(EFFECTS)}"
            )


def _spread(
    names: Sequence[str], multiples: Sequence[float], count: int, generator: np.random.Generator
) -> list[tuple[str, float]]:
    """As many of every name and multiple as can be, in a random order."""
    cells = [(name, multiple) for multiple in multiples for name in names]
    found: list[tuple[str, float]] = []
    while len(found) < count:
        found += [cells[i] for i in generator.permutation(len(cells))]
    return found[:count]


def _partner(first: str, listed: Sequence[str], generator: np.random.Generator) -> str:
    """Another effect that silhouettes can tell from the first."""
    alike = {name for group in _ALIKE for name in group if first in group} | {first}
    others = [name for name in listed if name not in alike]
    return others[int(generator.integers(len(others)))]
