"""Hinges of law `paper` over dual edges, on a cloth that stretches little and hardens."""

from cusick_bench.withheld.world.fabric import Population
from cusick_bench.withheld.world.triangles.cloths import LAWS, TriangleCloths
from cusick_bench.withheld.world.triangles.drop import Stepping
from cusick_bench.withheld.world.triangles.systems import SceneSystems
from cusick_bench.withheld.world.world import Camera, World

_STEPPING = Stepping(step=0.03, drag=0.4)


def _cloths(vertices: int, seed: int) -> TriangleCloths:
    return TriangleCloths(SceneSystems(vertices, seed, "paper"), _STEPPING)


WORLD = World(
    name="paper",
    what="hinges of law paper over dual edges; laid in waves of middling length; hardening membrane",
    population=Population(),
    cloths=_cloths,
    vertices=1205,
    steps=160,
    camera=Camera(blur=0.6, noise=1.2, quality=93),
    own_laws=LAWS,
)
"""The world."""
