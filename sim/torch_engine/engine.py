"""The torch engine behind `DrapeSimulator`: batches of drops on a GPU, or on the CPU with the GPU's code.

    device "cpu"                 the compiled engine: every mode, the fastest on a CPU
    device "cuda", "cuda:1", …   the torch engine there: mode `drop`, many cloths at once
    device "cpu:torch"           the torch engine on the CPU: a check of the GPU's code where there is no GPU

Both engines take the same steps and have the same exact adjoint. Positions and their graph stay on the device; what is
copied to the host is one number a cloth: how it fared.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from cusick_bench.sim.engine.dynamics.drop_batch import flown_apart, halved
from cusick_bench.sim.engine.plate.system import ShellSystem
from cusick_bench.sim.engine.plate.unknowns import ShellUnknowns, VertexUnknowns
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.outcome import DROP_AT_REST
from cusick_bench.sim.torch_engine.drop import DroppedMembers, drop_members, free_memory, prepared
from cusick_bench.sim.torch_engine.forces import BatchParameters
from cusick_bench.sim.torch_engine.rollout import member_bytes
from cusick_bench.sim.torch_engine.shell_maps import ShellMaps

COMPILED = "cpu"
"""Device of the compiled engine."""

TORCH_ON_CPU = "cpu:torch"
"""Device of the torch engine on the CPU."""


def torch_device(name: str) -> str | None:
    """Torch's name of the device on which the torch engine is to run; None where the compiled engine is meant.

    Args:
        name: `cpu`, `cpu:torch`, `cuda` or `cuda:N`.

    Returns:
        The name, or None.

    Raises:
        SimulationError: Another name, or a GPU that is not there.
    """
    if name in (COMPILED, TORCH_ON_CPU):
        return None if name == COMPILED else "cpu"
    kind, _, number = name.partition(":")
    if kind != "cuda" or (":" in name and not number.isdecimal()):
        raise SimulationError(f"device must be {COMPILED}, {TORCH_ON_CPU}, cuda or cuda:N, got {name!r}")
    if not torch.cuda.is_available():
        raise SimulationError(
            f"device {name!r} needs a CUDA GPU, and torch {torch.__version__} sees none; install a CUDA build of torch "
            f"and look at nvidia-smi, or use device {COMPILED!r}"
        )
    if number and int(number) >= torch.cuda.device_count():
        raise SimulationError(f"device must be one of the {torch.cuda.device_count()} GPUs, from cuda:0, got {name!r}")
    return name


@dataclass(frozen=True, eq=False)
class TorchOutcome:
    """Outcome of a batch on the torch engine, apart from the positions; see `DrapeBatch`."""

    failures: list[str | None]
    residual: Float[ndarray, "members"]
    iterations: Int[ndarray, "members"]
    halvings: Int[ndarray, "members"]
    at_rest: float = DROP_AT_REST

    def put(self, members: Int[ndarray, "some"], found: "TorchOutcome") -> None:
        """Sets what became of some cloths that were dropped again, in place.

        Args:
            members: Their places in the batch.
            found: What became of them.
        """
        for place, member in enumerate(members):
            self.failures[member] = found.failures[place]
        for name in ("residual", "iterations", "halvings"):
            getattr(self, name)[members] = getattr(found, name)


@dataclass(frozen=True, eq=False)
class TorchEngine:
    """Drops batches on one device.

    Attributes:
        system: Mesh, law and support.
        unknowns: What the system computes with, from and to vertices, faces and hinges.
        settings: How the cloths are draped.
        name: Name of the device, as `torch_device` takes it.
        memory_limit: Most memory of a batch [bytes]; None for most of what a GPU has left, or 4 GiB on the CPU.

    Raises:
        SimulationError: A device that is not there, or settings that only the compiled engine knows.
    """

    system: DrapeSystem | ShellSystem
    unknowns: VertexUnknowns | ShellUnknowns
    settings: DrapeSettings
    name: str
    memory_limit: int | None = None

    def __post_init__(self) -> None:
        if torch_device(self.name) is None:
            raise SimulationError(f"device {self.name!r} is that of the compiled engine; use another for this one")
        if self.settings.backend not in ("auto", "multifrontal"):
            raise SimulationError(
                f"device {self.name!r} has linear solver 'multifrontal' only, got backend {self.settings.backend!r}"
            )
        if self.settings.pace != "steady":
            raise SimulationError(f"device {self.name!r} drops at pace 'steady' only, got {self.settings.pace!r}")
        if self.settings.mode != "drop":
            raise SimulationError(
                f"device {self.name!r} drapes in mode 'drop' only, got mode {self.settings.mode!r}; use mode 'drop', "
                f"with more steps for a cloth at rest, or device {COMPILED!r}"
            )

    def drape(self, p: BatchParameters, laid: Float[Tensor, "#members vertices 3"]) -> tuple[Tensor, TorchOutcome]:
        """Positions (members, vertices, 3) on the device, with gradients, and what became of the cloths.

        Args:
            p: The cloths, on any device.
            laid: Shapes in which they are laid down [m].
        """
        s, maps = self.settings, self._maps
        if maps is not None:
            p, laid = maps.parameters(p), maps.configuration(laid)
        weight = (s.gravity * p.mass.detach().sum(1)).cpu().numpy()
        dropped = self._dropped(p, laid, s)
        positions, outcome, members = dropped.positions, self._outcome(dropped, weight, 0), np.arange(len(dropped.good))
        for halvings in range(1, s.halvings + 1):
            failed = np.array([outcome.failures[member] is not None for member in members])
            members = members[failed & (dropped.steps.cpu().numpy() > 0)]  # not who is lost in the first step
            if not len(members):
                break
            some = torch.from_numpy(members)
            anchor = laid if len(laid) == 1 else laid[some.to(laid.device)]
            dropped = self._dropped(p.take(some), anchor, halved(s, halvings))
            positions = positions.index_copy(0, some.to(positions.device), dropped.positions)
            outcome.put(members, self._outcome(dropped, weight if len(weight) == 1 else weight[members], halvings))
        lost = [member for member, failure in enumerate(outcome.failures) if failure is not None]
        if lost:
            positions = positions.index_fill(0, torch.tensor(lost, device=positions.device), math.nan)
        return positions if maps is None else maps.positions(positions), outcome

    def _dropped(self, p: BatchParameters, laid: Tensor, s: DrapeSettings) -> DroppedMembers:
        return drop_members(
            self.system, p, laid, steps=s.steps, step_seconds=s.step_seconds, device=self.device,
            memory_limit=self.memory_limit,
        )  # fmt: skip

    @cached_property
    def _maps(self) -> ShellMaps | None:
        """Between cloth and shell on the device; None for laws whose unknowns are the vertices."""
        return ShellMaps(self.unknowns, self.device) if isinstance(self.unknowns, ShellUnknowns) else None

    @property
    def device(self) -> str:
        """Torch's name of the device."""
        return self.name.removesuffix(":torch")

    def _outcome(
        self, dropped: DroppedMembers, weight: Float[ndarray, "#members"], halvings: int
    ) -> TorchOutcome:  # fmt: skip
        s, good = halved(self.settings, halvings), dropped.good.cpu().numpy()
        residual = np.where(good, dropped.force.cpu().numpy() / weight, np.nan)
        failures = [
            flown_apart(s, force) if sound else _reason(s, factored, steps)
            for sound, factored, steps, force in zip(
                good, dropped.factored.tolist(), dropped.steps.tolist(), residual.tolist(), strict=True
            )
        ]
        lost = np.array([failure is not None for failure in failures])
        return TorchOutcome(
            failures, np.where(lost, np.nan, residual), np.where(lost, 0, s.steps), np.full(len(good), halvings)
        )

    def at_once(self) -> int:
        """Cloths without gradients that drop together within the memory; a larger batch runs in groups."""
        forces, linear = prepared(self.system, self.device)
        limit = free_memory(self.device) if self.memory_limit is None else self.memory_limit
        return max(1, limit // sum(member_bytes(forces, linear, self.settings.steps, differentiate=False)))


def _reason(s: DrapeSettings, factored: bool, steps: int) -> str:
    """Why a member that took so many sound steps is lost."""
    step = f"step {min(steps + 1, s.steps)} of {s.steps}"
    if not factored:
        return f"{step}: the step matrix must be positive definite, and it is not; check the stiffness tables"
    return f"{step}: the cloth flies apart; use a shorter step than {s.step_seconds} s or check stiffness and density"
