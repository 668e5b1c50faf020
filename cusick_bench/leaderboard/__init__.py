"""Leaderboards: finished cells of a results folder, ranked with intervals, in every form."""

from cusick_bench.leaderboard.board import Leaderboard, Row, leaderboards, metric_names, variants
from cusick_bench.leaderboard.bootstrap import Estimate, difference, estimate, interquartile_mean
from cusick_bench.leaderboard.cells import Cells, Skipped, load_cells
from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.leaderboard.formats import csv, html_table, latex, markdown, record, terminal
from cusick_bench.leaderboard.text import COLUMNS, short, text_table

__all__ = [
    "COLUMNS",
    "Cells",
    "Estimate",
    "Leaderboard",
    "LeaderboardError",
    "Row",
    "Skipped",
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
    "terminal",
    "text_table",
    "variants",
]
