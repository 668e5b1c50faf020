"""Operations with a hand-written gradient that refuse second derivatives.

The result of an adjoint carries no graph. With `create_graph=True` autograd would take it for a constant, and a second
derivative would silently lack a part. Torch's own `once_differentiable` does not connect its error to the inputs, so
that `torch.autograd.grad`, which follows only paths to the requested tensors, would not reach it.
"""

from collections.abc import Callable
from functools import wraps
from typing import Any

import torch
from torch import Tensor

from cusick_bench.sim.errors import SimulationError

Backward = Callable[..., tuple[Tensor | None, ...]]
"""The `backward` of a `torch.autograd.Function`: a gradient for each input of `forward`, None for what has none."""


class _Once(torch.autograd.Function):
    """Gradients as they are, tied to what they depend on by an error."""

    @staticmethod
    def forward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any, what: str, gradients: list[Tensor], *depends_on: Tensor
    ) -> tuple[Tensor, ...]:
        ctx.what = what
        return tuple(gradients)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[None, ...]:
        raise SimulationError(
            f"{ctx.what} has first derivatives only, and a second one was asked for (create_graph=True); take central "
            "differences of its gradient, or leave create_graph out"
        )


def first_derivatives(what: str) -> Callable[[Backward], Backward]:
    """Marks a `backward` that is computed without a graph.

    Args:
        what: The operation, for the message.

    Returns:
        A decorator. The inputs that gradients depend on must be those of `ctx.save_for_backward`. Gradients are as
        without it; where a graph of them is asked for, their derivatives raise a SimulationError.
    """

    def decorate(backward: Backward) -> Backward:
        @wraps(backward)
        def once(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor | None, ...]:
            with torch.no_grad():
                found = backward(ctx, *grad_outputs)
            if not torch.is_grad_enabled():
                return found
            gradients = [gradient for gradient in found if gradient is not None]
            marked: Any = _Once.apply(what, gradients, *ctx.saved_tensors, *grad_outputs)
            left = iter(marked)
            return tuple(None if gradient is None else next(left) for gradient in found)

        return once

    return decorate
