"""Variability of a solver's draws of a cloth, compared with that of its real samples.

A best-of-N score cannot tell whether draws vary as samples of the cloth do: draws that are all alike reach a good one,
and so do draws that vary wildly. Here stand, for every cloth, the pair error, the spread of the drape coefficient and
that of the number of folds, of the held-out samples and of each solver's draws; and for all cloths their means. The
ratio of draws to samples should be 1 within its error, and the mean number of folds that of the samples.
"""

from collections.abc import Callable, Sequence
from math import hypot, nan
from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from cusick_bench.datasets import DrapeDataset
from cusick_bench.leaderboard import Cells
from cusick_bench.leaderboard.text import Column, TextTable, short
from cusick_bench.metrics import to_levels, variability_rows
from cusick_bench.report.figures.predictions import (
    check_data,
    entrants,
    held_out_rows,
    load_draws,
    train_row,
    turned_over,
)

DRAWS = 200  # of a cell that are compared, evenly spaced: the jackknife takes the cube of their number
FEWEST = 3  # drapes that have a spread with an error
SAMPLES, ALL = "samples", "all"
MEASURES = ("pair_mse", "dc_sd", "folds_sd")
FOLDS, FOLDS_OFF = "folds", "folds_off"

Row = dict[str, Any]


def fold_variability(
    cells: Cells, dataset: DrapeDataset, *, draws: int = DRAWS, done: Callable[[], None] = lambda: None
) -> list[Row]:
    """Compares the spread of draws with that of held-out samples.

    Args:
        cells: Cells of the run's folder.
        dataset: The run's data.
        draws: Most draws of a cell to compare.
        done: Called after each cloth.

    Returns:
        A row for each cloth and each set of drapes (`drapes_of` is "samples" or a solver): every measure, its `_error`
        (jackknife standard error), its `_ratio` to that of the samples and the `_ratio_error`; the mean number of
        `folds`, and `folds_off`, by how much it differs from that of the samples, each with its `_error`; then rows for
        the means over the cloths that a solver has draws of (`cloth` is "all"). Oracles, which have seen the samples,
        and whoever offers fewer than three draws, have no row; nor has a cloth with fewer than three held-out samples.

    Raises:
        ReportError: Other data, or a damaged prediction.
    """
    check_data(cells, dataset)
    rows: list[Row] = []
    for cloth in sorted(set(cells.table["cloth"])):
        held_out = held_out_rows(cells, cloth)
        samples = np.stack([to_levels(np.asarray(dataset.image(row))) for row in held_out])
        if len(samples) >= FEWEST:
            drawn = _drawn(cells, dataset, cloth, held_out, draws)
            own, *others = variability_rows({SAMPLES: samples} | drawn, dataset.protocol)
            rows += [{"cloth": cloth} | row | _ratios(row, own) | _folds_off(row, own) for row in (own, *others)]
        done()
    return rows + _means(rows)


def variability_table(rows: Sequence[Row], notes: Sequence[str] = ()) -> TextTable:
    """Sets the means over cloths, then the cloths, in strings.

    Args:
        rows: From `fold_variability`.
        notes: Sentences below the table.

    Returns:
        The table.
    """
    ordered = sorted(rows, key=lambda row: row["cloth"] != ALL)
    heads = {"pair_mse": ("pair MSE", 4, 1.0), "dc_sd": ("DC sd points", 1, 100.0), "folds_sd": ("folds sd", 2, 1.0)}
    columns = [
        Column("cloth", "", "", lambda row: "", left=True),
        Column("drapes of", "", "", lambda row: "", left=True),
    ]
    columns.append(Column("drapes", "", "", lambda row: ""))
    for head, _, _ in heads.values():
        columns += [Column(head, "", "", lambda row: ""), Column("ratio", "", "", lambda row: "")]
    columns += [Column("folds", "", "", lambda row: ""), Column("off by", "", "", lambda row: "")]
    entries = []
    for row in ordered:
        line = [row["cloth"], row["drapes_of"], f"{row['drapes']:.0f}"]
        own = row["drapes_of"] == SAMPLES
        for measure, (_, digits, factor) in heads.items():
            line.append(_with_error(factor * row[measure], factor * row[f"{measure}_error"], digits))
            line.append("" if own else _with_error(row[f"{measure}_ratio"], row[f"{measure}_ratio_error"], 2))
        line.append(_with_error(row[FOLDS], row[f"{FOLDS}_error"], 1))
        line.append("" if own else _with_error(row[FOLDS_OFF], row[f"{FOLDS_OFF}_error"], 1))
        entries.append(tuple(line))
    said = (
        "Differences between drapes of one cloth: mean squared error of a pair of silhouettes, standard deviation of "
        "the drape coefficient and of the number of folds; ± jackknife standard error.",
        "ratio: of draws to held-out samples; 1 where draws vary as samples do. Draws also differ by what the one "
        "training sample leaves unknown of the cloth, which no sample of it does: DC sd above 1 is mostly that.",
        "folds: mean number of folds. off by: how far it is from that of the samples; of all cloths, the mean of these "
        "distances.",
        *notes,
    )
    kinds = tuple("oracle" if row["drapes_of"] == SAMPLES else "solver" for row in ordered)
    return TextTable("variability of draws beside that of samples", tuple(columns), kinds, tuple(entries), said)


def _drawn(
    cells: Cells, dataset: DrapeDataset, cloth: str, held_out: Sequence[int], most: int
) -> dict[str, UInt8[ndarray, "draws size size"]]:
    """Draws of every solver, of all its seeds together, with either face up as often as held-out samples."""
    found: dict[str, ndarray] = {}
    for entrant in entrants(cells):
        if entrant.kind == "oracle":
            continue
        images = []
        for folder in entrant.folders(cloth):
            draws = load_draws(folder)
            images.append(draws.images[draws.evenly(most, turned_over(dataset, train_row(folder), held_out))])
        images = [drawn for drawn in images if len(drawn) >= FEWEST]
        if images:
            found[entrant.label] = np.concatenate(images)
    return found


def _means(rows: Sequence[Row]) -> list[Row]:
    """Means over the cloths; a solver that lacks a cloth stands beside the samples of those that it has."""
    samples = {row["cloth"]: row for row in rows if row["drapes_of"] == SAMPLES}
    means = []
    for name in dict.fromkeys(row["drapes_of"] for row in rows):
        own = [row for row in rows if row["drapes_of"] == name]
        mean, beside = _mean(own), _mean([samples[row["cloth"]] for row in own])
        means.append({"cloth": ALL, "drapes_of": name} | mean | _ratios(mean, beside) | _mean(own, (FOLDS_OFF,)))
    return means


def _mean(rows: Sequence[Row], measures: Sequence[str] = (*MEASURES, FOLDS)) -> Row:
    mean: Row = {"drapes": sum(row["drapes"] for row in rows)}
    for measure in measures:
        mean[measure] = sum(row[measure] for row in rows) / len(rows)
        mean[f"{measure}_error"] = hypot(*(row[f"{measure}_error"] for row in rows)) / len(rows)
    return mean


def _ratios(row: Row, samples: Row) -> Row:
    """Of a set to the samples, errors to first order."""
    found: Row = {}
    for measure in MEASURES:
        own, other = row[measure], samples[measure]
        ratio = own / other if other > 0 else nan
        errors = (row[f"{measure}_error"], ratio * samples[f"{measure}_error"])
        found |= {f"{measure}_ratio": ratio, f"{measure}_ratio_error": hypot(*errors) / other if other > 0 else nan}
    return found


def _folds_off(row: Row, samples: Row) -> Row:
    """Distance of a set's mean number of folds from that of the samples."""
    error = hypot(row[f"{FOLDS}_error"], samples[f"{FOLDS}_error"])
    return {FOLDS_OFF: abs(row[FOLDS] - samples[FOLDS]), f"{FOLDS_OFF}_error": error}


def _with_error(value: float, error: float, digits: int) -> str:
    text = short(value, digits)
    return f"{text} ±{short(error, digits)}" if text and short(error, digits) else text
