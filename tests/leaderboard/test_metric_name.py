"""Metrics by full name, short name and heading."""

import pytest

from cusick_bench.leaderboard import LeaderboardError
from cusick_bench.leaderboard.metric_name import HEADINGS, metric_called
from cusick_bench.leaderboard.text import COLUMNS

KNOWN = [
    "train_mse", "train_dc", "test_mse", "test_mse_best", "test_hausdorff_m", "test_dc_error", "test_folds_error",
    "test_energy_distance", "test_dc_crps", "test_dc_cover_90", "spent_wall_seconds", "spent_forward_equivalents",
]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "metric"),
    [
        ("test_mse", "test_mse"),
        ("mse", "test_mse"),
        ("MSE", "test_mse"),
        ("test MSE", "test_mse"),
        ("train mse", "train_mse"),
        ("best MSE", "test_mse_best"),
        ("hausdorff", "test_hausdorff_m"),
        ("H", "test_hausdorff_m"),
        ("dc", "train_dc"),  # the only one of that name
        ("DC err", "test_dc_error"),
        ("energy dist.", "test_energy_distance"),
        ("CRPS", "test_dc_crps"),
        ("dc-cover-90", "test_dc_cover_90"),
        ("wall seconds", "spent_wall_seconds"),
        ("time", "spent_wall_seconds"),
    ],
)
def test_is_found_by_what_people_write(text, metric):
    assert metric_called(text, KNOWN) == metric


def test_headings_name_metrics():
    assert set(HEADINGS.values()) <= set(KNOWN)


def test_every_heading_of_a_metric_names_it():
    """`cost` and `cover` were unknown, and so were headings with their units, as Markdown and HTML tables have them."""
    no_metrics = {"#", "solver", "kind", "cells", "random"}
    whole = [f"{column.head} {column.unit}".strip() for column in COLUMNS if column.head not in no_metrics]
    assert {metric_called(text, KNOWN) for text in whole} == set(KNOWN) - {"train_dc"}
    assert metric_called("cost", KNOWN) == "spent_forward_equivalents"
    assert metric_called("cover", KNOWN) == "test_dc_cover_90"


@pytest.mark.parametrize(("text", "near"), [("test_mes", "test_mse"), ("hausdorf", "test_hausdorff_m")])
def test_a_slip_is_answered_with_the_nearest(text, near):
    with pytest.raises(LeaderboardError, match=f"unknown metric {text!r}; did you mean {near!r}"):
        metric_called(text, KNOWN)


def test_nonsense_is_answered_with_all():
    with pytest.raises(LeaderboardError, match="unknown metric 'colour of wool'; known are: train_mse"):
        metric_called("colour of wool", KNOWN)
