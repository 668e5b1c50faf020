"""A world: a population of fabrics, a way to drape them, a camera, and the effects that it can simulate."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from jaxtyping import Int
from numpy import ndarray

from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.world.fabric import Fabric, Population, draw_fabric, generator_of
from cusick_bench.withheld.world.laws import LAWS, OUTSIDE
from cusick_bench.withheld.world.scene import Law, Scene, Vertices


@dataclass(frozen=True)
class Drape:
    """A draped cloth in the simulated frame.

    Attributes:
        vertices: Points of its surface [m].
        faces: Vertex indices, counter-clockwise seen from above.
        kept: What each law keeps for the sample's next picture, by name of the law.
    """

    vertices: Vertices
    faces: Int[ndarray, "faces 3"]
    kept: Mapping[str, ndarray]


@runtime_checkable
class Cloths(Protocol):
    """All cloths of a case, which share what is prepared once."""

    def drape(self, fabric: Fabric, scene: Scene, steps: int) -> Drape:
        """Drapes one of them.

        Args:
            fabric: What it is cut from.
            scene: The circumstances.
            steps: Number of time steps.

        Returns:
            The drape.

        Raises:
            DrapeDiverged: The cloth flies apart.
        """
        ...


@dataclass(frozen=True)
class Camera:
    """A camera.

    Attributes:
        blur: Standard deviation of its blur [px].
        noise: Standard deviation of its grey levels, of 255.
        quality: Quality of its JPEG files.
    """

    blur: float
    noise: float
    quality: int


@dataclass(frozen=True, eq=False)
class World:
    """A world.

    Attributes:
        name: Its name.
        what: What it is, in a few words.
        population: Fabrics that live in it.
        cloths: Makes the cloths of a case, from a mesh size and the seed of the mesh.
        vertices: Mesh size where none is asked for.
        steps: Number of time steps of a drop.
        camera: Its camera.
        own_laws: Laws of effects that hang on its discretisation, by name of the effect.
    """

    name: str
    what: str
    population: Population
    cloths: Callable[[int, int], Cloths]
    vertices: int
    steps: int
    camera: Camera
    own_laws: Mapping[str, Law]

    @property
    def laws(self) -> dict[str, Law]:
        """Laws of all effects that it can do, listed ones and others."""
        return LAWS | dict(self.own_laws) | OUTSIDE

    def law(self, name: str) -> Law:
        """Finds a law by the name of its effect.

        Args:
            name: An effect of the package, or one outside of its list.

        Returns:
            The law.

        Raises:
            WithheldError: No such law.
        """
        if name not in self.laws:
            raise WithheldError(f"world {self.name!r} has no law called {name!r}; use {', '.join(self.laws)}")
        return self.laws[name]

    def fabric_of(self, seed: tuple[int, ...], attempt: int = 0) -> Fabric:
        """Fabric of a case.

        Args:
            seed: Seed of the case.
            attempt: Number of the draw: another fabric where the effect could not be seen in those before.

        Returns:
            The fabric.
        """
        return draw_fabric(self.population, generator_of(seed, attempt))
