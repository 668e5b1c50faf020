"""A plate of cubic B-splines on a polar grid, on a cloth with a soft membrane and Poisson's ratio.

It is laid down in waves of any length, and falls with steps that grow as it comes to rest.
"""

from cusick_bench.withheld.world.fabric import Population
from cusick_bench.withheld.world.polar.cloths import PolarCloths, intervals
from cusick_bench.withheld.world.polar.history import LAWS
from cusick_bench.withheld.world.world import Camera, World


def _cloths(vertices: int, seed: int) -> PolarCloths:
    return PolarCloths(*intervals(vertices))


WORLD = World(
    name="polar",
    what="cubic B-splines on a polar grid; laid in waves of any length; soft membrane",
    population=Population(
        stretch=(50.0, 150.0),
        shear=(8.0, 40.0),
        hardening=(1.0, 1.0),
        poisson=(0.0, 0.3),
        stiffness_spread=0.12,
        laying_length=(0.010, 0.040),
        laying_in_log=True,
        laying_height=(4e-4, 1.2e-3),
        repeat_share=0.02,
        shift=2.5e-4,
        turn=0.4,
    ),
    cloths=_cloths,
    vertices=576,
    steps=90,
    camera=Camera(blur=0.8, noise=0.8, quality=95),
    own_laws=LAWS,
)
"""The world."""
