"""The targets that the engine is held to, with what was measured."""

import math
from collections.abc import Iterator
from typing import Any

from cusick_bench.benchmark.laws import LAWS, NEAR_ENOUGH
from cusick_bench.benchmark.workload import LOCKSTEP

_SMALLEST_BATCHED = 1000  # vertices of the smallest mesh that the targets of batches and of laws are for


def _law_targets(laws: dict[str, Any]) -> Iterator[tuple[str, float, float]]:
    """A step of the first law against one of the second, on the larger meshes."""
    for mesh in laws["meshes"]:
        if mesh["vertices"] >= _SMALLEST_BATCHED:
            yield f"step, {' / '.join(LAWS)}, {mesh['vertices']} vertices", mesh["ratio"]["median"], 1.6


def _batch_targets(meshes: list[dict[str, Any]]) -> Iterator[tuple[str, float, float]]:
    """Batches in lockstep on the larger meshes, against as many single drops."""
    for mesh in meshes:
        for name, ratio in mesh["ratios"].items():
            if LOCKSTEP in name and mesh["vertices"] >= _SMALLEST_BATCHED:
                yield f"{name}, {mesh['vertices']} vertices", ratio["median"], 0.6


def targets(document: dict[str, Any], mesh: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Every target with what was measured.

    Args:
        document: What `suite.benchmark` has measured.
        mesh: The mesh of `document` that the targets are for.

    Yields:
        For each target its name `target`, what was `measured`, the `limit`, and whether it is `met`; None where nothing
        was measured.
    """
    ratios, cases = document["ratios"], mesh["cases"]
    errors = [row["relative_error"] for row in document["gradient_error"] if not row["branch_changed"]]
    worst = max(errors, default=None)
    upper = [
        ("drop / floor", ratios["drop / floor"], 1.35),
        ("drop+gradient / floor", ratios["drop+gradient / floor"], 2.0),
        ("warm equilibrium gradient (s)", cases["equilibrium, warm, +gradient"]["median_s"], 0.25),
        *_batch_targets(document["meshes"]),
        ("silhouette+gradient (s)", cases["silhouette+gradient"]["median_s"], 0.03),
        ("scaling exponent", document["scaling_exponent"], 1.5),
        ("gradient error", worst, 1e-5),
        *_law_targets(document["laws"]),
        *((f"start-up, law {law} (s)", seconds, 3.0) for law, seconds in document["start_up_s"].items()),
    ]
    lower = [
        ("times faster than plain autograd", ratios["plain autograd / engine, time"], 20.0),
        ("times leaner than plain autograd", ratios["plain autograd / engine, memory"], 10.0),
    ]
    near = document["laws"]["equal_error"]
    if near is not None:
        name = f"times faster at {NEAR_ENOUGH:g} points from the reference, {' than '.join(LAWS)}"
        lower.append((name, near["times_faster"], 5.0))
    for rows, sign in ((upper, 1), (lower, -1)):
        for name, value, limit in rows:
            met = None if value is None or math.isnan(value) else bool(sign * value <= sign * limit)
            bound = f"<= {limit:g}" if sign > 0 else f">= {limit:g}"
            yield {"target": name, "measured": value, "limit": bound, "met": met}
