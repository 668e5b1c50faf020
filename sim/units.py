"""Units as they stand behind numbers that somebody reads."""

PURE_NUMBER = "1"
"""Unit of a pure number in tables and documents."""


def shown_unit(unit: str) -> str:
    """A unit as readers see it.

    Args:
        unit: Unit of a table or document: "1" of a pure number, "" where it is not known.

    Returns:
        The unit; empty for a pure number.
    """
    return "" if unit == PURE_NUMBER else unit
