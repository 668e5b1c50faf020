"""Calibration on simulated cases without effect: how far the atlas is off, and how much noise there is.

The atlas' discrepancy is that of its own cheap drapes, which is more than other simulators differ from it; and on their
cases the whitened residual may still scatter more than white noise where no effect acts. Two numbers correct that: the
share of the discrepancy under which cases without effect are likeliest, and a factor on the noise such that the
detection test holds its level on them. The level counts as held if the upper confidence bound of the share of detected
cases, at a confidence of one half, does not exceed it. Cases that a diagnosis is scored on must not be used.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import binomtest

from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.inference.findings.detection import ALPHA, detection_p_value
from cusick_bench.diagnosis.inference.sets.fabric_data import fabric_data
from cusick_bench.diagnosis.inference.single_effects.evidence import NONE
from cusick_bench.diagnosis.measure.captures import Captures
from cusick_bench.runner.processes import process_pool

DISCREPANCIES = (0.05, 0.1, 0.2, 0.5, 1.0)  # an atlas is never exact
INFLATIONS = np.round(np.arange(0.9, 1.55, 0.05), 2)
_CONFIDENCE = 0.5  # of the upper bound of the share of detected cases
_LEAST_NULLS = 40  # with fewer cases a single one would decide
_SEED = 29


def calibrate(
    cases: Sequence[tuple[Captures, str]],
    emulator: Emulator,
    before: Calibration | None = None,
    *,
    workers: int = 1,
    step: Callable[[], None] = lambda: None,
) -> Calibration:
    """Calibrates the noise of an atlas.

    Args:
        cases: Silhouettes with the name of what acts there; only those with `none` are used.
        emulator: The atlas as it was fitted.
        before: Calibration from the fit of the atlas; its mismatch of laws is used and kept.
        workers: Number of processes.
        step: Called for every case without effect that was evaluated, in both passes.

    Returns:
        Share of the discrepancy and factor on the noise, with how far laws differ.

    Raises:
        DiagnosisError: Too few cases without effect, or too many of them that no noise explains.
    """
    known = before or Calibration()
    nulls = [captures for captures, truth in cases if truth == NONE]
    if len(nulls) < _LEAST_NULLS:
        raise DiagnosisError(f"calibration needs at least {_LEAST_NULLS} cases without effect, got {len(nulls)}")
    with parallel_map(workers) as over:
        likelihoods = []
        for row in over(partial(log_likelihoods_of, emulator=emulator, known=known), nulls):
            likelihoods.append(row)
            step()
        known = replace(known, discrepancy=DISCREPANCIES[int(np.argmax(np.sum(likelihoods, axis=0)))])
        needed = []
        for rank in over(partial(_least_quiet_place, emulator=emulator, known=known), nulls):
            needed.append(rank)
            step()
    return replace(known, inflation=inflation_at_level(needed), cases=len(nulls))


def looks(truths: Sequence[str]) -> int:
    """Number of evaluations that a calibration makes: two of every case without effect.

    Args:
        truths: Name of what acts in each case.

    Returns:
        Number of calls of the `step` of `calibrate`.
    """
    return 2 * sum(truth == NONE for truth in truths)


@contextmanager
def parallel_map(workers: int) -> Iterator[Callable[..., Iterator[Any]]]:
    """`map`, in this process or over several.

    Args:
        workers: Number of processes.

    Yields:
        A function that is called like `map`, and gives the same results in the same order.
    """
    if workers <= 1:
        yield map
        return
    with process_pool(workers) as pool:
        yield pool.map


def log_likelihoods_of(captures: Captures, emulator: Emulator, known: Calibration) -> list[float]:
    """Log likelihood of a case without effect.

    Args:
        captures: Its silhouettes.
        emulator: The atlas as it was fitted.
        known: How far laws differ.

    Returns:
        At each of `DISCREPANCIES`, but for a constant [nat].
    """
    _, fabric, _ = fabric_data(captures, emulator, replace(known, inflation=1.0))
    atlases = (replace(known, discrepancy=share).applied(fabric.emulator) for share in DISCREPANCIES)
    return [replace(fabric, emulator=atlas).against().log_likelihood for atlas in atlases]


def _least_quiet_place(captures: Captures, emulator: Emulator, known: Calibration) -> int:
    """Index in `INFLATIONS` of the least factor at which a case without effect is not detected, by bisection.

    It is the number of factors where the case is detected at all of them.
    """
    low, high = 0, len(INFLATIONS)
    while low < high:
        middle = (low + high) // 2 if low else 0  # most cases are not detected at the least factor
        if p_value_of(captures, emulator, replace(known, inflation=float(INFLATIONS[middle]))) > ALPHA:
            high = middle
        else:
            low = middle + 1
    return low


def inflation_at_level(needed: Sequence[int]) -> float:
    """The least factor at which, with confidence, no larger share of nulls is detected than the test's level allows.

    Args:
        needed: For each null the place in `INFLATIONS` of the least factor at which it is not detected.

    Returns:
        The factor.

    Raises:
        DiagnosisError: Too many nulls are detected at every factor.
    """
    for place, factor in enumerate(INFLATIONS):
        detected = sum(rank > place for rank in needed)
        test = binomtest(detected, len(needed), alternative="less")
        if test.proportion_ci(_CONFIDENCE, "exact").high <= ALPHA:
            return float(factor)
    left = sum(rank == len(INFLATIONS) for rank in needed)
    raise DiagnosisError(
        f"noise x {INFLATIONS[-1]:g} still leaves {left} of {len(needed)} cases without effect detected, more than "
        f"the level of {ALPHA:g} allows; check that these cases are without effect, or use another atlas"
    )


def p_value_of(captures: Captures, emulator: Emulator, calibration: Calibration) -> float:
    """p-value of the base model.

    Args:
        captures: Silhouettes of a case.
        emulator: The atlas as it was fitted.
        calibration: Share of its discrepancy, factor on the noise, and how far laws differ.

    Returns:
        The p-value.
    """
    _, data, _ = fabric_data(captures, calibration.applied(emulator), calibration)
    return detection_p_value(data.model(data.against()), np.random.default_rng(_SEED))
