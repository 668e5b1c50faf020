"""A cause as an argument of `--with-effect`, and where what that simulates differs from what was found."""

from collections.abc import Iterable, Iterator

import numpy as np

from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate
from cusick_bench.sim.effects.effect_timing import acts_later, in_lab

_LENGTHS = {"m": 1, "1/m": -1}  # exponents of the cloth's scale, by the unit of a parameter


def _in_lengths_of_cloth(one: Candidate, scale: float) -> dict[str, float]:
    """Parameters of a cause in the laboratory's lengths, for captures in their order."""
    effect, value = one.hypothesis.effect, dict(one.value)
    if acts_later(effect):
        value[effect.severity.name] = abs(value[effect.severity.name])
    for p in effect.parameters:
        value[p.name] *= scale ** _LENGTHS.get(p.unit, 0)
    return value


def with_effect(one: Candidate, scale: float) -> str:
    """Argument of `--with-effect` that adds a cause to simulations of the laboratory's cloth.

    Args:
        one: The cause, in lengths of the atlas' cloth. A negative loss, which stands for captures in reverse order,
            loses its sign: simulations take captures in their order.
        scale: Radius of the laboratory's cloth over that of the atlas' cloth.

    Returns:
        Such as "camera-offset:shift=0.0027,direction=120", in the laboratory's lengths and within the effect's bounds.
    """
    value = _in_lengths_of_cloth(one, scale)
    for p in one.hypothesis.effect.parameters:
        if p.unit in _LENGTHS:
            value[p.name] = float(np.clip(value[p.name], p.low, p.high))
    listed = ",".join(f"{name}={number:.6g}" for name, number in value.items())
    return f"{one.hypothesis.name}:{listed}"


def bound_notes(causes: Iterable[Candidate], scale: float) -> Iterator[str]:
    """A note for each parameter that `with_effect` gives otherwise than it was found.

    Args:
        causes: The causes, in lengths of the atlas' cloth.
        scale: Radius of the laboratory's cloth over that of the atlas' cloth.

    Yields:
        What was found, and what is given instead.
    """
    for one in causes:
        value = _in_lengths_of_cloth(one, scale)
        for p in one.hypothesis.effect.parameters:
            if p.unit in _LENGTHS and not p.low <= value[p.name] <= p.high:
                end = p.low if value[p.name] < p.low else p.high
                yield (
                    f"{one.hypothesis.name}: {p.name} is {value[p.name]:.3g}{p.unit_text} on this cloth, but "
                    f"--with-effect takes {p.low:g} to {p.high:g} only and is given {end:g}, so what it simulates "
                    "differs"
                )


def turns_with_cloth(one: Candidate) -> bool:
    """Whether an effect of plate or camera was found in the frame of the cloth.

    Args:
        one: The cause.

    Returns:
        True if its direction turns over with the cloth.
    """
    return in_lab(one.hypothesis.effect) and one.hypothesis.frame == "cloth"


def turning_notes(causes: Iterable[Candidate], warp_seen_down: float = np.pi) -> Iterator[str]:
    """A note for each cause that `with_effect` simulates at another place of cloth that lies face down.

    Args:
        causes: The causes.
        warp_seen_down: Angle at which the camera sees the warp of a cloth that lies face down [rad]. Simulated cloth is
            turned over about y (pi).

    Yields:
        How to simulate cloth that lies face down.
    """
    warp = round(np.rad2deg(warp_seen_down))
    for one in causes:
        if turns_with_cloth(one):
            yield (
                f"{one.hypothesis.name}: its direction turns over with the cloth in these pictures; --with-effect "
                f"keeps it in the laboratory, so to simulate cloth that lies face down give {warp or 360} minus the "
                "direction"
            )
        elif one.hypothesis.effect.located == "patch" and warp != 180:
            yield (
                f"{one.hypothesis.name}: samples were turned over about x, but --with-effect turns cloth over about y, "
                "so to simulate cloth that lies face down give the direction plus 180"
            )
