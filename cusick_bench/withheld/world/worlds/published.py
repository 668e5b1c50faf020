"""The published program: its hinges and quirks, its springs for a plate, on a cloth that stretches little.

Its cloth is laid down in short waves. Drag is low, since the program's own damping is implicit Euler's alone.
"""

from cusick_bench.withheld.world.fabric import Population
from cusick_bench.withheld.world.triangles.cloths import LAWS, TriangleCloths
from cusick_bench.withheld.world.triangles.drop import Stepping
from cusick_bench.withheld.world.triangles.systems import SceneSystems
from cusick_bench.withheld.world.world import Camera, World

_STEPPING = Stepping(step=0.05, drag=0.05)


def _cloths(vertices: int, seed: int) -> TriangleCloths:
    return TriangleCloths(SceneSystems(vertices, seed, "published"), _STEPPING)


WORLD = World(
    name="published",
    what="hinges of law published, plate of springs; laid in short waves; stiff membrane",
    population=Population(
        bending=(2e-3, 2e-2),  # at equal B its hinges bend more easily than a plate; what is limper crumples
        stretch=(200.0, 400.0),
        shear=(25.0, 80.0),
        hardening=(1.0, 1.2),
        bending_growth=(0.8, 1.3),
        stiffness_spread=0.07,
        rest_height=3.5e-4,
        laying_length=(0.008, 0.012),
        laying_height=(3e-4, 5e-4),
        repeat_share=0.03,
        shift=4e-4,
        turn=0.8,
    ),
    cloths=_cloths,
    vertices=1500,
    steps=100,
    camera=Camera(blur=0.45, noise=2.0, quality=88),
    own_laws=LAWS,
)
"""The world."""
