"""What a benchmark measures, and about how long that takes."""

from collections.abc import Iterable
from dataclasses import dataclass

from cusick_bench.benchmark.laws import LAWS
from cusick_bench.benchmark.workload import CASES, LOCKSTEP, STEPS, floor_backends
from cusick_bench.datasets.files.plate_drapes import PlateDrape
from cusick_bench.sim.constants import Law
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.torch_engine.engine import torch_device

TARGET_SIZE = 2699
"""Mesh size that the targets are for: the paper's."""

COMPARED_BATCH = 16
"""Members of the batch on the CPU that a device is compared with."""
COMPARED = ("drop", "drop+gradient", f"batch of {COMPARED_BATCH}{LOCKSTEP}")
"""Cases that a device is compared with: the CPU's fastest ways."""

MOST_BATCHED = 200_000
"""Vertices of a batch on the CPU; larger ones are left out, they take minutes."""
_LARGE = 5000  # vertices of a mesh that gets at most three rounds

# What a part takes [s] on two quiet cores, roughly: progress is told in these units.
_DROP_SECONDS = 1.5e-4  # of a vertex
_PROCESS_SECONDS = 5.0  # to start a process and to make it ready
_DROPS = {"drop+gradient": 1.6, "drop+gradient, checkpointed": 2.5, "silhouette+gradient": 0.05}  # times of a drop
_GRADIENT_DROPS = 200  # of the check of gradients
START_SECONDS = 3 * _PROCESS_SECONDS
"""Approximate time of measuring the start-up of one law [s]."""


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

    @property
    def target(self) -> int:
        """Mesh size that the targets are held against: `TARGET_SIZE`, or the last where that is not measured."""
        return TARGET_SIZE if TARGET_SIZE in self.vertices else self.vertices[-1]

    def rounds_on(self, vertices: int) -> int:
        """Times of each case on a mesh.

        Args:
            vertices: Number of vertices of the mesh.

        Returns:
            `rounds`, on a large mesh at most three.
        """
        return min(self.rounds, 3) if vertices > _LARGE else self.rounds

    def batches_on(self, vertices: int) -> list[int]:
        """Members of the batches on a mesh.

        Args:
            vertices: Number of vertices of the mesh.

        Returns:
            Those of `batches` that do not take minutes.
        """
        return [members for members in self.batches if members * vertices <= MOST_BATCHED]


FULL = {"vertices": (297, 1205, 2699, 7496, 20000), "rounds": 5, "batches": (16, 64)}
"""What the full benchmark measures beyond the quick one, which the defaults of `Plan` are; a quarter of an hour."""


def case_seconds(case: str, vertices: int) -> float:
    """Approximate time of one call of a case [s].

    Args:
        case: Name of the case, as in `Workload`.
        vertices: Number of vertices of the mesh.

    Returns:
        The time on two quiet cores.
    """
    members = case.removeprefix("batch of ").removesuffix("+gradient").removesuffix(LOCKSTEP)
    drops = float(members) if members.isdecimal() else 0.1 if case.startswith("floor:") else _DROPS.get(case, 1.0)
    return drops * _DROP_SECONDS * vertices


def memory_seconds(vertices: int) -> float:
    """Approximate time of measuring the memory of a drop's gradient, with states kept and not [s].

    Args:
        vertices: Number of vertices of the mesh.

    Returns:
        The time on two quiet cores.
    """
    return 2 * _PROCESS_SECONDS + 8 * _DROP_SECONDS * vertices


def laws_seconds(plan: Plan) -> float:
    """Approximate time of the comparison of laws [s].

    Args:
        plan: What to measure.

    Returns:
        The time of steps of both laws, and of some three drops of both for each reference drape and mesh.
    """
    drapes = 3 * len(LAWS) * len(plan.reference) * sum(plan.reference_vertices)
    return _DROP_SECONDS * (2 * len(LAWS) * sum(plan.vertices) + drapes)


def reference_seconds(plan: Plan) -> float:
    """Approximate time of the comparison with plain autograd [s].

    Args:
        plan: What to measure.

    Returns:
        The time on two quiet cores.
    """
    autograd = 50 * _DROP_SECONDS * plan.target * plan.reference_steps / STEPS
    return 2 * _PROCESS_SECONDS + (min(plan.rounds, 3) + 5) * autograd


def gradient_check_seconds(plan: Plan) -> float:
    """Approximate time of the check of gradients [s].

    Args:
        plan: What to measure.

    Returns:
        The time on two quiet cores.
    """
    return _GRADIENT_DROPS * _DROP_SECONDS * plan.gradient_vertices


def work(plan: Plan) -> float:
    """Approximate time of a plan on two quiet cores [s]; without the device, whose speed is not known.

    Args:
        plan: What to measure.

    Returns:
        The sum of what `benchmark` tells of.
    """
    if plan.device_only:
        return sum(_cases_seconds(COMPARED, vertices, plan) for vertices in plan.vertices)
    found = 0.0
    for vertices in plan.vertices:
        batches = [f"batch of {members}" for members in plan.batches_on(vertices)]
        names = [*(f"floor:{name}" for name in floor_backends()), *CASES, *batches, *batches]
        found += _cases_seconds(names, vertices, plan) + memory_seconds(vertices)
    found += laws_seconds(plan) + reference_seconds(plan) + gradient_check_seconds(plan)
    return found + len(LAWS) * START_SECONDS


def _cases_seconds(names: Iterable[str], vertices: int, plan: Plan) -> float:
    return (plan.rounds_on(vertices) + 1) * sum(case_seconds(name, vertices) for name in names)
