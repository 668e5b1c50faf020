"""Samples of the base model, or of it with a cause, as the statistics that a fabric's captures would have."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.base_model import BaseModel
from cusick_bench.diagnosis.atlas.observation import ANGLES, observe, silhouette, statistics_of
from cusick_bench.diagnosis.inference.single_effects.evidence import Candidate
from cusick_bench.diagnosis.inference.single_effects.hypotheses import Frame
from cusick_bench.sim.effects import Effect
from cusick_bench.sim.effects.effect_timing import acts_later, in_lab
from cusick_bench.sim.setup import Setup, Simulators, drape_setups


@dataclass(frozen=True, eq=False)
class Simulated:
    """Samples of a model.

    Attributes:
        specimens: Statistics of every sample and side (up, down), in the cloth's frame; NaN where a drape failed.
        radii: Profiles of the same drapes as the camera sees them, cloth that lies face down turned about y [m].
    """

    specimens: Float[ndarray, "samples 2 statistics"]
    radii: Float[ndarray, "samples 2 angles"]


def with_cause(
    setup: Setup, effect: Effect, value: dict[str, float], frame: Frame, warp_seen_down: float = np.pi
) -> Setup:
    """A setup with an effect whose direction keeps to a frame other than the effect's own.

    A setup turns the cloth over about y. Cloth that was turned over about x lies like that after half a turn on the
    plate, so relative to it directions of the laboratory are rotated by half a turn.

    Args:
        setup: A drape about to be made.
        effect: What acts.
        value: Its parameters; the direction is that with the face up.
        frame: Frame that the direction keeps to when the cloth is turned over.
        warp_seen_down: Angle at which the camera sees the warp of a cloth that lies face down [rad].

    Returns:
        The setup with the effect.
    """
    name = next((p.name for p in effect.parameters if p.role == "direction"), None)
    if name is not None and in_lab(effect) and setup.side == "down":
        direction = 180.0 - value[name] if frame == "cloth" else value[name] + 180.0 - float(np.rad2deg(warp_seen_down))
        value = value | {name: direction % 360}
    return effect.apply(setup, value)


def simulate(
    theta: Float[ndarray, "parameters"],
    causes: Sequence[Candidate],
    samples: int,
    seed: Sequence[int],
    *,
    drift: float = 0.5,
    model: BaseModel | None = None,
    simulators: Simulators | None = None,
    warp_seen_down: float = np.pi,
) -> Simulated:
    """Drapes samples on both sides.

    Args:
        theta: Base parameters.
        causes: What acts; empty for the base model.
        samples: Number of samples to simulate.
        seed: Same seed, same samples: models are compared under common random numbers.
        drift: Share of later captures in a specimen's mean, where a cause acts on these alone.
        model: The base model.
        simulators: Simulators that are reused from call to call.
        warp_seen_down: Angle at which the camera sees the warp of a cloth that lies face down [rad].

    Returns:
        Their statistics and profiles.
    """
    setups = (model or BaseModel()).samples(theta, samples, seed)
    first = _draped(setups, causes, simulators, warp_seen_down, later=False)
    if not any(acts_later(cause.hypothesis.effect) for cause in causes) or drift == 0:
        return first
    second = _draped(setups, causes, simulators, warp_seen_down, later=True)
    return Simulated((1 - drift) * first.specimens + drift * second.specimens, second.radii)


def _draped(
    setups: list[Setup],
    causes: Sequence[Candidate],
    simulators: Simulators | None,
    warp_seen_down: float,
    *,
    later: bool,
) -> Simulated:
    with_causes = []
    for setup in setups:
        changed = replace(setup, later=later, capture=setup.capture + int(later))
        for cause in causes:
            hypothesis = cause.hypothesis
            changed = with_cause(changed, hypothesis.effect, cause.value, hypothesis.frame, warp_seen_down)
        with_causes.append(changed)
    positions = drape_setups(with_causes, simulators)
    statistics = statistics_of(observe(with_causes, positions))
    radii = np.full((len(with_causes), ANGLES), np.nan)
    for index, where in enumerate(positions):
        if where is not None:
            radii[index] = silhouette(with_causes[index], where)
    return Simulated(statistics.reshape(-1, 2, statistics.shape[1]), radii.reshape(-1, 2, ANGLES))
