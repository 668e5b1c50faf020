"""Names of effects. Write `plate-tilt`, or with parameters `plate-tilt:angle=2,direction=90`.

A package elsewhere registers its own through an entry point in the group `cusick_bench.effects`, whose value is an
`Effect` subclass.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any, get_args

from cusick_bench.sim.effects.base import KINDS, Effect, GradientWay, Parameter, Place, Role
from cusick_bench.sim.effects.boundary.cut_size import CutSize
from cusick_bench.sim.effects.boundary.off_centre import OffCentre
from cusick_bench.sim.effects.boundary.plate_radius import PlateRadius
from cusick_bench.sim.effects.boundary.plate_slip import PlateSlip
from cusick_bench.sim.effects.boundary.plate_tilt import PlateTilt
from cusick_bench.sim.effects.contact.self_contact import SelfContact
from cusick_bench.sim.effects.history.bending_friction import BendingFriction
from cusick_bench.sim.effects.history.creep import Creep
from cusick_bench.sim.effects.history.shear_friction import ShearFriction
from cusick_bench.sim.effects.imaging.camera_offset import CameraOffset
from cusick_bench.sim.effects.imaging.camera_scale import CameraScale
from cusick_bench.sim.effects.imaging.camera_tilt import CameraTilt
from cusick_bench.sim.effects.imaging.perspective import Perspective
from cusick_bench.sim.effects.imaging.threshold import Threshold
from cusick_bench.sim.effects.material.density_bias import DensityBias
from cusick_bench.sim.effects.material.face_asymmetry import FaceAsymmetry
from cusick_bench.sim.effects.material.grain_skew import GrainSkew
from cusick_bench.sim.effects.material.local_mass_patch import LocalMassPatch
from cusick_bench.sim.effects.material.local_stiff_patch import LocalStiffPatch
from cusick_bench.sim.effects.material.rest_curvature import RestCurvature
from cusick_bench.sim.effects.material.rim_stiffening import RimStiffening
from cusick_bench.sim.effects.material.stiffness_field import StiffnessField
from cusick_bench.sim.errors import SimulationError, did_you_mean, raise_stop
from cusick_bench.sim.plugins import leave_out, registered_classes, why_left_out

if TYPE_CHECKING:
    from cusick_bench.sim.setup import Setup


ENTRY_POINTS = "cusick_bench.effects"

_STATED = ("kind", "summary", "physics", "reference", "parameters")  # what every effect says of itself
_BUILT_IN: tuple[type[Effect], ...] = (
    RestCurvature,
    FaceAsymmetry,
    GrainSkew,
    DensityBias,
    StiffnessField,
    LocalStiffPatch,
    LocalMassPatch,
    RimStiffening,
    Creep,
    BendingFriction,
    ShearFriction,
    OffCentre,
    PlateTilt,
    PlateRadius,
    PlateSlip,
    CutSize,
    SelfContact,
    CameraScale,
    CameraOffset,
    CameraTilt,
    Perspective,
    Threshold,
)


@dataclass(frozen=True)
class Cause:
    """An effect with its parameters.

    Attributes:
        effect: What acts.
        value: Its parameters; those left out take their defaults.
    """

    effect: Effect
    value: dict[str, float]

    def apply(self, setup: Setup) -> Setup:
        """The setup with this cause.

        Args:
            setup: A drape about to be made.

        Returns:
            Another setup; the given one stays as it is.
        """
        return self.effect.apply(setup, self.value)


def is_built_in(one: Effect) -> bool:
    """Whether an effect is of this package.

    Args:
        one: The effect.

    Returns:
        False of an effect of another package, which is not there where that is not installed.
    """
    return type(one) in _BUILT_IN


@lru_cache(maxsize=1)
def registered() -> dict[str, Effect]:
    """Every effect by name: built in, and those of other packages."""
    found = {effect.name: effect() for effect in _BUILT_IN}
    others: Any = registered_classes(ENTRY_POINTS, Effect, found)
    for name, kind in others.items():
        try:
            made = kind()
            why = _fault(made)
        except (Exception, SystemExit) as error:  # a class of another package may raise anything
            raise_stop(error)
            leave_out(ENTRY_POINTS, name, kind, f"cannot be used ({type(error).__name__}: {error}); mend it")
            continue
        if why:
            leave_out(ENTRY_POINTS, name, kind, why)
        else:
            found[name] = made
    return found


def _fault(made: Effect) -> str:
    """What an effect of another package lacks; empty where it is whole."""
    if lacking := [name for name in _STATED if not hasattr(made, name)]:
        return f"lacks {', '.join(lacking)}; state it"
    if ":" in made.name:
        return "must have a name without colons, which part a name from its parameters; give it another one"
    if made.kind not in KINDS:
        return f"must be of a class (kind) among {', '.join(KINDS)}, got {made.kind!r}; correct it"
    for name, choices in (("located", get_args(Place)), ("gradient", get_args(GradientWay))):
        if (stated := getattr(made, name)) not in choices:
            return f"must state `{name}` as one of {', '.join(map(repr, choices))}, got {stated!r}; correct it"
    return _parameter_fault(made)


def _parameter_fault(made: Effect) -> str:
    """What is wrong with an effect's parameters; empty where nothing is."""
    if odd := [parameter for parameter in made.parameters if not isinstance(parameter, Parameter)]:
        return f"must have parameters of the class Parameter, got {odd[0]!r:.60}; correct it"
    names = [parameter.name for parameter in made.parameters]
    if twice := [name for name in names if names.count(name) > 1]:
        return f"must have parameters of different names, got {twice[0]!r} twice; rename one"
    for p in made.parameters:
        if p.role not in get_args(Role):
            return f"must have a role of {p.name} among {', '.join(get_args(Role))}, got {p.role!r}; correct it"
    severities = sum(parameter.role == "severity" for parameter in made.parameters)
    if severities != 1:
        return f"must have one parameter with the role severity, has {severities}; state one"
    if made.located not in ("direction", "patch") and any(p.role == "direction" for p in made.parameters):
        return (  # otherwise a diagnosis would take it to be the same on all sides
            f"has a direction, so it must be located 'direction' or 'patch', got {made.located!r}; state `located`"
        )
    for p in made.parameters:
        if not (math.isfinite(p.low) and math.isfinite(p.high)):
            return f"must have finite bounds of {p.name}, got {p.low:g} to {p.high:g}{p.unit_text}; correct them"
        if not p.low <= p.usual <= p.high:
            what = "typical" if p.role == "severity" else "default"
            return f"must have a {what} {p.name} of {p.low:g} to {p.high:g}{p.unit_text}, got {p.usual:g}; correct it"
    severity = made.severity
    if not severity.low <= 0 <= severity.high or severity.typical == 0:
        return (  # a diagnosis counts severities in typical ones, from the absent effect on
            f"must have a {severity.name} that is 0 where the effect is absent: its bounds must hold 0, and its "
            f"typical value must be another, got {severity.low:g} to {severity.high:g}, typical "
            f"{severity.typical:g}{severity.unit_text}; correct it"
        )
    return ""


def effect_names() -> list[str]:
    """Names of all registered effects; nothing of other packages is imported."""
    return [effect.name for effect in _BUILT_IN] + [entry.name for entry in entry_points(group=ENTRY_POINTS)]


def effect(name: str) -> Effect:
    """An effect by name.

    Args:
        name: Name of the effect, as `registered` has it.

    Returns:
        The effect.

    Raises:
        SimulationError: Unknown name, or an effect of another package that cannot be used.
    """
    effects = registered()
    if name not in effects:
        if why := why_left_out(ENTRY_POINTS, name):
            raise SimulationError(f"effect {why}")
        raise SimulationError(f"unknown effect {name!r}; {did_you_mean(name, effects)}known are {', '.join(effects)}")
    return effects[name]


def parse(text: str) -> Cause:
    """Reads `name` or `name:parameter=value,...`.

    Args:
        text: Effects as they are written on the command line.

    Returns:
        The effect with its parameters.

    Raises:
        SimulationError: Unknown effect or parameter, or a value that is no number or out of bounds.
    """
    name, _, rest = text.partition(":")
    found, value = effect(name.strip()), {}
    for part in filter(None, rest.split(",")):
        key, equals, number = part.partition("=")
        if key.strip() in value:
            raise SimulationError(f"effect {name}: the parameter {key.strip()} stands twice; give it once")
        try:
            value[key.strip()] = float(number)
        except ValueError:
            equals = ""
        if not equals:
            raise SimulationError(f"effect {name}: write parameters as name=number, got {part!r}")
    found.complete(value)
    return Cause(found, value)


def require_repeatable(causes: Sequence[Cause]) -> None:
    """Makes sure that no effect is given twice which cannot act twice.

    Args:
        causes: Effects with their parameters.

    Raises:
        SimulationError: An effect that is not `Effect.repeatable` is given twice.
    """
    times = Counter(cause.effect.name for cause in causes)
    for cause in causes:
        if times[cause.effect.name] > 1 and not cause.effect.repeatable:
            raise SimulationError(
                f"effect {cause.effect.name} must be given once, got it {times[cause.effect.name]} times, which would "
                f"not add up; give it once, with the {cause.effect.severity.name} of all together"
            )


def apply_all(causes: Sequence[Cause], setup: Setup) -> Setup:
    """The setup with all causes, in order; an effect that acts once more draws random numbers of its own.

    A cause that needs the room that a later one makes, such as a shift beside a larger cut, comes after it.

    Args:
        causes: Effects with their parameters.
        setup: A drape about to be made.

    Returns:
        Another setup; the given one stays as it is.

    Raises:
        SimulationError: An effect that cannot act twice is given twice, or a cause that cannot act on this setup.
    """
    for _, applied in applied_in_turn(causes, setup):
        setup = applied
    return setup


def applied_in_turn(causes: Sequence[Cause], setup: Setup) -> Iterator[tuple[Cause, Setup]]:
    """What `apply_all` does, step by step.

    Args:
        causes: Effects with their parameters.
        setup: A drape about to be made.

    Yields:
        A cause, and the setup with it and those before.

    Raises:
        SimulationError: As in `apply_all`.
    """
    require_repeatable(causes)
    seeds = {"specimen_seed": setup.specimen_seed, "laying_seed": setup.laying_seed}
    times = [sum(other.effect.name == cause.effect.name for other in causes[:i]) for i, cause in enumerate(causes)]
    waiting = list(zip(causes, times, strict=True))
    while waiting:
        refused: list[tuple[Cause, int]] = []
        why: SimulationError | None = None
        for cause, earlier in waiting:
            own = {name: (*seed, earlier) if earlier else seed for name, seed in seeds.items()}
            try:
                setup = replace(cause.apply(replace(setup, **own)), **seeds) if earlier else cause.apply(setup)
            except SimulationError as error:
                refused.append((cause, earlier))
                why = why or error
            else:
                yield cause, setup
        if why is not None and len(refused) == len(waiting):
            raise why
        waiting = refused
