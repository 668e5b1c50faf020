"""The whole benchmark: times, ratios, memory, gradients, start-up, against the targets that the engine is held to."""

import math
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cusick_bench.benchmark.device import device_name, drapes_per_second, measure_device
from cusick_bench.benchmark.gradients import GradientCheck
from cusick_bench.benchmark.laws import LAWS, NEAR_ENOUGH, compare_steps, equal_error
from cusick_bench.benchmark.memory import peak_of
from cusick_bench.benchmark.reference import Comparison
from cusick_bench.benchmark.timing import Timing, paired_ratio, time_in_turn
from cusick_bench.benchmark.workload import CASES, FLOOR_SHARE, LOCKSTEP, STEPS, Workload, floor_backends
from cusick_bench.datasets.files.plate_drapes import PlateDrape
from cusick_bench.runner.environment import environment
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.constants import Law
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.torch_engine.engine import torch_device

TARGET_SIZE = 2699
"""Mesh size that the targets are for: the paper's."""

Done = Callable[[str, float], None]
"""Told what was measured, and how much of `work` that was."""

_COMPARED_BATCH = 16
_COMPARED = ("drop", "drop+gradient", f"batch of {_COMPARED_BATCH}{LOCKSTEP}")  # the CPU's fastest ways
_SMALLEST_BATCHED = 1000  # vertices of the smallest mesh that the target of batches is for
_MOST_BATCHED = 200_000  # vertices of a batch; larger ones are left out, they take minutes
_START = "from cusick_bench.cli import main; main()"


@dataclass(frozen=True)
class Plan:
    """What to measure; by default what takes some minutes.

    Attributes:
        vertices: Mesh sizes.
        rounds: Times of each case; large meshes get at most three.
        batches: Members of the batches on the CPU.
        support: `fixed` plate, or `springs` as published.
        law: Material law of all but the comparisons with plain autograd and of laws.
        reference: Reference drapes for the time at equal error; none for no such comparison, which takes minutes.
        reference_vertices: Mesh sizes tried for it.
        reference_steps: Steps of the comparison with plain autograd, which keeps the graph of each.
        gradient_vertices: Mesh size of the gradient check.
        device: Where the torch engine is measured beside the CPU, as `DrapeSimulator` takes it; None for nowhere.
        device_batches: Members of the batches there.
        device_only: Whether to measure nothing but it, and of the CPU what it is compared with.
    """

    vertices: tuple[int, ...] = (297, 1205, 2699)
    rounds: int = 3
    batches: tuple[int, ...] = (16,)
    support: str = "fixed"
    law: Law = "paper"
    reference: tuple[PlateDrape, ...] = ()
    reference_vertices: tuple[int, ...] = (297, 480, 700, 1205, 2699)
    reference_steps: int = 10
    gradient_vertices: int = 1205
    device: str | None = None
    device_batches: tuple[int, ...] = (16, 64, 256, 1000)
    device_only: bool = False

    def __post_init__(self) -> None:
        if self.device is not None and torch_device(self.device) is None:
            raise SimulationError(
                f"the CPU's compiled engine is always measured, and device {self.device!r} is that one; name another"
            )
        if self.device_only and self.device is None:
            raise SimulationError("to measure a device only, name it: --device cuda --device-only")


FULL = {"vertices": (297, 1205, 2699, 7496, 20000), "rounds": 5, "batches": (16, 64)}
"""What the full benchmark measures beyond the quick one, which the defaults of `Plan` are; a quarter of an hour."""

PARTS = ("meshes", "device", "laws", "reference", "gradient_error", "start_up_s")
"""Parts of the document in the order in which they are measured."""

# What a part takes [s] on two quiet cores, roughly: progress is told in these units.
_DROP_SECONDS = 1.5e-4  # of a vertex
_PROCESS_SECONDS = 5.0  # to start a process and to make it ready
_COST = {"drop+gradient": 1.6, "drop+gradient, checkpointed": 2.5, "silhouette+gradient": 0.05}  # of a drop
_GRADIENT_DROPS = 200  # of the check of gradients


def _cost(case: str, vertices: int) -> float:
    """Approximate time of one call of a case [s]."""
    members = case.removeprefix("batch of ").removesuffix("+gradient").removesuffix(LOCKSTEP)
    drops = float(members) if members.isdecimal() else 0.1 if case.startswith("floor:") else _COST.get(case, 1.0)
    return drops * _DROP_SECONDS * vertices


def _mesh_rounds(vertices: int, plan: Plan) -> int:
    return min(plan.rounds, 3) if vertices > 5000 else plan.rounds


def _batches(vertices: int, plan: Plan) -> list[int]:
    return [members for members in plan.batches if members * vertices <= _MOST_BATCHED]


def work(plan: Plan) -> float:
    """Approximate time of a plan on two quiet cores [s]; without the device, whose speed is not known.

    Args:
        plan: What to measure.

    Returns:
        The sum of what `benchmark` tells of.
    """
    if plan.device_only:
        return sum(_cases_cost(_COMPARED, vertices, plan) for vertices in plan.vertices)
    found = 0.0
    for vertices in plan.vertices:
        batches = [f"batch of {members}" for members in _batches(vertices, plan)]
        names = [*(f"floor:{name}" for name in floor_backends()), *CASES, *batches, *batches]
        found += _cases_cost(names, vertices, plan) + _memory_cost(vertices)
    found += _laws_cost(plan) + _reference_cost(plan) + _GRADIENT_DROPS * _DROP_SECONDS * plan.gradient_vertices
    return found + len(LAWS) * _START_SECONDS


_START_SECONDS = 3 * _PROCESS_SECONDS


def _cases_cost(names: Iterable[str], vertices: int, plan: Plan) -> float:
    return (_mesh_rounds(vertices, plan) + 1) * sum(_cost(name, vertices) for name in names)


def _memory_cost(vertices: int) -> float:
    return 2 * _PROCESS_SECONDS + 8 * _DROP_SECONDS * vertices


def _laws_cost(plan: Plan) -> float:
    """Time of the comparison of laws: steps of both, and some three drops of both for each reference drape and mesh."""
    drapes = 3 * len(LAWS) * len(plan.reference) * sum(plan.reference_vertices)
    return _DROP_SECONDS * (2 * len(LAWS) * sum(plan.vertices) + drapes)


def _reference_cost(plan: Plan) -> float:
    autograd = 50 * _DROP_SECONDS * _target(plan) * plan.reference_steps / STEPS
    return 2 * _PROCESS_SECONDS + (min(plan.rounds, 3) + 5) * autograd


def _target(plan: Plan) -> int:
    """Mesh size that the targets are held against."""
    return TARGET_SIZE if TARGET_SIZE in plan.vertices else plan.vertices[-1]


def _timed(cases: dict[str, Callable[[], object]], vertices: int, plan: Plan, done: Done) -> dict[str, Timing]:
    """Times of cases on one mesh, taken in turn."""
    return time_in_turn(
        cases, _mesh_rounds(vertices, plan), lambda name: done(f"{vertices} vertices: {name}", _cost(name, vertices))
    )


def measure_mesh(vertices: int, plan: Plan, done: Done) -> dict[str, Any]:
    """Times and memory on one mesh: `cases`, `phases`, `ratios`, `floor` (the fastest backend), `memory_bytes`.

    Args:
        vertices: Number of vertices of the mesh.
        plan: What to measure.
        done: Told of every case that is timed.

    Returns:
        Times, memory and sizes by name.
    """
    workload = Workload(vertices, plan.support, plan.law)
    rounds, batches = _mesh_rounds(vertices, plan), _batches(vertices, plan)
    cases = _timed(workload.cases(batches), vertices, plan, done)
    for name in [name for name in cases if name.startswith("floor:")]:
        cases[name] = Timing(tuple(FLOOR_SHARE * seconds for seconds in cases[name].seconds))
    phases = time_in_turn(workload.phases(), max(10 * rounds, 20), lambda name: None)
    fastest = min((name for name in cases if name.startswith("floor:")), key=lambda name: cases[name].median)
    ratios = {
        f"{name} / floor": paired_ratio(cases[name], cases[fastest])
        for name in ("drop", "drop+gradient", "drop+gradient, checkpointed")
    }
    for members in batches:
        for name in (f"batch of {members}", f"batch of {members}{LOCKSTEP}"):
            ratios[f"{name} / {members} drops"] = {
                key: value / members for key, value in paired_ratio(cases[name], cases["drop"]).items()
            }
    memory = {
        name: peak_of(_gradient_ready, vertices, plan.support, plan.law, name == "kept")
        for name in ("kept", "checkpointed")
    }
    done(f"{vertices} vertices: memory", _memory_cost(vertices))
    return {
        "vertices": workload.mesh.vertices,
        "floor": fastest.removeprefix("floor:"),
        "cases": {name: timing.summary() for name, timing in cases.items()},
        "phases": {name: timing.summary() for name, timing in phases.items()},
        "ratios": ratios,
        "memory_bytes": memory,
    }


def measure_compared(vertices: int, plan: Plan, done: Done) -> dict[str, Any]:
    """Times on the CPU of what a device is compared with, as in `measure_mesh`.

    Args:
        vertices: Number of vertices of the mesh.
        plan: What to measure.
        done: Told of every case that is timed.

    Returns:
        `vertices` and `cases`.
    """
    workload = Workload(vertices, plan.support, plan.law)
    cases = workload.drapes([_COMPARED_BATCH])
    timed = _timed({name: cases[name] for name in _COMPARED}, vertices, plan, done)
    return {"vertices": workload.mesh.vertices, "cases": {name: timing.summary() for name, timing in timed.items()}}


def measure_beside(
    meshes: list[dict[str, Any]], plan: Plan, done: Done, keep: Callable[[dict[str, Any]], None] = lambda found: None
) -> dict[str, Any]:
    """The plan's device on every mesh, with rates beside those of the CPU (`times_faster`).

    Args:
        meshes: What `measure_mesh` found.
        plan: What to measure.
        done: Told of everything measured.
        keep: Given what is measured so far, after every case.

    Returns:
        Times, ratios and differences by name.
    """
    if plan.device is None:
        return {}
    facts, found = device_name(plan.device), []

    def keep_mesh(mesh: dict[str, Any]) -> None:
        keep(facts | {"meshes": [*found, mesh]})

    for vertices, cpu in zip(plan.vertices, meshes, strict=True):
        mesh = measure_device(
            vertices, plan.device, plan.device_batches, plan.rounds, plan.support, plan.law,
            lambda name: done(name, 0.0), keep_mesh,
        )  # fmt: skip
        rates = {
            name: {"cpu": drapes_per_second(cpu["cases"], suffix), "device": drapes_per_second(mesh["cases"], suffix)}
            for name, suffix in (("forward", ""), ("gradient", "+gradient"))
        }
        faster = {name: rate["device"] / rate["cpu"] for name, rate in rates.items()}
        found.append(mesh | {"drapes_per_second": rates, "times_faster": faster})
    return facts | {"meshes": found}


def _gradient_ready(vertices: int, support: str, law: Law, keep: bool) -> Callable[[], object]:
    """A drop with its gradient, code and mesh ready."""
    workload = Workload(vertices, support, law)
    workload.drop()
    return lambda: workload.drop_gradient(keep=keep)


def gradient_errors(vertices: int, law: Law) -> list[dict[str, Any]]:
    """Directional derivatives of the whole pipeline against central differences, in both modes.

    Args:
        vertices: Number of vertices of the mesh.
        law: Material law.

    Returns:
        A row a mode and parameter, with its relative error.
    """
    rows = []
    for mode in ("drop", "equilibrium"):
        settings = DrapeSettings(law=law, mode=mode, tolerance=1e-12)  # pyright: ignore[reportArgumentType]
        for error in GradientCheck(DrapeSimulator(cloth_mesh(law, vertices), settings)).errors():
            rows.append({"mode": mode, **asdict(error), "relative_error": error.relative_error})
    return rows


def start_up(law: Law) -> float:
    """Wall time of `cusick-bench simulate` on 1205 vertices in a new process, caches warm [s].

    Args:
        law: Material law.

    Returns:
        The shortest of three.
    """
    arguments = ["simulate", "--density", "0.192", "--bending", "1.4e-5", "--vertices", "1205", "--law", law, "--json"]
    taken = []
    for _ in range(3):
        clock = time.perf_counter()
        subprocess.run([sys.executable, "-c", _START, *arguments], check=True, capture_output=True)
        taken.append(time.perf_counter() - clock)
    return min(taken)


def scaling(meshes: list[dict[str, Any]]) -> float | None:
    """Exponent b of drop time ~ vertices^b, by regression over the meshes from 1000 vertices up.

    Args:
        meshes: From `measure_mesh`.

    Returns:
        The exponent; None with fewer than two sizes of such meshes.
    """
    pairs = [(m["vertices"], m["cases"]["drop"]["median_s"]) for m in meshes if m["vertices"] >= 1000]
    if len({size for size, _ in pairs}) < 2:
        return None
    size, seconds = np.log(np.array(pairs)).T
    return float(np.polyfit(size, seconds, 1)[0])


def benchmark(
    plan: Plan,
    done: Done = lambda name, share: None,
    keep: Callable[[dict[str, Any]], None] = lambda document: None,
) -> dict[str, Any]:
    """Runs the benchmark.

    Args:
        plan: What to measure.
        done: Told of everything measured.
        keep: Given the document whenever a mesh or a part of it is measured, as far as it is: `missing` names the parts
            that lack something.

    Returns:
        `hardware`, `plan`, `meshes`, `laws` (steps of laws side by side, and with a reference their times at equal
        error), `reference`, `gradient_error`, `start_up_s` (of each law), `scaling_exponent`, `device` (empty without
        one), `ratios` (those of the target mesh, or of the last), `targets` and `missing`, which is empty. Of a device
        only, `missing` names all but `meshes` and `device`.
    """
    document: dict[str, Any] = {"hardware": environment(), "plan": asdict(plan), "meshes": [], "missing": list(PARTS)}

    def measured(part: str, value: Any) -> None:
        document[part] = value
        document["missing"].remove(part)
        keep(document)

    measure = measure_compared if plan.device_only else measure_mesh
    for vertices in plan.vertices:
        document["meshes"].append(measure(vertices, plan, done))
        keep(document)
    measured("meshes", document["meshes"])
    measured("device", measure_beside(document["meshes"], plan, done, lambda found: keep(document | {"device": found})))
    if plan.device_only:
        return document
    measured("laws", measure_laws(plan, done))
    measured("reference", Comparison(_target(plan), plan.reference_steps).measure(min(plan.rounds, 3)))
    done("plain autograd", _reference_cost(plan))
    measured("gradient_error", gradient_errors(plan.gradient_vertices, plan.law))
    done("gradient check", _GRADIENT_DROPS * _DROP_SECONDS * plan.gradient_vertices)
    measured("start_up_s", {law: start_up(law) for law in LAWS})
    done("start-up", len(LAWS) * _START_SECONDS)
    target = next(mesh for mesh, size in zip(document["meshes"], plan.vertices, strict=True) if size == _target(plan))
    reference = document["reference"]
    document["scaling_exponent"] = scaling(document["meshes"])
    document["ratios"] = {
        **{name: ratio["median"] for name, ratio in target["ratios"].items()},
        "plain autograd / engine, time": reference["times_faster"]["median"],
        "plain autograd / engine, memory": reference["times_leaner"],
    }
    document["targets"] = list(_targets(document, target))
    keep(document)
    return document


def measure_laws(plan: Plan, done: Done) -> dict[str, Any]:
    """Steps of laws side by side on every mesh, and where the plan has a reference their times at equal error.

    Args:
        plan: What to measure.
        done: Told of everything measured.

    Returns:
        `meshes` (see `compare_steps`) and `equal_error` (see there; None without a reference).
    """
    meshes = [compare_steps(vertices, 5 * _mesh_rounds(vertices, plan)) for vertices in plan.vertices]
    done("steps of laws", _laws_cost(plan))
    if not plan.reference:
        return {"meshes": meshes, "equal_error": None}
    near = equal_error(plan.reference, plan.reference_vertices, lambda name: done(f"equal error: {name}", 0.0))
    return {"meshes": meshes, "equal_error": near}


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


def _targets(document: dict[str, Any], mesh: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Every target with what was measured."""
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
