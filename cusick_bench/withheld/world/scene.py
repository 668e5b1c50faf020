"""The true circumstances of one picture: what laws change before the cloth is dropped.

Positions are in the frame of the simulated cloth: warp = +x, z up; a cloth that lies face down is simulated in its
mirror image and turned over about y for the camera. Directions of the laboratory are mirrored on the way in.
"""

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.constants import CLOTH_RADIUS, GRAVITY, PLATE_RADIUS
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.world.fields import Field, Outline

Vertices = Float[ndarray, "vertices 3"]
Surface = Callable[[Float[ndarray, "points 2"]], Float[ndarray, "points 3"]]
"""From material points to a shape without stress [m]."""

Acceleration = Callable[[Vertices], Vertices]
"""From positions [m] to accelerations of the cloth there [m/s2]."""

Pressure = Callable[[Float[ndarray, "points 3"]], Float[ndarray, "points"]]
"""From unit normals of the cloth to the pressure along them [Pa]."""

_FADE = 0.012  # [m] beyond the plate's edge over which the laid-down undulation begins

PositionMap = Callable[[Vertices], Vertices]

EffectParameters = Mapping[str, float]
"""Parameters of an effect, in the package's names and units."""

Law = Callable[["Scene", EffectParameters], "Scene"]
"""What an effect of given parameters changes in a scene."""


@dataclass(frozen=True, eq=False)
class Scene:
    """The true circumstances of one picture.

    Attributes:
        seed: Seed of the case.
        sample, capture: Numbers of sample and capture, from 1.
        side: Which face lies up.
        later: Whether an earlier picture of the same face lies before this one.
        log_bending, log_stretch, log_mass: Logarithms of factors over the cloth.
        rest: Heights of the rest shape towards the face [m].
        surfaces: Further rest shapes.
        growth: Logarithms of the rest length, for a cloth that has grown in its plane.
        skew: By how much warp and weft are turned from their nominal directions [deg].
        radius, plate_radius: Radii of cloth and plate [m].
        outlines: Factors on the radius of the cut.
        centre: Centre of the cloth, from the plate's axis [m].
        tilt: Slope of the plate and direction downhill in the simulated frame [deg].
        laid: Height in which the cloth is laid down [m].
        accelerations: Further accelerations.
        pressures: Pressures from outside.
        internal_variables: Start of each law with internal variables, in the form of the world that the scene lies in.
        contact: Thickness within which the cloth keeps off itself [m].
        seen: Maps in the camera's frame, up to where points seem to be in a parallel projection.
        blur: Standard deviation of the picture's blur [px].
        noise: Standard deviation of its grey levels, of 255.
        outwards: How far the cut between cloth and background lies outside of the edge [px]; None for a picture in
            shades.
        blur_of_cut: Standard deviation of the blur that is cut [px]; the cut is seen with `blur`, as every edge is.
        smear: Length and direction of the cloth's way while the picture is taken [px, deg].
        carried_over: What laws with internal variables kept from the sample's earlier pictures, by name of the law.
    """

    seed: tuple[int, ...]
    sample: int
    capture: int
    side: Literal["up", "down"]
    later: bool
    log_bending: tuple[Field, ...] = ()
    log_stretch: tuple[Field, ...] = ()
    log_mass: tuple[Field, ...] = ()
    rest: tuple[Field, ...] = ()
    surfaces: tuple[Surface, ...] = ()
    growth: tuple[Field, ...] = ()
    skew: tuple[float, float] = (0.0, 0.0)
    radius: float = CLOTH_RADIUS
    plate_radius: float = PLATE_RADIUS
    outlines: tuple[Outline, ...] = ()
    centre: tuple[float, float] = (0.0, 0.0)
    tilt: tuple[float, float] = (0.0, 0.0)
    laid: tuple[Field, ...] = ()
    accelerations: tuple[Acceleration, ...] = ()
    pressures: tuple[Pressure, ...] = ()
    internal_variables: tuple[Callable[..., Any], ...] = ()
    contact: float = 0.0
    seen: tuple[PositionMap, ...] = ()
    blur: float = 0.6
    noise: float = 1.2
    outwards: float | None = None
    blur_of_cut: float = 0.0
    smear: tuple[float, float] = (0.0, 0.0)
    carried_over: Mapping[str, ndarray] = field(default_factory=dict)

    def with_added(self, **added: object) -> "Scene":
        """Adds one more item to each of the named tuples.

        Args:
            added: The item, by the name of its tuple.

        Returns:
            The changed scene.
        """
        return replace(self, **{name: (*getattr(self, name), item) for name, item in added.items()})

    @property
    def up(self) -> float:
        """1 face up, -1 face down: sign of a curvature seen from the face."""
        return 1.0 if self.side == "up" else -1.0

    def direction(self, degrees: float) -> Float[ndarray, "2"]:
        """Turns a direction of the laboratory into the simulated frame.

        Args:
            degrees: Angle counter-clockwise from +x [deg].

        Returns:
            Its unit vector.
        """
        x, y = unit_vector(degrees)
        return np.array([self.up * x, y])

    def random(self, level: Literal["case", "specimen", "face", "capture"], purpose: str) -> np.random.Generator:
        """Randomness of a law that is the same for the whole case, or for one sample, face or picture of it.

        Args:
            level: What shares the same random numbers.
            purpose: Name of what is drawn; other purposes get independent numbers.

        Returns:
            A generator at its start.

        Raises:
            WithheldError: No such level.
        """
        levels: dict[str, tuple[int, ...]] = {
            "case": (),
            "specimen": (self.sample,),
            "face": (self.sample, 10 + (self.side == "down")),
            "capture": (self.sample, 20 + self.capture),
        }
        if level not in levels:
            raise WithheldError(f"level must be one of {', '.join(levels)}, got {level!r}")
        return np.random.default_rng([*self.seed, zlib.crc32(purpose.encode()), *levels[level]])


def unit_vector(degrees: float) -> Float[ndarray, "2"]:
    """Horizontal unit vector of a direction.

    Args:
        degrees: Angle counter-clockwise from +x [deg].

    Returns:
        Cosine and sine.
    """
    return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])


def sum_of_fields(fields: tuple[Field, ...], points: Float[ndarray, "points 2"]) -> Float[ndarray, "points"]:
    """Sum of fields at some points.

    Args:
        fields: Fields over the cloth; none give zero.
        points: Material points about the cloth's centre [m].

    Returns:
        The sum at each point.
    """
    values = np.zeros(len(points))
    for field_of in fields:
        values = values + field_of(points)
    return values


def gravity_vector(scene: Scene) -> Float[ndarray, "3"]:
    """Acceleration of gravity in the frame of a plate that may be tilted.

    Args:
        scene: Its tilt.

    Returns:
        The vector [m/s2].
    """
    slope = np.radians(scene.tilt[0])
    return GRAVITY * np.append(np.sin(slope) * unit_vector(scene.tilt[1]), -np.cos(slope))


def laid_height(scene: Scene, points: Float[ndarray, "points 2"]) -> Float[ndarray, "points"]:
    """Height in which the cloth is laid down: flat on the plate, undulating beyond its edge.

    Args:
        scene: How it is laid.
        points: Material points about the plate's axis [m].

    Returns:
        The heights [m].
    """
    beyond = np.clip((np.hypot(*points.T) - scene.plate_radius) / _FADE, 0, 1)
    return sum_of_fields(scene.laid, points - np.array(scene.centre)) * np.sin(0.5 * np.pi * beyond) ** 2
