"""Options of an identification."""

from dataclasses import dataclass

from cusick_bench.sim.constants import VERTICES_TO_FIT


@dataclass(frozen=True)
class Options:
    """How to identify.

    Attributes:
        cloths: Cloths of the data set; all by default.
        solver: Solver with a posterior, with its options.
        vertices: Vertices of the mesh that is fitted.
        steps: Steps of a drop.
        budget: Drapes that the fit of a fabric may spend; a gradient counts as two.
        samples: Simulated samples of each model of the diagnosis; 0 leaves gap and closure out.
        seed: Seed of fits and diagnosis.
        force: Whether silhouettes that no cloth on its plate can show are used all the same.
    """

    cloths: tuple[str, ...] = ()
    solver: str = "bdp-field,draws=8"
    vertices: int = VERTICES_TO_FIT
    steps: int = 100
    budget: float = 400.0
    samples: int = 8
    seed: int = 0
    force: bool = False
