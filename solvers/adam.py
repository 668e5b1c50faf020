"""Adam on arrays of numpy, as PyTorch implements it: the stochastic optimiser that every solver with gradients shares.

References:
    Kingma, Ba. Adam: A Method for Stochastic Optimization. ICLR 2015. Loshchilov, Hutter. SGDR: Stochastic Gradient
    Descent with Warm Restarts. ICLR 2017 (the cosine).
"""

import math

import numpy as np
import torch
from jaxtyping import Float

Arrays = dict[str, Float[np.ndarray, "..."]]

LAST_RATE = 0.1  # length of the last planned step over that of the first
EPSILON = 1e-12  # added to the root of the mean square; small, since gradients of a fit may be as small as 1e-6
MEAN_DECAY = 0.9  # beta_1 of the paper
MOMENTS = ("exp_avg", "exp_avg_sq")  # PyTorch's names of the running means of gradients and of their squares


def cosine_rate(first: float, step: int, planned: int) -> float:
    """Step length that falls along half a cosine.

    Args:
        first: Length of the first step.
        step: Number of the step, from 0.
        planned: Number of steps; those after stay as short as the last.

    Returns:
        Length of that step, between `first` and a tenth of it.
    """
    share = 0.5 * (1 + math.cos(math.pi * min(1.0, step / planned)))
    return first * (LAST_RATE + (1 - LAST_RATE) * share)


class Adam:
    """Moves arrays downhill, in place.

    Attributes:
        steps: Steps taken.
    """

    def __init__(self, arrays: Arrays, *, square_decay: float, memory: Arrays | None = None) -> None:
        """Starts afresh, or goes on where another optimiser has stopped.

        Args:
            arrays: Arrays to move, float64, by name.
            square_decay: beta_2 of the paper: the share that the running mean of squared gradients keeps at a step.
            memory: Memory of the optimiser that has stopped.
        """
        self.steps = 0 if memory is None else int(memory["steps"])
        self._tensors = {name: torch.from_numpy(array) for name, array in arrays.items()}  # the same memory
        self._optimiser = torch.optim.Adam(self._tensors.values(), betas=(MEAN_DECAY, square_decay), eps=EPSILON)
        if memory is not None and self.steps > 0:
            for name, tensor in self._tensors.items():
                moments = {moment: torch.from_numpy(memory[f"{name}_{moment}"].copy()) for moment in MOMENTS}
                self._optimiser.state[tensor] = {"step": torch.tensor(float(self.steps)), **moments}

    def step(self, gradients: Arrays, rate: float) -> None:
        """Takes a step.

        Args:
            gradients: Derivatives of the loss by each array.
            rate: Length of the step.
        """
        for name, tensor in self._tensors.items():
            tensor.grad = torch.from_numpy(gradients[name])
        for group in self._optimiser.param_groups:
            group["lr"] = rate
        self._optimiser.step()
        self.steps += 1

    def memory(self) -> Arrays:
        """State on which the next step depends, in addition to the arrays themselves."""
        moments = {
            f"{name}_{moment}": self._optimiser.state[tensor][moment].numpy().copy()
            for name, tensor in self._tensors.items()
            for moment in MOMENTS
            if self.steps
        }
        return {"steps": np.array(self.steps), **moments}
