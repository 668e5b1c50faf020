"""The whole benchmark: times, ratios, memory, gradients, start-up, against the targets that the engine is held to."""

import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from cusick_bench.benchmark.device import device_name, drapes_per_second, measure_device
from cusick_bench.benchmark.gradients import GradientCheck
from cusick_bench.benchmark.laws import LAWS, compare_steps, equal_error
from cusick_bench.benchmark.memory import peak_of
from cusick_bench.benchmark.plan import (
    COMPARED,
    COMPARED_BATCH,
    START_SECONDS,
    Plan,
    case_seconds,
    gradient_check_seconds,
    laws_seconds,
    memory_seconds,
    reference_seconds,
)
from cusick_bench.benchmark.reference import Comparison
from cusick_bench.benchmark.targets import targets
from cusick_bench.benchmark.timing import Timing, paired_ratio, time_in_turn
from cusick_bench.benchmark.workload import FLOOR_SHARE, LOCKSTEP, Workload
from cusick_bench.runner.environment import environment
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.constants import Law
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings

Done = Callable[[str, float], None]
"""Told what was measured, and how much of `plan.work` that was."""

PARTS = ("meshes", "device", "laws", "reference", "gradient_error", "start_up_s")
"""Parts of the document in the order in which they are measured."""

_START = "from cusick_bench.cli import main; main()"


def _timed(cases: dict[str, Callable[[], object]], vertices: int, plan: Plan, done: Done) -> dict[str, Timing]:
    """Times of cases on one mesh, taken in turn."""
    return time_in_turn(
        cases, plan.rounds_on(vertices), lambda name: done(f"{vertices} vertices: {name}", case_seconds(name, vertices))
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
    rounds, batches = plan.rounds_on(vertices), plan.batches_on(vertices)
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
    done(f"{vertices} vertices: memory", memory_seconds(vertices))
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
    cases = workload.drapes([COMPARED_BATCH])
    timed = _timed({name: cases[name] for name in COMPARED}, vertices, plan, done)
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
    measured("reference", Comparison(plan.target, plan.reference_steps).measure(min(plan.rounds, 3)))
    done("plain autograd", reference_seconds(plan))
    measured("gradient_error", gradient_errors(plan.gradient_vertices, plan.law))
    done("gradient check", gradient_check_seconds(plan))
    measured("start_up_s", {law: start_up(law) for law in LAWS})
    done("start-up", len(LAWS) * START_SECONDS)
    target = next(mesh for mesh, size in zip(document["meshes"], plan.vertices, strict=True) if size == plan.target)
    reference = document["reference"]
    document["scaling_exponent"] = scaling(document["meshes"])
    document["ratios"] = {
        **{name: ratio["median"] for name, ratio in target["ratios"].items()},
        "plain autograd / engine, time": reference["times_faster"]["median"],
        "plain autograd / engine, memory": reference["times_leaner"],
    }
    document["targets"] = list(targets(document, target))
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
    meshes = [compare_steps(vertices, 5 * plan.rounds_on(vertices)) for vertices in plan.vertices]
    done("steps of laws", laws_seconds(plan))
    if not plan.reference:
        return {"meshes": meshes, "equal_error": None}
    near = equal_error(plan.reference, plan.reference_vertices, lambda name: done(f"equal error: {name}", 0.0))
    return {"meshes": meshes, "equal_error": near}
