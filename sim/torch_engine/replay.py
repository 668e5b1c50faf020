"""Steps that work in place, launched on a GPU as one CUDA graph each.

A step of a drop is some two thousand small kernels, which take 20 ms to start one by one from Python, whatever the size
of the batch; captured in a graph they are started together.

References:
    PyTorch documentation, CUDA semantics, CUDA Graphs: capture after a first run in a stream of its own.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

import torch

Result = TypeVar("Result")


class _Replay(Generic[Result]):
    """Runs a step the first time, captures it the second time, and launches what was captured from then on."""

    def __init__(self, step: Callable[[], Result]) -> None:
        self.step = step
        self.graph: torch.cuda.CUDAGraph | None = None
        self.ready = False

    def __call__(self) -> Result | None:
        if not self.ready:
            self.ready = True
            return self._apart()
        if self.graph is None:
            self.graph = torch.cuda.CUDAGraph()
            with torch.cuda.graph(self.graph):  # records, does not run
                self.step()
        self.graph.replay()
        return None

    def _apart(self) -> Result:
        """One run in a stream of its own, which sets up what libraries may not set up during a capture."""
        present, apart = torch.cuda.current_stream(), torch.cuda.Stream()
        apart.wait_stream(present)
        with torch.cuda.stream(apart):
            result = self.step()
        present.wait_stream(apart)
        return result


@contextmanager
def replayed(step: Callable[[], Result], device: torch.device | None) -> Iterator[Callable[[], Result | None]]:
    """A step to call as often as wanted, as a graph on a GPU.

    Args:
        step: Works in place on tensors that it keeps, and looks at none of their values on the host.
        device: GPU on whose graph it runs; None to run it as it is.

    Yields:
        The step; as a graph it returns nothing from its second call on.
    """
    if device is None:
        yield step
        return
    with torch.cuda.device(device):
        yield _Replay(step)
        torch.cuda.current_stream().synchronize()  # before the graph and its memory go
