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

    data = _data_asked(ctx)
    try:
        silhouettes = scan(folder_of(data)).silhouettes if data else ()
    except (CusickError, OSError):
        return []
    return _beginning(dict.fromkeys(entry.cloth for entry in silhouettes), incomplete)


_DATA_ARGUMENTS = ("data", "name_or_path", "folder")  # arguments that name a data set; that of `verify` names a run


def _data_asked(ctx: Any) -> str | None:
    """Data set that the command line names; while an option lacks its value, arguments are unread in `ctx.args`."""
    arguments = [one.name for one in ctx.command.params if one.param_type_name == "argument"]
    if arguments and arguments[0] in _DATA_ARGUMENTS:
        return ctx.args[0] if ctx.args else ctx.params.get(arguments[0])
    return ctx.params.get("data")


def _beginning(names: Any, incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
