"""Laws side by side: a step of each on one mesh, and the time that each takes to be as near to a reference."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cusick_bench.benchmark.convergence.reference import PlateComparison, compare_with_reference
from cusick_bench.benchmark.timing import paired_ratio, time_in_turn
from cusick_bench.benchmark.workload import Workload
from cusick_bench.datasets.files.plate_drapes import PlateDrape
from cusick_bench.sim.constants import Law
from cusick_bench.sim.engine.dynamics.drop import Stepper, drop, evaluated, too_far

LAWS: tuple[Law, Law] = ("plate", "paper")
"""The laws compared: the time of the first is held against that of the second."""

NEAR_ENOUGH = 0.5
"""Error of the drape coefficient at which the laws' times are compared [points]."""

_LAID = 20  # steps before the one that is timed: the cloth then bends and stretches
_CALLS = 5  # of what is timed, in a row


def step_of(workload: Workload) -> Callable[[], object]:
    """A whole step of a drop, some steps after the cloth was laid down.

    Args:
        workload: Mesh and law.

    Returns:
        What to time.
    """
    simulator, h = workload.dropping, workload.dropping.settings.step_seconds
    laid = simulator.unknowns.configuration(simulator.laid_down()[None])
    p = workload.parameters.batch()
    rollout = drop(workload.dropping.system, p, laid, steps=_LAID, step_seconds=h, record=False)
    before = (np.ascontiguousarray(rollout.positions[-1]), np.ascontiguousarray(rollout.velocities[-1]))
    after = (before[0].copy(), np.zeros_like(before[1]))
    stepper, far = Stepper(simulator.system, p.mass, h), too_far(laid)
    old = stepper.step((0, 1), evaluated(simulator.system, before[0], laid, p), before, after, far, None)

    def run() -> None:
        for _ in range(_CALLS):
            stepper.step((0, 1), evaluated(simulator.system, before[0], laid, p), before, after, far, old)

    return run


def compare_steps(vertices: int, rounds: int) -> dict[str, Any]:
    """Times a step of both laws and its parts in turn.

    Args:
        vertices: Mesh size.
        rounds: Times of each.

    Returns:
        `vertices`, `step` and `phases` of each law [s], `ratio` of the steps, and `factor`: blocks a row of the matrix
        and numbers of its factor.
    """
    workloads = {law: Workload(vertices, law=law) for law in LAWS}
    steps = time_in_turn({law: step_of(one) for law, one in workloads.items()}, rounds, lambda name: None)
    phases = {law: time_in_turn(workload.phases(), rounds, lambda name: None) for law, workload in workloads.items()}
    systems = {law: workload.dropping.system for law, workload in workloads.items()}
    return {
        "vertices": vertices,
        "step": {law: _of_one(timing.summary()) for law, timing in steps.items()},
        "ratio": paired_ratio(*(steps[law] for law in LAWS)),
        "phases": {law: {name: t.summary() for name, t in parts.items()} for law, parts in phases.items()},
        "factor": {
            law: {
                "blocks_a_row": len(system.layout.indices) / len(system.free),
                "bytes": system.linear.factorise(workloads[law].step_system[1]).nbytes,
            }
            for law, system in systems.items()
        },
    }


def _of_one(summary: dict[str, float]) -> dict[str, float]:
    return {name: value / _CALLS if name.endswith("_s") else value for name, value in summary.items()}


def equal_error(
    drapes: Sequence[PlateDrape], sizes: Sequence[int], done: Callable[[str], None] = lambda name: None
) -> dict[str, Any]:
    """Time of each law to come within `NEAR_ENOUGH` of reference drapes.

    Every row is draped on larger and larger meshes until it is near enough. Those that the first law brings there are
    compared; where the second brings one of them there on no mesh, it counts with its time on the largest, and
    `times_faster` is a lower bound.

    Args:
        drapes: The reference.
        sizes: Numbers of vertices to try.
        done: Told of every size that is done.

    Returns:
        For each law its `rows` (`folds`, `ln_bending`, `poisson`, `vertices`, `error_points`, `seconds`, `reached`), in
        the reference's order, and `seconds` of those compared; and `times_faster`, of the first law: None where it
        brings no row near enough.
    """
    document: dict[str, Any] = {"near_enough_points": NEAR_ENOUGH}
    for law in LAWS:
        compare_with_reference(drapes[:1], [min(sizes)], law)  # kernels are loaded, or compiled, before time counts
        left, rows = list(drapes), []
        for size in sorted(set(sizes)):
            tried = compare_with_reference(left, [size], law) if left else []
            if left:
                done(f"law {law}, {size} vertices")
            near = [_is_near(one) for one in tried]
            last = size == max(sizes)
            found = zip(left, tried, near, strict=True)
            rows += [(drapes.index(drape), _row(one, ok)) for drape, one, ok in found if ok or last]
            left = [drape for drape, ok in zip(left, near, strict=True) if not ok]
        document[law] = {"rows": [row for _, row in sorted(rows, key=lambda pair: pair[0])]}
    compared = [row["reached"] for row in document[LAWS[0]]["rows"]]
    for law in LAWS:
        rows = document[law]["rows"]
        document[law]["seconds"] = sum(row["seconds"] or 0.0 for row, ok in zip(rows, compared, strict=True) if ok)
    first, second = (document[law]["seconds"] for law in LAWS)
    document["times_faster"] = second / first if any(compared) else None
    return document


def _is_near(one: PlateComparison) -> bool:
    return one.error_points is not None and abs(one.error_points) <= NEAR_ENOUGH


def _row(one: PlateComparison, reached: bool) -> dict[str, Any]:
    names = ("folds", "ln_bending", "poisson", "vertices", "error_points", "seconds")
    return {name: getattr(one, name) for name in names} | {"reached": reached}
