"""The true circumstances of one picture: what laws change before the cloth is dropped.

Positions are in the frame of the simulated cloth: warp = +x, z up; a cloth that lies face down is simulated in its
mirror image and turned over about y for the camera. Directions of the laboratory are mirrored on the way in.
"""

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.system import DrapeSystem
from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.world.fields import Field
from cusick_bench.withheld.world.placed_disc import Outline

Vertices = Float[ndarray, "vertices 3"]
Surface = Callable[[Float[ndarray, "points 2"]], Float[ndarray, "points 3"]]
"""From material points to a shape without stress [m]."""

Load = Callable[[DrapeSystem, Float[ndarray, "vertices"], Vertices], Vertices]
"""From system, vertex masses [kg] and positions [m] to forces [N]."""

StartInternalVariables = Callable[[DrapeSystem, Parameters, "Scene"], "InternalVariables"]
"""Internal variables of a material law at the beginning of a drop."""

PositionMap = Callable[[Vertices], Vertices]

EffectParameters = Mapping[str, float]
"""Parameters of an effect, in the package's names and units."""

Law = Callable[["Scene", EffectParameters], "Scene"]
"""What an effect of given parameters changes in a scene."""


class InternalVariables:
    """Internal variables of one cloth during one drop."""

    def advance(
        self, x: Vertices, angle: Float[ndarray, "hinges"], p: Parameters, h: float
    ) -> tuple[Parameters, Vertices | None]:
        """Advances the internal variables by one step.

        Args:
            x: Positions [m].
            angle: Dihedral angles [rad].
            p: Parameters as the laws before this one left them.
            h: Step [s].

        Returns:
            Parameters for the next step, and further forces on the vertices [N], None for no forces.
        """
        raise NotImplementedError

    def carried_over(self, angle: Float[ndarray, "hinges"]) -> Float[ndarray, "hinges"] | None:
        """What outlasts the drop and acts on the sample's next picture.

        Args:
            angle: Dihedral angles at the end of the drop [rad].

        Returns:
            A value for each hinge, or None where the cloth forgets everything.
        """
        return None


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
        loads: Further forces.
        internal_variables: Start of each law with internal variables.
        contact: Thickness within which the cloth keeps off itself [m].
        seen: Maps in the camera's frame, up to where points seem to be in a parallel projection.
        blur: Standard deviation of the picture's blur [px].
        outwards: How far the cut between cloth and background lies outside of the edge [px]; None for a picture in
            shades.
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
    loads: tuple[Load, ...] = ()
    internal_variables: tuple[StartInternalVariables, ...] = ()
    contact: float = 0.0
    seen: tuple[PositionMap, ...] = ()
    blur: float = 0.6
    outwards: float | None = None
    smear: tuple[float, float] = (0.0, 0.0)
    carried_over: Mapping[str, Float[ndarray, "hinges"]] = field(default_factory=dict)

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
