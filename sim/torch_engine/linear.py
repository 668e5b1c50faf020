"""Batched sparse linear systems of 3x3 blocks in torch: one pattern, many matrices, any device.

linear = torch_solver(pattern, "cuda")
factor = linear.factorise(blocks)        # (members, needed slots, 3, 3), in the order of linear.slots
x = factor.solve(b)                      # (members, vertices, 3); factor.good says which members have a factor
"""

from importlib.util import find_spec

import torch

from cusick_bench.sim.errors import SimulationError
from cusick_bench.sim.linear.interface import BlockPattern
from cusick_bench.sim.torch_engine.batched_solver import TorchLinear
from cusick_bench.sim.torch_engine.cudss import CudssTorch
from cusick_bench.sim.torch_engine.multifrontal import MultifrontalTorch

TORCH_BACKENDS = ("multifrontal", "cudss")
"""Batched linear solvers."""


def torch_solver(pattern: BlockPattern, device: str, linear: str = "multifrontal") -> TorchLinear:
    """Analyses a pattern for batches on a device.

    Args:
        pattern: The coupled vertices.
        device: Torch device.
        linear: `multifrontal` (any device) or `cudss` (CUDA only; needs nvmath-python).

    Returns:
        The solver, analysed.

    Raises:
        SimulationError: The solver is unknown, its package is missing or it does not run on the device.
    """
    if linear not in TORCH_BACKENDS:
        raise SimulationError(f"batched linear solver must be one of {', '.join(TORCH_BACKENDS)}, got {linear!r}")
    if linear == "multifrontal":
        return MultifrontalTorch(pattern, device)
    if torch.device(device).type != "cuda":
        raise SimulationError(f"linear solver 'cudss' runs on CUDA only, got device {device!r}; use 'multifrontal'")
    if find_spec("nvmath") is None:
        raise SimulationError("linear solver 'cudss' needs nvmath-python; pip install 'cusick-bench[gpu]'")
    return CudssTorch(pattern, device)
