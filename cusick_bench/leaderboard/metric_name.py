"""Metrics by the names that people write: `test MSE`, `mse` or a heading of the leaderboard mean `test_mse`."""

import re
from collections.abc import Sequence

from cusick_bench.leaderboard.errors import LeaderboardError
from cusick_bench.sim.errors import did_you_mean

HEADINGS = {
    "test_mse_95": "test_mse",
    "best_mse": "test_mse_best",
    "best_mse_n": "test_mse_best",
    "h": "test_hausdorff_m",
    "h_mm": "test_hausdorff_m",
    "dc_err": "test_dc_error",
    "dc_err_points": "test_dc_error",
    "folds_err": "test_folds_error",
    "energy_dist": "test_energy_distance",
    "energy": "test_energy_distance",
    "crps": "test_dc_crps",
    "crps_points": "test_dc_crps",
    "cover": "test_dc_cover_90",
    "cover_90": "test_dc_cover_90",
    "time": "spent_wall_seconds",
    "time_s": "spent_wall_seconds",
    "seconds": "spent_wall_seconds",
    "cost": "spent_forward_equivalents",
    "cost_drapes": "spent_forward_equivalents",
    "drapes": "spent_forward_equivalents",
}
"""Headings of the leaderboard that are no part of their metric's name."""


GATED = ("train_mse", "test_mse", "test_hausdorff_m")
"""Default metrics of the regression gate; only three, since every further one makes the test less powerful."""
_NUMBER_OF_SAMPLES = "test_samples"
"""Column of `leaderboard --cells` that is named like a metric and is none."""
NO_METRIC = "none (a metric is a column whose name begins with train_ or test_)"
"""What tables of cells share that have no metric in common."""


def is_metric(column: str) -> bool:
    """Whether a column of a table of cells is a metric.

    Args:
        column: Its name.

    Returns:
        True of errors and scores of the training or of the unseen samples, of whatever direction.
    """
    return column.startswith(("train_", "test_")) and column != _NUMBER_OF_SAMPLES


def metric_called(text: str, known: Sequence[str]) -> str:
    """The metric that somebody means.

    A name without `train` or `test` means unseen samples; units may be left out, and spaces are as good as underscores.

    Args:
        text: What was written.
        known: Full names of the metrics that there are.

    Returns:
        A full name.

    Raises:
        LeaderboardError: There is no such metric; the message names the nearest, or all.
    """
    if text in known:
        return text
    wanted = re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")
    forms = [f"{part}{wanted}{unit}" for part in ("", "test_", "train_", "spent_") for unit in ("", "_m")]
    for form in [*forms, HEADINGS.get(wanted, "")]:
        if form in known:
            return form
    hint = did_you_mean(wanted, known) or did_you_mean(f"test_{wanted}", known)
    raise LeaderboardError(f"unknown metric {text!r}; {hint}known are: {', '.join(known) or NO_METRIC}")
