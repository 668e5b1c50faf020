"""True laws: each effect's own, different from the one that the package simulates it by, and some beyond its list.

Each module has a table `LAWS`, from the name of an effect to the law that changes a scene accordingly; parameters have
the package's names and units.
"""

from cusick_bench.withheld.errors import WithheldError
from cusick_bench.withheld.world.laws import boundary, contact, history, imaging, material, outside
from cusick_bench.withheld.world.scene import Law

LAWS: dict[str, Law] = material.LAWS | history.LAWS | boundary.LAWS | contact.LAWS | imaging.LAWS
"""Laws of the package's effects, by their names."""

OUTSIDE: dict[str, Law] = outside.LAWS
"""Laws of what is not on the package's list; labels call all of them `unknown`."""


def law(name: str) -> Law:
    """Finds a law by the name of its effect.

    Args:
        name: An effect of the package, or one outside of its list.

    Returns:
        The law.

    Raises:
        WithheldError: No such law.
    """
    found = LAWS.get(name) or OUTSIDE.get(name)
    if found is None:
        raise WithheldError(f"no law of the true world is called {name!r}; use {', '.join((*LAWS, *OUTSIDE))}")
    return found
