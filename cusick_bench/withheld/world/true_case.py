"""The truth of one case: natural scenes of a fabric, what the case's effects change in them, and their pictures.

Unlike the model that diagnoses: another discretisation of bending, another membrane, laying and time stepping, Matern
fields instead of Gaussian ones, drag, blur, noise and compression, and another law for every effect (`worlds`, `laws`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from cusick_bench.withheld.world.fabric import Fabric
from cusick_bench.withheld.world.fields import matern_field
from cusick_bench.withheld.world.photograph import photograph, seen_from_above
from cusick_bench.withheld.world.registry import DEFAULT, world_of
from cusick_bench.withheld.world.scene import Scene, Vertices
from cusick_bench.withheld.world.world import Cloths, World

CAPTURES = {1: "up", 2: "up", 3: "down", 4: "down"}
SAMPLES = 12


@dataclass(frozen=True)
class Picture:
    """One capture.

    Attributes:
        sample, capture: Numbers of sample and capture, from 1.
        levels: Grey levels, dark where the cloth is.
        vertices: Where the cloth's points seem to be in a parallel projection [m].
    """

    sample: int
    capture: int
    levels: UInt8[ndarray, "256 256"]
    vertices: Vertices


@dataclass(frozen=True)
class TrueCase:
    """A fabric with its samples and whatever acts on them.

    Attributes:
        seed: Seed of the case.
        causes: Effects and their parameters, in the names and units of the package.
        vertices: Mesh size; by default the world's.
        steps: Number of time steps of every drop; by default the world's.
        attempt: Number of the draw of the fabric.
        world_name: Name of the world that it lies in.
    """

    seed: tuple[int, ...]
    causes: Mapping[str, Mapping[str, float]]
    vertices: int | None = None
    steps: int | None = None
    attempt: int = 0
    world_name: str = DEFAULT

    @cached_property
    def world(self) -> World:
        """The world that it lies in."""
        return world_of(self.world_name)

    @cached_property
    def fabric(self) -> Fabric:
        """The fabric that all samples are cut from."""
        return self.world.fabric_of(self.seed, self.attempt)

    @cached_property
    def _cloths(self) -> Cloths:
        mesh_seed = int(np.random.default_rng([*self.seed, 2]).integers(2**31))
        return self.world.cloths(self.vertices or self.world.vertices, mesh_seed)

    def pictures(self, samples: int = SAMPLES) -> Iterator[Picture]:
        """Simulates all pictures, in order of sample and capture.

        Args:
            samples: Number of samples.

        Yields:
            The pictures.
        """
        for sample in range(1, samples + 1):
            carried_over: dict[str, ndarray] = {}
            for capture in CAPTURES:
                picture, kept = self._picture(replace(self.scene(sample, capture), carried_over=carried_over))
                carried_over |= kept
                yield picture

    def scene(self, sample: int, capture: int) -> Scene:
        """The circumstances of one picture: natural variability, then the causes in order, the cut first.

        Args:
            sample: Number of the sample, from 1.
            capture: Number of the capture, from 1.

        Returns:
            The scene.
        """
        scene = self._natural(sample, capture)
        for name, value in sorted(self.causes.items(), key=lambda cause: cause[0] != "cut-size"):  # a hem follows it
            scene = self.world.law(name)(scene, value)
        return scene

    def _natural(self, sample: int, capture: int) -> Scene:
        spread = self.fabric.variability
        scene = Scene(self.seed, sample, capture, CAPTURES[capture], later=capture % 2 == 0)  # pyright: ignore[reportArgumentType]
        stiff = scene.random("specimen", "stiffness")
        bending, stretch = (matern_field(spread.stiffness, spread.stiffness_length, 1.5, stiff) for _ in range(2))
        rest = matern_field(spread.rest, spread.rest_length, 3.5, scene.random("specimen", "rest shape"))
        laid = matern_field(spread.laying, spread.laying_length, 3.0, scene.random("face", "laying"))
        change = matern_field(spread.repeat, spread.laying_length, 3.0, scene.random("capture", "laying again"))
        scene = replace(scene, blur=self.world.camera.blur, noise=self.world.camera.noise)
        return replace(scene, log_bending=(bending,), log_stretch=(stretch,), rest=(rest,), laid=(laid, change))

    def _picture(self, scene: Scene) -> tuple[Picture, Mapping[str, ndarray]]:
        """One picture, and what laws keep of it for the sample's next one."""
        drape = self._cloths.drape(self.fabric, scene, self.steps or self.world.steps)
        seen = seen_from_above(drape.vertices, scene, self.fabric.variability)
        faces = drape.faces if scene.side == "up" else drape.faces[:, ::-1]
        levels = photograph(seen, np.ascontiguousarray(faces), scene)
        return Picture(scene.sample, scene.capture, levels, seen), drape.kept
