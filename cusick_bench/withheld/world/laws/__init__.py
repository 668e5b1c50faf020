"""True laws that are the same in every world; each differs from the law by which the package simulates that effect.

Each module has a table `LAWS`, from the name of an effect to the law that changes a scene accordingly; parameters have
the package's names and units. Laws with internal variables depend on the discretisation, and are defined by the worlds.
"""

from cusick_bench.withheld.world.laws import boundary, imaging, material, outside
from cusick_bench.withheld.world.scene import Law

LAWS: dict[str, Law] = material.LAWS | boundary.LAWS | imaging.LAWS
"""Laws of the package's effects, by their names."""

OUTSIDE: dict[str, Law] = outside.LAWS
"""Laws of effects that are not on the package's list; labels call all of them `unknown`."""
