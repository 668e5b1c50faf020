"""Sheets of many small axes side by side: their blocks, headings and size."""

from collections.abc import Sequence
from typing import Any, TypeVar

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy import ndarray

COLUMNS = 5  # of methods beside the real drapes; a page has room for no more

T = TypeVar("T")


def in_blocks(items: Sequence[T], most: int = COLUMNS) -> list[list[T]]:
    """Items in as few blocks as can be, of nearly equal length: what stands side by side.

    Args:
        items: The items.
        most: Most items of a block.

    Returns:
        The blocks; a single empty one without items.
    """
    count = max(1, -(-len(items) // most))
    return [list(items[len(items) * i // count : len(items) * (i + 1) // count]) for i in range(count)]


def heading(label: str) -> str:
    """A solver's label with a line for each of its options.

    Args:
        label: The label.

    Returns:
        The same with line breaks.
    """
    return label.replace(",", "\n").replace(" (", "\n(")


def empty_sheet(width: float, height: float, rows: int, columns: int, **grid: Any) -> tuple[Figure, ndarray]:
    """A sheet of axes that are not shown yet.

    Args:
        width: Width of the sheet [inch].
        height: Height of the sheet [inch].
        rows: Number of rows of axes.
        columns: Number of columns of axes.
        grid: Further options of `Figure.subplots`.

    Returns:
        The figure, and its axes (rows, columns).
    """
    figure = Figure(figsize=(width, height), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False, **grid)
    for axis in axes.ravel():
        axis.set_axis_off()
    return figure, axes
