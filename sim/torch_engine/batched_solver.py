"""What a batched linear solver is: one pattern of 3x3 blocks is analysed, many matrices are factorised."""

from abc import ABC, abstractmethod

from jaxtyping import Bool, Float, Int
from numpy import ndarray
from torch import Tensor

from cusick_bench.sim.linear.interface import BlockPattern


class TorchFactor(ABC):
    """Factors of a batch.

    Attributes:
        good: Which members have one; the others' solutions are meaningless.
    """

    good: Bool[Tensor, "members"]

    @abstractmethod
    def solve(self, right: Float[Tensor, "members vertices 3"]) -> Float[Tensor, "members vertices 3"]:
        """Solves A x = b, one right-hand side for each member."""


class TorchLinear(ABC):
    """Factorises batches of one pattern; building it is the analysis.

    Attributes:
        pattern: The coupled vertices.
        slots: Slots of the pattern that are read, in the order in which `factorise` takes their blocks.
        keeps: Whether factors stay valid when others are made.
        capturable: Whether its work can be captured in a CUDA graph.
        factor_bytes: Memory of a member's factor [bytes].
        work_bytes: Memory of a member while it is factorised, besides the factor [bytes].
    """

    pattern: BlockPattern
    slots: Int[ndarray, "needed"]
    keeps: bool
    capturable: bool
    factor_bytes: int
    work_bytes: int

    @abstractmethod
    def factorise(self, blocks: Float[Tensor, "members needed 3 3"]) -> TorchFactor:
        """Factorises a batch of matrices, given by their blocks in `slots`.

        Args:
            blocks: Blocks in `slots`, for every matrix.

        Returns:
            The factors, and which matrices were positive definite.
        """
