"""What drops, descents and their adjoints ask of a system; `DrapeSystem` (hinges) and `ShellSystem` have it.

Configurations are arrays over the mesh's vertices; what stands there is the system's (vertices, or the control points
of a shell).
"""

from typing import Protocol

from jaxtyping import Bool, Float, Int
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.engine.parameters import ParameterGradient, Parameters
from cusick_bench.sim.linear.interface import LinearSolver


class Evaluated(Protocol):
    """A batch's elements at its configurations; valid until the system's next evaluation."""

    @property
    def x(self) -> Float[ndarray, "members vertices 3"]: ...

    def force(self) -> Float[ndarray, "members vertices 3"]: ...

    def energy(self) -> Float[ndarray, "members"]: ...

    def matrix(
        self,
        *,
        scale: float = 1.0,
        diagonal: Float[ndarray, "members vertices"],
        out: Float[ndarray, "members slots 3 3"] | None = None,
    ) -> Float[ndarray, "members slots 3 3"]: ...


class Layout(Protocol):
    """Block sparsity of the free unknowns."""

    @property
    def indptr(self) -> Int[ndarray, "rows_plus_one"]: ...
    @property
    def indices(self) -> Int[ndarray, "slots"]: ...
    @property
    def diagonal(self) -> Int[ndarray, "rows"]: ...


class ClothSystem(Protocol):
    """A cloth on its support, under gravity, with one material law."""

    @property
    def mesh(self) -> Mesh: ...
    @property
    def law(self) -> str: ...
    @property
    def gravity(self) -> float: ...
    @property
    def fixed(self) -> Bool[ndarray, "vertices"]: ...
    @property
    def free(self) -> Int[ndarray, "rows"]: ...
    @property
    def spring(self) -> Float[ndarray, "vertices"]: ...
    @property
    def layout(self) -> Layout: ...
    @property
    def linear(self) -> LinearSolver: ...

    def require_energy(self, what: str) -> None: ...

    def evaluate(
        self, x: Float[ndarray, "members vertices 3"], anchor: Float[ndarray, "members vertices 3"], p: Parameters,
        *, exact: bool, everywhere: bool = False,
    ) -> Evaluated: ...  # fmt: skip

    def zero_gradient(self, *members: int) -> ParameterGradient: ...

    def add_diagonal(
        self, blocks: Float[ndarray, "*members slots 3 3"], amount: Float[ndarray, "*members vertices"]
    ) -> None: ...

    def adjoint(
        self,
        x: Float[ndarray, "*members vertices 3"],
        multiplier: Float[ndarray, "*members vertices 3"],
        velocity: Float[ndarray, "*members vertices 3"],
        p: Parameters,
        gradient: ParameterGradient,
        *,
        force_factor: float,
        stiffness_factor: float,
    ) -> tuple[Float[ndarray, "*members vertices 3"], Float[ndarray, "*members vertices 3"]]: ...
