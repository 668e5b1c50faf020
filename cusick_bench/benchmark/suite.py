"""The whole benchmark: times, ratios, memory, gradients, start-up, against the targets that the engine is held to."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cusick_bench.benchmark.device import device_name, drapes_per_second, measure_device
from cusick_bench.benchmark.gradients import GradientCheck
from cusick_bench.benchmark.memory import peak_of
from cusick_bench.benchmark.reference import Comparison
from cusick_bench.benchmark.timing import Timing, paired_ratio, time_in_turn
from cusick_bench.benchmark.workload import FLOOR_SHARE, Workload
from cusick_bench.runner.environment import environment
from cusick_bench.sim.cloth.mesh import disc_mesh
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.torch_engine.engine import torch_device

TARGET_SIZE = 2699
"""Mesh size that the targets are for: the paper's."""

_MOST_BATCHED = 200_000  # vertices of a batch; larger ones are left out, they take minutes
_START = "from cusick_bench.cli import main; main()"


@dataclass(frozen=True)
class Plan:
    """What to measure.

    Attributes:
        vertices: Mesh sizes.
        rounds: Times of each case; large meshes get at most three.
        batches: Members of the batches on the CPU.
        support: `fixed` plate, or `springs` as published.
        reference_steps: Steps of the comparison with plain autograd, which keeps the graph of each.
        gradient_vertices: Mesh size of the gradient check.
        device: Where the torch engine is measured beside the CPU, as `DrapeSimulator` takes it; None for nowhere.
        device_batches: Members of the batches there.
    """

    vertices: tuple[int, ...] = (297, 1205, 2699, 7496, 20000)
    rounds: int = 5
    batches: tuple[int, ...] = (16, 64)
    support: str = "fixed"
    reference_steps: int = 10
    gradient_vertices: int = 1205
    device: str | None = None
    device_batches: tuple[int, ...] = (16, 64, 256, 1000)

    def __post_init__(self) -> None:
        if self.device is not None and torch_device(self.device) is None:
            raise SimulationError(
                f"the CPU's compiled engine is always measured, and device {self.device!r} is that one; name another"
            )


def measure_mesh(vertices: int, plan: Plan, done: Callable[[str], None]) -> dict[str, Any]:
    """Times and memory on one mesh: `cases`, `phases`, `ratios`, `floor` (the fastest backend), `memory_bytes`.

    Args:
        vertices: Number of vertices of the mesh.
        plan: What to measure.
        done: Called to tell of every finished case.

    Returns:
        Times, memory and sizes by name.
    """
    workload = Workload(vertices, plan.support)
    rounds = min(plan.rounds, 3) if vertices > 5000 else plan.rounds
    batches = [members for members in plan.batches if members * vertices <= _MOST_BATCHED]
    cases = time_in_turn(workload.cases(batches), rounds, lambda name: done(f"{vertices}: {name}"))
    for name in [name for name in cases if name.startswith("floor:")]:
        cases[name] = Timing(tuple(FLOOR_SHARE * seconds for seconds in cases[name].seconds))
    phases = time_in_turn(workload.phases(), max(10 * rounds, 20), lambda name: None)
    fastest = min((name for name in cases if name.startswith("floor:")), key=lambda name: cases[name].median)
    ratios = {
        f"{name} / floor": paired_ratio(cases[name], cases[fastest])
        for name in ("drop", "drop+gradient", "drop+gradient, checkpointed")
    }
    for members in batches:
        ratios[f"batch of {members} / {members} drops"] = {
            key: value / members for key, value in paired_ratio(cases[f"batch of {members}"], cases["drop"]).items()
        }
    memory = {
        name: peak_of(_gradient_ready, vertices, plan.support, name == "kept") for name in ("kept", "checkpointed")
    }
    return {
        "vertices": workload.mesh.vertices,
        "floor": fastest.removeprefix("floor:"),
        "cases": {name: timing.summary() for name, timing in cases.items()},
        "phases": {name: timing.summary() for name, timing in phases.items()},
        "ratios": ratios,
        "memory_bytes": memory,
    }


def measure_beside(meshes: list[dict[str, Any]], plan: Plan, done: Callable[[str], None]) -> dict[str, Any]:
    """The plan's device on every mesh, with rates beside those of the CPU (`times_faster`).

    Args:
        meshes: What `measure_mesh` found.
        plan: What to measure.
        done: Called with the name of everything measured.

    Returns:
        Times, ratios and differences by name.
    """
    if plan.device is None:
        return {}
    found = []
    for vertices, cpu in zip(plan.vertices, meshes, strict=True):
        mesh = measure_device(vertices, plan.device, plan.device_batches, plan.rounds, plan.support, done)
        rates = {
            name: {"cpu": drapes_per_second(cpu["cases"], suffix), "device": drapes_per_second(mesh["cases"], suffix)}
            for name, suffix in (("forward", ""), ("gradient", "+gradient"))
        }
        faster = {name: rate["device"] / rate["cpu"] for name, rate in rates.items()}
        found.append(mesh | {"drapes_per_second": rates, "times_faster": faster})
    return device_name(plan.device) | {"meshes": found}


def _gradient_ready(vertices: int, support: str, keep: bool) -> Callable[[], object]:
    """A drop with its gradient, code and mesh ready."""
    workload = Workload(vertices, support)
    workload.drop()
    return lambda: workload.drop_gradient(keep=keep)


def gradient_errors(vertices: int) -> list[dict[str, Any]]:
    """Directional derivatives of the whole pipeline against central differences, in both modes.

    Args:
        vertices: Number of vertices of the mesh.

    Returns:
        A row a mode and parameter, with its relative error.
    """
    rows = []
    for mode in ("drop", "equilibrium"):
        settings = DrapeSettings(mode=mode, tolerance=1e-12)  # pyright: ignore[reportArgumentType]
        for error in GradientCheck(DrapeSimulator(disc_mesh(vertices), settings)).errors():
            rows.append({"mode": mode, **asdict(error), "relative_error": error.relative_error})
    return rows


def start_up() -> float:
    """Wall time of `cusick-bench simulate` on 1205 vertices in a new process, caches warm [s]."""
    arguments = ["simulate", "--density", "0.192", "--bending", "1.4e-5", "--vertices", "1205", "--json"]
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
        The exponent; None with fewer than two such meshes.
    """
    pairs = [(m["vertices"], m["cases"]["drop"]["median_s"]) for m in meshes if m["vertices"] >= 1000]
    if len(pairs) < 2:
        return None
    size, seconds = np.log(np.array(pairs)).T
    return float(np.polyfit(size, seconds, 1)[0])


def benchmark(plan: Plan, done: Callable[[str], None] = lambda name: None) -> dict[str, Any]:
    """Runs the benchmark.

    Args:
        plan: What to measure.
        done: Called with the name of everything measured.

    Returns:
        `hardware`, `plan`, `meshes`, `reference`, `gradient_error`, `start_up_s`, `scaling_exponent`, `device` (empty
        without one), `ratios` (those of the target mesh, or of the last) and `targets`.
    """
    meshes = [measure_mesh(vertices, plan, done) for vertices in plan.vertices]
    beside = measure_beside(meshes, plan, done)
    size = TARGET_SIZE if TARGET_SIZE in plan.vertices else plan.vertices[-1]
    reference = Comparison(size, plan.reference_steps).measure(min(plan.rounds, 3))
    done("plain autograd")
    errors = gradient_errors(plan.gradient_vertices)
    done("gradient check")
    target = next(mesh for mesh in meshes if mesh["vertices"] == size)
    document: dict[str, Any] = {
        "hardware": environment(),
        "plan": asdict(plan),
        "meshes": meshes,
        "reference": reference,
        "gradient_error": errors,
        "start_up_s": start_up(),
        "scaling_exponent": scaling(meshes),
        "device": beside,
        "ratios": {
            **{name: ratio["median"] for name, ratio in target["ratios"].items()},
            "plain autograd / engine, time": reference["times_faster"]["median"],  # pyright: ignore[reportIndexIssue]
            "plain autograd / engine, memory": reference["times_leaner"],
        },
    }
    return document | {"targets": list(_targets(document, target))}


def _targets(document: dict[str, Any], mesh: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Every target with what was measured."""
    ratios, cases = document["ratios"], mesh["cases"]
    errors = [row["relative_error"] for row in document["gradient_error"] if not row["branch_changed"]]
    worst = max(errors, default=None)
    upper = [
        ("drop / floor", ratios["drop / floor"], 1.35),
        ("drop+gradient / floor", ratios["drop+gradient / floor"], 2.0),
        ("warm equilibrium gradient (s)", cases["equilibrium, warm, +gradient"]["median_s"], 0.25),
        ("batch of 16 / 16 drops", ratios.get("batch of 16 / 16 drops"), 0.75),
        ("silhouette+gradient (s)", cases["silhouette+gradient"]["median_s"], 0.03),
        ("scaling exponent", document["scaling_exponent"], 1.5),
        ("gradient error", worst, 1e-5),
        ("start-up (s)", document["start_up_s"], 3.0),
    ]
    lower = [
        ("times faster than plain autograd", ratios["plain autograd / engine, time"], 20.0),
        ("times leaner than plain autograd", ratios["plain autograd / engine, memory"], 10.0),
    ]
    for rows, sign in ((upper, 1), (lower, -1)):
        for name, value, limit in rows:
            met = None if value is None else bool(sign * value <= sign * limit)
            bound = f"<= {limit:g}" if sign > 0 else f">= {limit:g}"
            yield {"target": name, "measured": value, "limit": bound, "met": met}
