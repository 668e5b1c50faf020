"""The printable sheet: the board at true scale, a circle to cut along, and a ruler to check the printer with."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cusick_bench.photographs.board import COLUMNS, HEIGHT, ROWS, WIDTH, board_cells

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAPERS = {"a4": (210.0, 297.0), "letter": (215.9, 279.4)}  # [mm]
RULER = 150.0  # [mm]
_CELL = 8  # pixels of a square: every cell of a marker has one
_ABOVE = 12.0  # [mm] between the sheet's upper edge and the board
_INCH = 25.4  # [mm]


def write_sheet(path: Path, paper: str, plate_radius: float) -> None:
    """Writes the board as a PDF of one page, in lines and not in pixels.

    Args:
        path: File to write.
        paper: One of `PAPERS`.
        plate_radius: Radius of the circle to cut along [m].
    """
    from matplotlib.backends.backend_pdf import FigureCanvasPdf
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, Rectangle

    width, height = PAPERS[paper]
    figure = Figure(figsize=(width / _INCH, height / _INCH))
    FigureCanvasPdf(figure)
    page = figure.add_axes((0, 0, 1, 1))
    page.set_xlim(0, width)
    page.set_ylim(0, height)
    page.axis("off")
    left, top = (width - 1e3 * WIDTH) / 2, height - _ABOVE
    cells = board_cells(_CELL)
    side = 1e3 * WIDTH / (COLUMNS * _CELL)  # [mm]
    assert cells.shape == (ROWS * _CELL, COLUMNS * _CELL)
    for row, line in enumerate(cells < 128):
        change = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(int), [0]])))
        for start, end in zip(change[::2], change[1::2], strict=True):
            place = (left + start * side, top - (row + 1) * side)
            page.add_patch(
                Rectangle(place, (end - start) * side, side, facecolor="black", edgecolor="none", snap=False)
            )
    middle = (width / 2, top - 1e3 * HEIGHT / 2)
    page.add_patch(Circle(middle, 1e3 * plate_radius, fill=False, edgecolor="#c00000", linewidth=0.4))
    for x, y in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        end = [middle[axis] + 1e3 * plate_radius * (x, y)[axis] for axis in (0, 1)]
        page.plot([end[0], end[0] + 4 * x], [end[1], end[1] + 4 * y], color="#c00000", linewidth=0.4)
    _ruler(page, (width - RULER) / 2, top - 1e3 * HEIGHT - 12)
    page.text(
        width / 2,
        top - 1e3 * HEIGHT - 23,
        f"cusick-bench board, squares of 20 mm. Print at 100 %, no scaling. The ruler must be {RULER:.0f} mm long;\n"
        "if it is not, give its length with --printed-ruler. For the picture on the plate, cut along the red circle\n"
        f"({2e3 * plate_radius:.0f} mm) and lay the disc on the plate edge to edge, this text towards you.",
        ha="center",
        va="top",
        fontsize=8,
        linespacing=1.4,
    )
    figure.savefig(path, format="pdf", metadata={"Title": "cusick-bench board", "CreationDate": None})


def _ruler(page: "Axes", left: float, y: float) -> None:
    """Draws a ruler with a tick every millimetre."""
    page.plot([left, left + RULER], [y, y], color="black", linewidth=0.5)
    for millimetre in range(round(RULER) + 1):
        tick = 5 if millimetre % 10 == 0 else 3.5 if millimetre % 5 == 0 else 2
        page.plot([left + millimetre] * 2, [y, y + tick], color="black", linewidth=0.25)
        if millimetre % 10 == 0:
            page.text(left + millimetre, y - 1, str(millimetre), ha="center", va="top", fontsize=6)
