"""How cells and versions are written in a line; reading results does not wait for the simulator."""

from collections.abc import Mapping, Sequence


def labelled(solver: str, causes: Sequence[str]) -> str:
    """A solver's name with the causes that its simulator knows of.

    Args:
        solver: Registered name, with options.
        causes: Causes, as `plate-tilt:angle=2`.

    Returns:
        Text such as `homo + plate-tilt:angle=2`.
    """
    return " + ".join([solver, *causes])


def numerics_text(versions: Mapping[str, int]) -> str:
    """Versions in a line.

    Args:
        versions: Version of each part, by name.

    Returns:
        Text such as `engine 1, law paper 1, metrics 1`.
    """
    return ", ".join(f"{part} {version}" for part, version in versions.items())
