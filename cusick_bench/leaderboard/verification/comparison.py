"""Comparisons of the numbers that a cell stored with those of its repetition, with tolerances."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import inf, isnan, nan
from typing import Any

import numpy as np
from numpy import ndarray

from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.metrics.found_stiffness import UNITS, FoundStiffness, stiffness_document

REDRAWN = 8  # number of draws of a posterior that are draped again
# What the same numbers may differ by. Buckling amplifies rounding about a thousandfold, and machines round differently.
MATERIAL = 1e-9  # tolerance of the stiffness of elements, relative to the largest one
STATED = 1e-6  # tolerance of the stiffness of the cloth that the result states, relative
SHAPE = 1e-5  # [m] tolerance of a vertex; a pixel is 1.4e-3 m
PIXEL = 0.02  # tolerance of a pixel on the outline: the change by a shift of `SHAPE` in pictures of the release
ROUNDED = 0.51 / 255 + 1e-6  # tolerance of stored draws, which have 255 levels
METRIC, SLACK = 1e-3, 2e-5  # tolerance of a metric, relative, and absolute where it is near 0
METRIC_SAME, SLACK_SAME = 1e-6, 1e-9  # the same for metrics of the stored pictures themselves
_OTHER_TRUTH = (
    "; a finished cell keeps the truth.json that it was compared with: if that file was changed since, run the cell "
    "again into another folder"
)


def pixel_tolerance(protocol: Protocol) -> float:
    """Change of a pixel on the outline by a shift of `SHAPE`; it is larger for smaller pixels.

    Args:
        protocol: Gives the scale.

    Returns:
        Difference of coverage.
    """
    return PIXEL * max(1.0, protocol.px_per_m / RELEASE.px_per_m)


@dataclass(frozen=True)
class Check:
    """One thing that was compared.

    Attributes:
        name: Name of the quantity that is compared.
        difference: By how much stored and repeated differ.
        tolerance: By how much they may.
        detail: Both values, or what is wrong.
    """

    name: str
    difference: float
    tolerance: float
    detail: str = ""

    @property
    def holds(self) -> bool:
        """Whether the two agree within the tolerance; NaN never does."""
        return bool(self.difference <= self.tolerance)


def metric_checks(
    stored: dict[str, Any], again: dict[str, float], *, same_draws: bool, all_known: bool = False
) -> Iterator[Check]:
    """Compares stored metrics with those of a repetition.

    Scores of the stored draws themselves must come out the same but for the arithmetic of another machine.

    Args:
        stored: Metrics of the cell's `result.json`.
        again: Metrics of the repetition.
        same_draws: Whether the stored draws themselves were scored again.
        all_known: Whether both have the same metrics, so that one that only one of them has was taken out or put in;
            such a metric is left out otherwise.

    Returns:
        A comparison a metric.
    """
    for name in sorted(stored.keys() ^ again.keys()) if all_known else ():
        yield Check(name, inf, 0.0, f"{'not measured' if name in stored else 'not stored'}, but the other one has it")
    for name, value in again.items():
        if name not in stored:
            continue
        claimed = nan if stored[name] is None else float(stored[name])
        detail = f"stored {claimed:.6g}, now {value:.6g}"
        if isnan(claimed) or isnan(value):
            yield Check(name, 0.0 if isnan(claimed) and isnan(value) else inf, 0.0, detail)
        else:
            relative, absolute = (
                (METRIC_SAME, SLACK_SAME) if same_draws and name.startswith("test_") else (METRIC, SLACK)
            )
            yield Check(name, abs(claimed - value), relative * abs(value) + absolute, detail)


def stiffness_checks(stored: dict[str, Any], again: FoundStiffness | None) -> Iterator[Check]:
    """Compares the stiffness that a result states with that of its stored parameters.

    Args:
        stored: A cell's `result.json`; one of before stiffness was recorded states none.
        again: The stiffness of the stored parameters, None where there is none.

    Returns:
        A comparison a key, by the largest relative difference of its numbers.
    """
    document = stiffness_document(again)
    for name in sorted(set(UNITS) & set(stored)):
        more = _OTHER_TRUTH if name == "truth_ratio" else ""
        claimed, found = (_numbers(values) for values in (stored[name], document[name]))
        if claimed.keys() != found.keys():
            only = sorted(claimed.keys() ^ found.keys())[0]
            yield Check(name, inf, STATED, f"only one of stored and repeated stiffness has {only}{more}")
        elif found:
            differences = {key: abs(claimed[key] - value) / (abs(value) or 1.0) for key, value in found.items()}
            worst = max(differences, key=lambda key: differences[key])
            detail = f"{worst}: stored {claimed[worst]:.6g}, now {found[worst]:.6g}"
            yield Check(name, differences[worst], STATED, f"{detail}{more}")


def _numbers(document: Any, where: str = "") -> dict[str, float]:
    """All numbers of a nested document, each by where it stands."""
    if isinstance(document, dict | list):
        places = document.items() if isinstance(document, dict) else enumerate(document)
        return {k: v for place, part in places for k, v in _numbers(part, f"{where}/{place}").items()}
    return {} if document is None else {where.removeprefix("/"): float(document)}


def equal(name: str, found: str, claimed: str) -> Check:
    """Compares two texts, such as hashes.

    Args:
        name: Name of the quantity that is compared.
        found: What is there.
        claimed: What is said to be there.

    Returns:
        The comparison, which holds only where they are the same.
    """
    same = found == claimed
    return Check(
        name, 0.0 if same else float("inf"), 0.0, "" if same else f"{found[:60] or 'none'}, not {claimed[:60]}"
    )


def moved(name: str, stored: ndarray, again: ndarray) -> Check:
    """Compares two shapes by the largest shift of a vertex.

    Args:
        name: Name of the quantity that is compared.
        stored: Positions [m].
        again: The same, made again [m].

    Returns:
        The comparison, within `SHAPE`.
    """
    shift = float(np.linalg.norm(stored - again, axis=1).max(initial=0.0)) if stored.shape == again.shape else inf
    return Check(name, shift, SHAPE, f"a vertex moves by {shift:.2g} m")


def largest(name: str, stored: ndarray, again: ndarray, tolerance: float) -> Check:
    """Compares two arrays by their largest difference.

    Args:
        name: Name of the quantity that is compared.
        stored: One of them.
        again: The same, made again.
        tolerance: By how much they may differ.

    Returns:
        The comparison; arrays of other shapes do not agree.
    """
    if np.shape(stored) != np.shape(again):
        return Check(name, inf, tolerance, f"stored {np.shape(stored)}, now {np.shape(again)}")
    worst = float(np.abs(np.asarray(stored, dtype=np.float64) - again).max(initial=0.0))
    return Check(name, worst, tolerance, f"largest difference {worst:.2g}")


def relative(name: str, stored: ndarray, again: ndarray) -> Check:
    """Compares two tables of stiffness by their largest difference, relative to the largest entry.

    Args:
        name: Name of the quantity that is compared.
        stored: One of them.
        again: The same, made again.

    Returns:
        The comparison, within `MATERIAL`.
    """
    check = largest(name, stored, again, MATERIAL)
    size = float(np.abs(again).max(initial=0.0)) or 1.0
    return replace(check, difference=check.difference / size, detail=f"{check.difference / size:.2g} of its largest")
