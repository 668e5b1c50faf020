"""Shell completion of the names of solvers, effects, data sets and cloths; none of it imports the simulator."""

from typing import Any

from cusick_bench.sim.errors import CusickError


def complete_solver(incomplete: str) -> list[str]:
    """Solvers whose names begin as what was typed.

    Args:
        incomplete: What was typed.

    Returns:
        Names.
    """
    from cusick_bench.solvers.registry import solver_names

    return _beginning(solver_names(), incomplete)


def complete_effect(incomplete: str) -> list[str]:
    """Effects whose names begin as what was typed.

    Args:
        incomplete: What was typed.

    Returns:
        Names.
    """
    from cusick_bench.sim.effects.registry import effect_names

    return _beginning(effect_names(), incomplete)


def complete_data(incomplete: str) -> list[str]:
    """Registered data sets and folders whose names begin as what was typed.

    Args:
        incomplete: What was typed.

    Returns:
        Names and folders.
    """
    from glob import escape, glob

    from cusick_bench.datasets.registry import REGISTRY

    return _beginning(REGISTRY, incomplete) + sorted(glob(f"{escape(incomplete)}*/"))


def complete_cloth(ctx: Any, incomplete: str) -> list[str]:
    """Cloths of the command's data set whose names begin as what was typed.

    Args:
        ctx: The command line as far as it is typed.
        incomplete: What was typed.

    Returns:
        Names; none where the data cannot be read.
    """
    from cusick_bench.datasets.files.layout import scan
    from cusick_bench.datasets.registry import folder_of

    data = ctx.params.get("data") or ctx.params.get("name_or_path") or "synthetic"
    try:
        silhouettes = scan(folder_of(data)).silhouettes
    except (CusickError, OSError):
        return []
    return _beginning(dict.fromkeys(entry.cloth for entry in silhouettes), incomplete)


def _beginning(names: Any, incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
