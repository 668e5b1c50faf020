"""A cloth worn: a pattern cut, draws of the cloth hung on the waist and moved, and the numbers of all that.

The same for one cloth (`cusick-bench garment skirt`) and for several side by side (`cusick-bench garment compare`).
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from cusick_bench.garment.body import Body
from cusick_bench.garment.cloth import Cloth
from cusick_bench.garment.errors import GarmentError
from cusick_bench.garment.fitting import Fitting, hang, walk
from cusick_bench.garment.measurement import SkirtMeasures, measure, spread
from cusick_bench.garment.motion import WaistMotion
from cusick_bench.garment.skirt import KINDS, Skirt, SkirtSize
from cusick_bench.sim.cloth.shape import smooth_field
from cusick_bench.sim.errors import DrapeDiverged

_LAYING_LENGTH = 0.08  # [m] correlation length of the height in which a skirt is put on
_MOST_HEIGHT = 0.1  # [m] largest standard deviation of that height
_SHORTEST_PERIOD = 0.2  # [s] of a motion, ten steps; at a step a period or a half, the waist would stand still
_SHORTEST_MOTION = 0.1  # [s] five steps; it begins and ends at rest, so that in one step the waist would stand still
_CLOTH, _LAYING = 3, 4  # streams of random numbers
_TOGETHER = 64  # skirts that are simulated together; of 2500 vertices each takes 10 MB of memory meanwhile

Progress = Callable[[str, int, int], None]  # told what is done, the steps done, and of how many


@dataclass(frozen=True)
class Wearing:
    """How a cloth is worn.

    Attributes:
        kind: Cut of the skirt, among `KINDS`.
        size: Its measures.
        vertices: Size of the mesh.
        body: What the skirt is worn on, or None.
        motion: How the waist moves once the skirt hangs; None for not at all.
        draws: Skirts, each of its own draw of the cloth.
        laying_height: Standard deviation of the heights in which each skirt is put on [m].
        seed: Seed of pattern, draws and heights.

    Raises:
        GarmentError: No such kind, no draws, a height in which no skirt is put on, or a motion too quick
            or too short for the steps.
    """

    kind: str = "circular"
    size: SkirtSize = field(default_factory=SkirtSize)
    vertices: int = 2500
    body: Body | None = None
    motion: WaistMotion | None = None
    draws: int = 4
    laying_height: float = 0.01
    seed: int = 0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise GarmentError(f"a skirt must be one of {', '.join(KINDS)}, got {self.kind!r}")
        if self.draws < 1:
            raise GarmentError(f"the number of draws must be at least 1, got {self.draws}")
        if not 0 <= self.laying_height <= _MOST_HEIGHT:
            raise GarmentError(f"the laying height must be from 0 to {_MOST_HEIGHT:g} m, got {self.laying_height:g}")
        if self.motion is None:
            return
        for name, value, least, steps in (
            ("period", self.motion.period, _SHORTEST_PERIOD, "ten"),
            ("duration", self.motion.seconds, _SHORTEST_MOTION, "five"),
        ):
            if value < least:
                raise GarmentError(
                    f"the {name} of the waist's motion must be at least {least:g} s, {steps} steps of the simulation, "
                    f"got {value:g} s"
                )


@dataclass(frozen=True, eq=False)
class Worn:
    """Skirts of one cloth, at rest and in motion.

    Attributes:
        cloth: The cloth.
        wearing: How it is worn.
        pattern: The skirt before it falls.
        positions: Where the vertices of each draw come to rest [m].
        resting: Which draws came to rest.
        measures: Measures of each draw at rest.
        times: Times of the frames [s]; none without a motion.
        frames: Positions in each frame [m], of all draws or, where memory is short, of the first ones.
    """

    cloth: Cloth
    wearing: Wearing
    pattern: Skirt
    positions: Float[ndarray, "draws vertices 3"]
    resting: Bool[ndarray, "draws"]
    measures: list[SkirtMeasures]
    times: Float[ndarray, "frames"]
    frames: Float[ndarray, "frames moving vertices 3"]

    def spread(self) -> dict[str, Any]:
        """How much the draws differ at rest, as `measurement.spread` says it."""
        return spread(self.positions, self.measures)

    def document(self) -> dict[str, Any]:
        """The numbers, as `summary.json` holds them."""
        wearing, pattern = self.wearing, self.pattern
        each = [{"draw": i, **asdict(m), "at_rest": bool(self.resting[i])} for i, m in enumerate(self.measures)]
        found: dict[str, Any] = {
            "kind": wearing.kind, "cloth": self.cloth.name, "stiffness_from": self.cloth.source, "law": self.cloth.law,
            "areal_density_kg_m2": self.cloth.density, "vertices": pattern.mesh.vertices,
            "faces": len(pattern.mesh.faces), "size": pattern.measures(),
            "hip_m": 0.0 if wearing.body is None else wearing.body.hip, "seed": wearing.seed,
            "converged": bool(self.resting.all()), "spread": self.spread(), "draws": each,
        }  # fmt: skip
        if wearing.motion is not None:
            found["motion"] = _moved(pattern, wearing.motion, self.times, self.frames)
        return found


def _unwatched(what: str, done: int, total: int) -> None:
    """The progress of skirts that nobody waits for."""


def wear(cloth: Cloth, wearing: Wearing, progress: Progress = _unwatched) -> Worn:
    """Cuts a skirt, hangs draws of a cloth on the waist, and moves it.

    Args:
        cloth: The cloth.
        wearing: How it is worn.
        progress: Told the stage, the steps done and the most that there can be.

    Returns:
        The skirts.

    Raises:
        DrapeDiverged: A skirt flies apart; the cloth is named.
        CusickError: A pattern that cannot be cut or simulated.
    """
    draws, pattern = wearing.draws, KINDS[wearing.kind](wearing.size, wearing.vertices, seed=wearing.seed)
    generator, positions = np.random.default_rng([wearing.seed, _CLOTH]), _laid(pattern, wearing)
    resting, times, frames = np.zeros(draws, bool), np.zeros(0), np.zeros((0, *positions.shape))
    for first in range(0, draws, _TOGETHER):
        pack = slice(first, first + _TOGETHER)
        drawn = cloth.draw(pattern.mesh, len(positions[pack]), generator)
        fitting = Fitting.of(pattern, drawn, law=cloth.law, body=wearing.body)
        which = f" {first + 1} to {first + fitting.members} of {draws}" if draws > _TOGETHER else ""
        try:
            rest, resting[pack] = hang(fitting, positions[pack], progress=_watched(progress, f"hanging{which}"))
            positions[pack] = rest.positions
            if wearing.motion is not None:
                moving = _watched(progress, f"moving the waist{which}")
                times, moved = walk(fitting, rest, wearing.motion, progress=moving)
                frames = _joined(frames, moved, pack)
        except DrapeDiverged as error:
            raise DrapeDiverged(f"{cloth.name}: {error}") from error
    measures = [measure(pattern, x) for x in positions]
    return Worn(cloth, wearing, pattern, positions, resting, measures, times, frames)


def _watched(progress: Progress, what: str) -> Callable[[int, int], None]:
    """Tells a stage's steps under its name."""
    return lambda done, total: progress(what, done, total)


def _joined(frames: ndarray, moved: ndarray, pack: slice) -> ndarray:
    """Frames of all draws with those of a pack in their place; of a single pack, which may be gigabytes, no copy."""
    if moved.shape[1:] == frames.shape[1:]:
        return moved
    frames = frames if len(frames) else np.zeros((len(moved), *frames.shape[1:]))
    frames[:, pack] = moved
    return frames


def _laid(pattern: Skirt, wearing: Wearing) -> Float[ndarray, "draws vertices 3"]:
    """Initial shape of each skirt: its own undulation decides where its folds form."""
    generators = [np.random.default_rng([wearing.seed, draw, _LAYING]) for draw in range(wearing.draws)]
    fields = [smooth_field(wearing.laying_height, _LAYING_LENGTH, generator) for generator in generators]
    return np.stack([pattern.laid(field) for field in fields])


def _moved(pattern: Skirt, motion: WaistMotion, times: ndarray, frames: ndarray) -> dict[str, Any]:
    """Numbers of the motion: how far the hem spreads and how far it trails behind the waist."""
    shifts = np.stack([motion.pose(time)[1] for time in times])
    hem = frames[:, :, pattern.hem] - shifts[:, None, None]
    radius = np.hypot(hem[..., 0], hem[..., 1]).mean(-1)  # (frames, draws)
    trail = np.hypot(*np.moveaxis(hem[..., :2].mean(-2) - hem[:1, ..., :2].mean(-2), -1, 0))
    return {
        **asdict(motion), "frames": len(times), "hem_radius_rest_m": float(radius[0].mean()),
        "hem_radius_max_m": float(radius.max(0).mean()), "hem_radius_max_sd_m": _sd(radius.max(0)),
        "hem_trail_max_m": float(trail.max(0).mean()), "hem_trail_max_sd_m": _sd(trail.max(0)),
    }  # fmt: skip


def _sd(values: ndarray) -> float:
    return float(values.std(ddof=1)) if len(values) > 1 else float("nan")
