"""Hypotheses on what has shifted a fabric's features: every effect, with severities, directions and places on a grid.

A `Hypothesis` is an effect and the frame to which its direction belongs. At the base parameters of a fabric it gives a
table of shifts of the features, with a row for each value of its parameters. Severities are log-uniform from a
twentieth of the typical one to ten times it, with either sign where the sign has a meaning; directions are uniform;
patches lie anywhere on the hanging part. Effects that act with time have a sign too: it is negative where the captures
were taken, or numbered, in reverse order.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Final, Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.response import scaled_place
from cusick_bench.diagnosis.inference.residuals.feature_rows import MAY_BE_WRONG, in_rows
from cusick_bench.diagnosis.measure.features import ORDERS, SPREADS
from cusick_bench.diagnosis.measure.own_outlines import UNDONE, OwnOutlines
from cusick_bench.diagnosis.measure.statistics import NAMES, rotated
from cusick_bench.sim.effects import Effect, registered
from cusick_bench.sim.effects.effect_timing import acts_later, in_lab

Frame = Literal["", "cloth", "lab"]
GRAIN = "grain-skew"
"""The effect that needs no drapes: its statistics are those of the base model, rotated."""
DIRECTIONS = 24
RINGS = (0.0975, 0.1125, 0.1275, 0.1425)
"""Middle radii of four rings of the hanging part [m]."""
_SIZES = (0.015, 0.025)  # [m]
_SEVERITIES = np.geomspace(1 / 20, 10, 14)  # in typical ones; beyond the atlas' 6 shifts are extrapolated
SEVERITY_STEP: Final = float(_SEVERITIES[1] / _SEVERITIES[0])
"""Ratio of neighbouring severities."""
_COUNT = len(NAMES)
_OTHER_FRAME = 0.2  # prior probability that the direction of a laboratory's effect belongs to the cloth


@dataclass(frozen=True)
class Hypothesis:
    """An effect and the frame that its direction keeps to.

    Attributes:
        effect: The effect.
        frame: Frame that its direction keeps to; "" if it has none.
        prior: Share of the effect's prior.
    """

    effect: Effect
    frame: Frame
    prior: float

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @cached_property
    def values(self) -> dict[str, Float[ndarray, "rows"]]:
        """The grid, by parameter."""
        axes = []
        for p in self.effect.parameters:
            if p.role == "severity":
                backwards = acts_later(self.effect)
                signs = (1.0, -1.0) if self.effect.signed or backwards else (1.0,)
                size = [s for s in p.typical * _SEVERITIES if s <= p.high] or [p.high]
                axes.append([sign * s for sign in signs for s in size if backwards or p.low <= sign * s])
            elif p.role == "direction":
                axes.append(np.arange(DIRECTIONS) * self.turn / DIRECTIONS)
            elif p.role == "radius":
                axes.append(RINGS)
            else:
                axes.append(_SIZES if self.effect.located == "patch" else (p.default,))
        table = np.array(list(product(*axes)), dtype=np.float64)
        return {p.name: table[:, i] for i, p in enumerate(self.effect.parameters)}

    @property
    def turn(self) -> float:
        """Turn after which a direction is the same [deg]: 180 for a curvature, which has an axis but no sense."""
        return 180.0 if self.effect.located == "direction" and self.effect.signed else 360.0

    def severity(self) -> Float[ndarray, "rows"]:
        """Severities of the grid, in typical ones."""
        return self.values[self.effect.severity.name] / self.effect.severity.typical

    def direction(self) -> Float[ndarray, "rows"] | None:
        """Directions of the grid [rad], or None."""
        name = next((p.name for p in self.effect.parameters if p.role == "direction"), None)
        return None if name is None else np.deg2rad(self.values[name])


def hypotheses(emulator: Emulator) -> list[Hypothesis]:
    """All hypotheses: effects in the atlas, and the turn of the grain.

    Args:
        emulator: The atlas.

    Returns:
        Effects with their frames; one that acts in the laboratory's frame may also keep to the cloth's.
    """
    listed = []
    for name, effect in registered().items():
        if name not in emulator.responses and name != GRAIN:
            continue
        if effect.located == "direction":
            expected: Frame = "lab" if in_lab(effect) else "cloth"
            listed.append(Hypothesis(effect, expected, 1 - _OTHER_FRAME if expected == "lab" else 1.0))
            if expected == "lab":
                listed.append(Hypothesis(effect, "cloth", _OTHER_FRAME))
        else:
            listed.append(Hypothesis(effect, "cloth" if effect.located == "patch" else "", 1.0))
    return listed


@dataclass(frozen=True, eq=False)
class Shifts:
    """How much the features shift, at every value of a grid.

    Attributes:
        features: Shift of every feature, in the rows of `feature_rows` [sd].
        variance: Mean variance of the shifts of the means, from the atlas' finite number of points [sd2].
    """

    features: Float[ndarray, "values rows"]
    variance: Float[ndarray, "values"]


def shifts(
    emulator: Emulator,
    hypothesis: Hypothesis,
    theta: Float[ndarray, "parameters"],
    sd: Float[ndarray, "statistics"],
    drift: float,
    values: Mapping[str, ndarray] | None = None,
) -> Shifts:
    """Shifts of the features by one effect.

    Args:
        emulator: The atlas.
        hypothesis: The effect and its frame.
        theta: Base parameters.
        sd: Unit of the rows [each statistic's unit].
        drift: Share of each face's captures that are later ones.
        values: Parameters by name, all of one length; by default the hypothesis' grid.

    Returns:
        Shifts at every value.
    """
    given = hypothesis.values if values is None else values
    effect = hypothesis.effect
    severity = np.asarray(given[effect.severity.name], dtype=np.float64) / effect.severity.typical
    if hypothesis.name == GRAIN:
        mean = emulator.mean(theta)
        turned = rotated(np.tile(mean, (len(severity), 1)), np.deg2rad(severity * effect.severity.typical)) - mean
        spreads, orders = np.zeros((len(severity), len(SPREADS))), np.zeros((len(severity), len(ORDERS)))
        turned = turned / sd
        return Shifts(in_rows(turned, turned, spreads, orders), np.zeros(len(severity)))
    if emulator.outlines is not None and hypothesis.name in UNDONE:
        return _undone(emulator.outlines, hypothesis, given, sd)
    response = emulator.responses[hypothesis.name]
    backwards = (severity < 0) & response.later
    severity = np.where(backwards, -severity, severity)
    at = np.tile(theta, (len(severity), 1))
    place = scaled_place(effect, given)
    scatter = emulator.sd(theta)
    faces, variance = [], np.zeros(len(severity))
    for face in (0, 1):
        signed = -severity if face and effect.face_odd else severity
        moved, doubt = response.shift(at, signed, place)
        moved = moved * scatter
        variance += doubt.mean(1) / 2
        angle = _angle(emulator.warp_seen_down, hypothesis, given, face)
        faces.append((moved if angle is None else rotated(moved, angle)) / sd)
    spreads = response.spreads(at, severity)
    orders = np.zeros((len(severity), len(ORDERS)))
    if response.later:
        orders = (faces[0] + faces[1])[:, list(ORDERS)] / 2 if drift > 0 else orders
        orders[backwards] *= -1
        # Share of the captures on which the effect has acted: all but one of a drape, whichever way they are numbered;
        # a picture that is the only one may show it where the sign is negative.
        share = np.where(backwards, max(drift, 1 - drift), drift)[:, None]
        faces, spreads = [face * share for face in faces], spreads * share
    up, down = faces
    return Shifts(in_rows(up, down, spreads, orders), variance)


def _undone(outlines: OwnOutlines, hypothesis: Hypothesis, given: Mapping[str, ndarray], sd: ndarray) -> Shifts:
    """Shifts computed by undoing the effect on the fabric's own outlines.

    An effect without a direction moves no row that symmetry forbids. Undoing it on outlines that differ at random makes
    their differences larger or smaller in all rows; in these it would be rewarded for making noise smaller.
    """
    severity = np.asarray(given[hypothesis.effect.severity.name], dtype=np.float64)
    warp = outlines.captures.warp_seen_down
    in_cloth = _angle(warp, hypothesis, given, 0), _angle(warp, hypothesis, given, 1)
    direction = None
    if in_cloth[0] is not None and in_cloth[1] is not None:
        seen_down = warp - in_cloth[1]  # the camera sees the other face mirrored
        direction = np.stack([in_cloth[0], seen_down])
    found = outlines.change(hypothesis.name, severity, direction)
    means = (found.contrast / sd).reshape(len(severity), -1)
    orders = np.zeros((len(severity), len(ORDERS)))
    features = np.concatenate([means, found.spread, orders], axis=1)
    if direction is None:  # as symmetric as the cloth: what is undone in the other rows is their noise
        features[:, ~MAY_BE_WRONG] = 0.0
    return Shifts(features, np.zeros(len(severity)))


def _angle(warp_seen_down: float, hypothesis: Hypothesis, values: Mapping[str, ndarray], face: int) -> ndarray | None:
    """Direction of the effect in the cloth's frame [rad]."""
    name = next((p.name for p in hypothesis.effect.parameters if p.role == "direction"), None)
    if name is None:
        return None
    angle = np.deg2rad(np.asarray(values[name], dtype=np.float64))
    if not face or hypothesis.frame != "lab":
        return angle
    return warp_seen_down - angle
