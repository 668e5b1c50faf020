"""Leaderboards: finished cells of a results folder, ranked with intervals, in every form."""

from typing import TYPE_CHECKING

from cusick_bench.lazy import lazy_names

if TYPE_CHECKING:
    from cusick_bench.leaderboard.board import Leaderboard, leaderboards, metric_names
    from cusick_bench.leaderboard.bootstrap import Estimate, difference, estimate, interquartile_mean
    from cusick_bench.leaderboard.cells.loading import Cells, Skipped, load_cells
    from cusick_bench.leaderboard.cells.variants import variants
    from cusick_bench.leaderboard.errors import LeaderboardError
    from cusick_bench.leaderboard.formats import board_table, csv, html_table, latex, markdown, record, terminal
    from cusick_bench.leaderboard.row import Row
    from cusick_bench.leaderboard.stiffness import (
        StiffnessRow,
        cell_records,
        cell_table,
        stiffness_csv,
        stiffness_records,
        stiffness_rows,
        stiffness_rows_csv,
        stiffness_table,
    )
    from cusick_bench.leaderboard.text import COLUMNS, short, significant, text_table

__all__ = [
    "COLUMNS",
    "Cells",
    "Estimate",
    "Leaderboard",
    "LeaderboardError",
    "Row",
    "Skipped",
    "StiffnessRow",
    "board_table",
    "cell_records",
    "cell_table",
    "csv",
    "difference",
    "estimate",
    "html_table",
    "interquartile_mean",
    "latex",
    "leaderboards",
    "load_cells",
    "markdown",
    "metric_names",
    "record",
    "short",
    "significant",
    "stiffness_csv",
    "stiffness_records",
    "stiffness_rows",
    "stiffness_rows_csv",
    "stiffness_table",
    "terminal",
    "text_table",
    "variants",
]

__getattr__ = lazy_names(
    __name__,
    {
        "COLUMNS": "text",
        "Cells": "cells.loading",
        "Estimate": "bootstrap",
        "Leaderboard": "board",
        "LeaderboardError": "errors",
        "Row": "row",
        "Skipped": "cells.loading",
        "StiffnessRow": "stiffness",
        "board_table": "formats",
        "cell_records": "stiffness",
        "cell_table": "stiffness",
        "csv": "formats",
        "difference": "bootstrap",
        "estimate": "bootstrap",
        "html_table": "formats",
        "interquartile_mean": "bootstrap",
        "latex": "formats",
        "leaderboards": "board",
        "load_cells": "cells.loading",
        "markdown": "formats",
        "metric_names": "board",
        "record": "formats",
        "short": "text",
        "significant": "text",
        "stiffness_csv": "stiffness",
        "stiffness_records": "stiffness",
        "stiffness_rows": "stiffness",
        "stiffness_rows_csv": "stiffness",
        "stiffness_table": "stiffness",
        "terminal": "formats",
        "text_table": "text",
        "variants": "cells.variants",
    },
)
