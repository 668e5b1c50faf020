"""Evaluations that are paid for and kept: from the journal as far as it goes, and computed together from there on."""

import hashlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from cusick_bench.problem.metering.budget import COST, Evaluation, Meter
from cusick_bench.problem.metering.journal import Entry, Journal


@dataclass(frozen=True)
class Simulated:
    """A drape and what to keep of it.

    Attributes:
        loss: Against the training image; inf where the drape fails.
        failure: Why it fails; "" where it does not.
        arrays: `vertices` (V, 3) [m], and `gradient` where one was asked for.
        seconds: Simulated time of a fall [s]; 0 of an equilibrium.
        jumped: Whether it has left the branch that was followed.
    """

    loss: float = math.inf
    failure: str = ""
    arrays: dict[str, np.ndarray] = field(default_factory=dict)
    seconds: float = 0.0
    jumped: bool = False


def digest_of(tau: Float[np.ndarray, " dimension"]) -> str:
    """Fingerprint of a parameter vector.

    Args:
        tau: The vector.

    Returns:
        16 hexadecimal digits.
    """
    return hashlib.sha256(tau.tobytes()).hexdigest()[:16]


Evaluate = Callable[[Float[np.ndarray, "members dimension"]], list[Simulated]]


def metered(
    kind: str,
    taus: Float[np.ndarray, "members dimension"],
    evaluate: Evaluate,
    meter: Meter,
    journal: Journal,
    *,
    keeps_vertices: Callable[[float], bool],
    all_at_once: bool = False,
) -> list[Entry]:
    """Evaluates vectors, as far as an earlier run has not done so.

    Args:
        kind: Kind of the evaluations (see `Meter.admit`).
        taus: Parameter vectors.
        evaluate: Drapes some of them together.
        meter: Who pays.
        journal: What an earlier run has kept, and where new evaluations are kept.
        keeps_vertices: Whether vertices of a drape of such a loss are kept.
        all_at_once: Whether `evaluate` has to see all vectors, also those that the journal has.

    Returns:
        An entry a vector.

    Raises:
        BudgetExceeded: The budget does not allow for so many evaluations.
    """
    digests = [digest_of(tau) for tau in taus]
    meter.admit(kind, len(taus), replayed=journal.repeats(kind, digests) > 0 if journal.replaying else None)
    entries: list[Entry] = []
    while len(entries) < len(taus) and (entry := journal.next(kind, digests[len(entries)])) is not None:
        meter.replay(entry.evaluation)
        entries.append(entry)
    if rest := digests[len(entries) :]:
        start, before = time.perf_counter(), meter.wall_seconds
        chosen = taus if all_at_once else taus[len(entries) :]
        results = evaluate(chosen)[-len(rest) :]
        seconds = (time.perf_counter() - start) / len(chosen)
        for entry in _entries(kind, rest, results, meter, before, seconds):
            if not keeps_vertices(entry.evaluation.loss):
                entry.arrays.pop("vertices", None)
            journal.append(entry)
            meter.record(entry.evaluation)
            entries.append(entry)
    return entries


def _entries(
    kind: str, digests: list[str], results: list[Simulated], meter: Meter, before: float, seconds: float
) -> list[Entry]:
    """Entries with the totals run on over them."""
    best, spent, entries = meter.best_loss, meter.forward_equivalents, []
    for number, (digest, result) in enumerate(zip(digests, results, strict=True), 1):
        best, spent = best if kind == "draw" else min(best, result.loss), spent + COST[kind]
        evaluation = Evaluation(
            kind=kind,
            digest=digest,
            loss=result.loss,
            best_loss=best,
            forward_equivalents=spent,
            wall_seconds=before + number * seconds,
            seconds=seconds,
            simulated_seconds=result.seconds,
            failure=result.failure,
            jumped=result.jumped,
        )
        entries.append(Entry(evaluation, result.arrays))
    return entries
