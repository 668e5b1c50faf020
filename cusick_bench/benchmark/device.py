"""The torch engine on a device, beside the compiled engine on the CPU: times, peak memory, and how well they agree.

Positions, parameters and gradients stay on the device; a case ends when the device has finished it.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor

from cusick_bench.benchmark.timing import Timing
from cusick_bench.benchmark.workload import LOCKSTEP, STEPS, cloth
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.mesh import Mesh, disc_mesh
from cusick_bench.sim.constants import Law
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.render.camera import ParallelCamera
from cusick_bench.sim.render.silhouette import Method, render
from cusick_bench.sim.torch_engine.engine import torch_device

_MOST_BATCHED = 1_250_000  # vertices of a batch; larger ones are left out
_COMPARED = 2  # cloths on which the engines are compared
_SILHOUETTES = 16  # drawn at once
_SHAPES = 16  # in which cloths are laid down, in turn
_ENOUGH = 30.0  # [s] after which a case is timed no more

Case = Callable[[], object]


@dataclass(frozen=True, eq=False)
class DeviceWorkload:
    """Everything that is timed on one mesh and one device.

    Attributes:
        vertices: Mesh size.
        device: As `DrapeSimulator` takes it.
        support: As in `DrapeSettings`.
        law: Material law.
    """

    vertices: int
    device: str
    support: str = "fixed"
    law: Law = "paper"

    @cached_property
    def mesh(self) -> Mesh:
        """The mesh."""
        return disc_mesh(self.vertices)

    def simulator(self, device: str) -> DrapeSimulator:
        """Mesh and settings on a device.

        Args:
            device: Name such as `cpu` or `cuda`.

        Returns:
            The simulator of this workload there.
        """
        settings = DrapeSettings(law=self.law, support=self.support, steps=STEPS)  # pyright: ignore[reportArgumentType]
        return DrapeSimulator(self.mesh, settings, device=device)

    @cached_property
    def there(self) -> DrapeSimulator:
        """Simulator on the device."""
        return self.simulator(self.device)

    @cached_property
    def place(self) -> torch.device:
        """The device, for tensors."""
        return torch.device(torch_device(self.device) or "cpu")

    def finish(self) -> None:
        """Waits for the device."""
        if self.place.type == "cuda":
            torch.cuda.synchronize(self.place)

    def _cloths(self, members: int, *, track: bool) -> list[Material]:
        """Cloths on the device; with gradients, every element of each has tables of its own."""
        made = cloth(self.mesh)
        every = (made.stretch, made.bending, made.density)
        tables = every if track else tuple(table[0] for table in every)
        there = [table.to(self.place) for table in tables]
        return [Material(*(table.clone().requires_grad_(track) for table in there)) for _ in range(members)]

    @cached_property
    def _shapes(self) -> Tensor:
        shapes = np.stack([self.there.laid_down(seed) for seed in range(_SHAPES)])
        return torch.from_numpy(shapes).to(self.place)

    def _laid(self, members: int) -> Tensor:
        return self._shapes[torch.arange(members, device=self.place) % _SHAPES]

    def dropping(self, members: int, *, gradient: bool) -> Case:
        """Drops so many cloths, laid down in many ways; with the adjoint to all numbers of all elements.

        Args:
            members: Cloths at once.
            gradient: Whether gradients are computed as well.

        Returns:
            What to time.
        """
        laid, cloths = self._laid(members), self._cloths(members, track=gradient)

        def run() -> None:
            vertices = self.there.drape_batch(cloths, initial=laid).vertices
            if gradient:
                vertices.sum().backward()
            for material in cloths:
                material.stretch.grad = material.bending.grad = material.density.grad = None
            self.finish()

        return run

    def silhouettes(self, method: Method) -> Case:
        """Draws the drapes that lie on the device, and goes back to their positions.

        Args:
            method: "coverage" or "soft".

        Returns:
            What to time.
        """
        with torch.no_grad():
            draped = self.there.drape_batch(self._cloths(_SILHOUETTES, track=False), initial=self._laid(_SILHOUETTES))
        vertices = draped.vertices.detach().requires_grad_()

        def run() -> None:
            render(vertices, self.mesh.faces, ParallelCamera(), method=method).square().mean().backward()
            vertices.grad = None
            self.finish()

        return run

    def makers(self, batches: list[int]) -> dict[str, Callable[[], Case]]:
        """Functions that prepare the cases, by name of the case.

        Args:
            batches: Cloths at once, one or more numbers.

        Returns:
            What makes each case, by its name.
        """
        found: dict[str, Callable[[], Case]] = {}
        for members in [1, *batches]:
            name = "drop" if members == 1 else f"batch of {members}"
            found[name] = lambda members=members: self.dropping(members, gradient=False)
            found[f"{name}+gradient"] = lambda members=members: self.dropping(members, gradient=True)
        found[f"{_SILHOUETTES} silhouettes+gradient, through the host"] = lambda: self.silhouettes("coverage")
        found[f"{_SILHOUETTES} soft silhouettes+gradient"] = lambda: self.silhouettes("soft")
        return found

    def peak(self, case: Case) -> int | None:
        """Most memory of the device that a case holds, with what it starts from [bytes]; None on the CPU.

        Args:
            case: What to measure.

        Returns:
            Memory [bytes]; None on the CPU.
        """
        if self.place.type != "cuda":
            case()
            return None
        torch.cuda.empty_cache()
        torch.cuda.reset_peak_memory_stats(self.place)
        case()
        return torch.cuda.max_memory_allocated(self.place)

    def agreement(self) -> dict[str, Any]:
        """Largest difference of positions [m], and of gradients relative to the largest, between the two engines."""
        weight = torch.from_numpy(np.random.default_rng(0).normal(size=(_COMPARED, self.mesh.vertices, 3)))
        ours, theirs = (self._positions_and_gradients(name, weight) for name in (self.device, "cpu"))
        errors = {name: _largest(ours[name] - theirs[name]) / _largest(theirs[name]) for name in theirs}
        return {
            "cloths": _COMPARED,
            "positions_m": _largest(ours["positions"] - theirs["positions"]),
            "gradient": {name: error for name, error in errors.items() if name != "positions"},
        }

    def _positions_and_gradients(self, device: str, weight: Tensor) -> dict[str, Tensor]:
        cloths = [cloth(self.mesh, spread=0.1, seed=seed, track=True) for seed in range(_COMPARED)]
        taut = torch.tensor([1.001, 1.001, 1.0], dtype=torch.float64)  # max(G, 0) has a kink where nothing is strained
        laid = (self._laid(_COMPARED).cpu() * taut).requires_grad_()
        vertices = self.simulator(device).drape_batch(cloths, initial=laid).vertices
        (vertices * weight.to(vertices.device)).sum().backward()
        assert laid.grad is not None
        found = {"positions": vertices.detach().cpu(), "initial": laid.grad}
        for name in ("stretch", "bending", "density"):
            found[name] = torch.stack([getattr(one, name).grad for one in cloths])
        return found


def _largest(tensor: Tensor) -> float:
    return float(tensor.abs().max())


def _timed(case: Case, rounds: int) -> Timing:
    """Times of a case that has run before."""
    seconds: list[float] = []
    while not seconds or (len(seconds) < rounds and sum(seconds) < _ENOUGH):
        clock = time.perf_counter()
        case()
        seconds.append(time.perf_counter() - clock)
    return Timing(tuple(seconds))


def measure_device(
    vertices: int, device: str, batches: tuple[int, ...], rounds: int, support: str, law: Law,
    done: Callable[[str], None], keep: Callable[[dict[str, Any]], None] = lambda found: None,
) -> dict[str, Any]:  # fmt: skip
    """Everything about one mesh on one device.

    Args:
        vertices: Mesh size.
        device: As `DrapeSimulator` takes it.
        batches: Members of the batches; those of too many vertices are left out.
        rounds: Times of each case; fewer of cases that take long.
        support: As in `DrapeSettings`.
        law: Material law.
        done: Called with the name of everything measured.
        keep: Given what is found so far, after every case.

    Returns:
        `vertices`, `cases` (times), `peak_memory_bytes` (by case), `left_out` (why a case was not run), `agreement`.
    """
    workload = DeviceWorkload(vertices, device, support, law)
    cases, peaks, left_out = {}, {}, {}
    found = {"vertices": workload.mesh.vertices, "cases": cases, "peak_memory_bytes": peaks, "left_out": left_out}
    for name, ready in workload.makers([n for n in batches if n * vertices <= _MOST_BATCHED]).items():
        try:
            case = ready()
            peaks[name] = workload.peak(case)
        except (SimulationError, torch.cuda.OutOfMemoryError) as error:  # does not fit the device
            left_out[name] = str(error)
            continue
        cases[name] = _timed(case, rounds).summary()
        del case  # or what two cases hold would have to fit the device
        done(f"{vertices} on {device}: {name}")
        keep(found)
    return found | {"agreement": workload.agreement()}


def drapes_per_second(cases: dict[str, Any], suffix: str = "") -> float:
    """Best rate over single drops and batches.

    Args:
        cases: Times by name, as in the document.
        suffix: `+gradient` for drops with their adjoint.

    Returns:
        Drapes a second.
    """
    rates = []
    for name, timing in cases.items():
        case = name.removesuffix(suffix) if name.endswith(suffix) else ""
        members = "1" if case == "drop" else case.removeprefix("batch of ").removesuffix(LOCKSTEP)
        if members.isdecimal():
            rates.append(int(members) / timing["median_s"])
    return max(rates)


def device_name(device: str) -> dict[str, Any]:
    """The device, for the record.

    Args:
        device: Name such as `cpu` or `cuda`.

    Returns:
        What identifies it, by name.
    """
    place = torch_device(device)
    found = {"device": device, "torch": torch.__version__, "threads": torch.get_num_threads()}
    if place is None or not place.startswith("cuda"):
        return found
    properties = torch.cuda.get_device_properties(place)
    return found | {"name": properties.name, "memory_bytes": properties.total_memory, "cuda": torch.version.cuda}
