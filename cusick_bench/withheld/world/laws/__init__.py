"""True laws that are the same in every world: each effect's own, unlike the one that the package simulates it by.

Each module has a table `LAWS`, from the name of an effect to the law that changes a scene accordingly; parameters have
the package's names and units. Laws with internal variables hang on a world's discretisation and stand beside it.
"""

from cusick_bench.withheld.world.laws import boundary, imaging, material, outside
from cusick_bench.withheld.world.scene import Law

LAWS: dict[str, Law] = material.LAWS | boundary.LAWS | imaging.LAWS
"""Laws of the package's effects, by their names."""

OUTSIDE: dict[str, Law] = outside.LAWS
"""Laws of what is not on the package's list; labels call all of them `unknown`."""
