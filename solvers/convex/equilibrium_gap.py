"""Stiffness from the training drape's three-dimensional shape: the tables whose forces balance gravity there.

No drape is simulated to find them: one convex programme, repeated while the shape is corrected for its measurement
error (`force_balance`). The areal density sets the scale. It needs the shape itself. A surface that was built from a
silhouette, like the meshes of the public release, is no shape that the cloth had: its triangles are strained by
several per cent, where the cloth's own weight strains it by a tenth of one, and no stiffness balances gravity on it.
Such meshes are refused, with the figures that say so, and so are drops, by another law or of a cloth whose stiffness
varies over 2 cm, as in the set `synthetic`.

References:
    Claire, Hild, Roux, A finite element formulation to identify damage fields: the equilibrium gap method, Int. J.
    Numerical Methods in Engineering 61(2), 2004.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from jaxtyping import Float

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.errors import SimulationError
from cusick_bench.solvers.base import (
    Prediction,
    Progress,
    Solver,
    SolverError,
    prediction_at,
    require_at_least,
    require_positive,
)

if TYPE_CHECKING:
    from cusick_bench.problem import DrapeProblem, TrainMesh
    from cusick_bench.sim.engine.settings import DrapeSettings
    from cusick_bench.solvers.convex.force_balance import Balance, Shape


# Strain of the edges, root mean square. Drapes have 0.001 to 0.005, surfaces built from silhouettes 0.05 to 0.16.
STRAIN_LIMIT = 0.02
# Mean square of the whitened gap, which is about 1 where the shape was measured as well as assumed.
MISFIT_LIMIT = 25.0
_SHOWN = 3  # entries named of a singular direction


def edge_strain(vertices: Float[np.ndarray, "V 3"], mesh: Mesh) -> float:
    """Root mean square relative change of the edges' lengths.

    Args:
        vertices: Positions in the drape [m].
        mesh: The flat cloth.

    Returns:
        Strain [1].
    """
    start, end = mesh.edges.T
    length = np.linalg.norm(vertices[end] - vertices[start], axis=1)
    return float(
        np.sqrt(np.mean((length / np.linalg.norm(mesh.material[end] - mesh.material[start], axis=1) - 1) ** 2))
    )


def _remedy(law: str) -> str:
    """Which meshes are shapes of a cloth at rest."""
    rests = f"`simulate --law {law} --mode equilibrium --out`"
    return f"use rests that {rests} writes, on as many vertices as the run has, or a solver that fits silhouettes"


def unrolled(mesh: TrainMesh, plate_radius: float) -> Float[np.ndarray, "V 2"]:
    """Flat coordinates along straight generators: what a ruled surface's construction takes the cloth to have been [m].

    Outside of the plate's edge a point lies as far out as its generator is long, at its own angle: as if nothing had
    moved sideways.

    Args:
        mesh: The training drape's mesh.
        plate_radius: Radius of the plate [m].

    Returns:
        Coordinates in the flat cloth [m].
    """
    x, y, z = mesh.vertices.T
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    outside = radius > plate_radius
    flat = np.where(outside, plate_radius + np.hypot(radius - plate_radius, z), radius)
    return np.column_stack([flat * np.cos(angle), flat * np.sin(angle)])


@dataclass(frozen=True)
class EquilibriumGap(Solver):
    """Convex fit of one stretch and one bending table to the training drape's shape.

    Attributes:
        position_error: Standard deviation of a mesh coordinate [m]; by default what rounding to 0.01 mm leaves.
        force_error: Standard deviation of the model's error of forces, as a share of each vertex's weight.
        rest_height: Standard deviation of the rest shape's height, which is not known [m].
        unevenness: Standard deviation of log stiffness over the cloth.
    """

    position_error: float = 3e-6
    force_error: float = 0.02
    rest_height: float = 4e-4
    unevenness: float = 0.1
    name: ClassVar[str] = "equilibrium-gap"
    summary: ClassVar[str] = "convex fit of the tables whose forces balance gravity on the training drape's mesh"
    reference: ClassVar[str] = "Claire, Hild, Roux, Int. J. Numerical Methods in Engineering 61(2), 2004"
    space: ClassVar[str | None] = "homo"
    needs_mesh: ClassVar[bool] = True
    version: ClassVar[int] = 2  # 2: rest shapes count in the free half of hinges on a clamp

    def __post_init__(self) -> None:
        require_positive(self, "position_error", "force_error")
        require_at_least(self, 0, "rest_height", "unevenness")

    def _solve(self, problem: DrapeProblem, generator: np.random.Generator, progress: Progress) -> Prediction:
        from cusick_bench.solvers.convex.force_balance import Errors, balance

        assert problem.train_mesh is not None
        progress("balancing forces", 0.1)
        shape, strain = self._shape(problem, problem.train_mesh)
        errors = Errors(self.position_error, self.force_error, rest_height=self.rest_height, unevenness=self.unevenness)
        with problem.meter.reserve(1):  # for the drape of what is found, however long this takes
            found = balance([shape], problem.space.prior, errors)
            self._check(found, strain, problem.simulator.settings.law)
        progress("draping the result", 0.9)
        return replace(prediction_at(problem, found.tau, finished=True), notes=notes(found, strain))

    def _shape(self, problem: DrapeProblem, drape: TrainMesh) -> tuple[Shape, float]:
        """The drape on its own triangles, and the strain of its edges."""
        from cusick_bench.sim.drape import DrapeSimulator
        from cusick_bench.solvers.convex.force_balance import Shape

        settings = problem.simulator.settings
        if settings.law == "plate":
            raise SolverError(
                f"{self.name} balances forces of faces and hinges at vertices, and law plate has none there; run it "
                "with --law paper, whose tables mean the same stiffness"
            )
        if drape.material is None:
            raise SolverError(self._without_reference(drape, settings))
        if settings.support == "springs":  # whose pull is not known: vertices on the plate then count as held
            settings = replace(settings, support="fixed", clamp="whole")
        try:
            simulator = DrapeSimulator(Mesh(drape.material, drape.faces), settings)
        except SimulationError as error:
            raise SolverError(f"{self.name} cannot use the training mesh: {error}") from error
        mesh = simulator.mesh
        mass = mesh.vertex_areas * problem.areal_density
        return Shape(simulator.hinge_system, drape.vertices, mass), edge_strain(drape.vertices, mesh)

    def _without_reference(self, drape: TrainMesh, settings: DrapeSettings) -> str:
        message = (
            f"{self.name} needs to know how the training mesh lay flat, and its {len(drape.faces)} triangles are those "
            "of no known flat mesh. "
        )
        try:
            strain = edge_strain(drape.vertices, Mesh(unrolled(drape, settings.plate_radius), drape.faces))
            message += (
                f"Unrolled along straight generators from the plate's edge, its edges are strained by {strain:.1%} rms"
                + (
                    ", as no cloth is under its own weight: it was built from a silhouette. "
                    if strain > STRAIN_LIMIT
                    else ". "
                )
            )
        except SimulationError:
            message += "It cannot be unrolled along straight generators from the plate's edge either. "
        return f"{message}To get on, {_remedy(settings.law)}"

    def _check(self, found: Balance, strain: float, law: str) -> None:
        """Refuses shapes on which the figures mean nothing."""
        reasons = []
        if strain > STRAIN_LIMIT:
            reasons.append(f"its edges are strained by {strain:.1%} rms (a drape's by less than {STRAIN_LIMIT:.0%})")
        if found.misfit > MISFIT_LIMIT:
            reasons.append(
                f"the gap that is left is {found.misfit**0.5:.0f} times what errors of {self.position_error:g} m and "
                f"an uneven cloth explain (at most {MISFIT_LIMIT**0.5:.0f})"
            )
        if reasons:
            raise SolverError(
                f"no stiffness holds the training mesh in balance: {'; '.join(reasons)}. At the shape as given, "
                f"{found.unexplained:.0%} of gravity stay unbalanced whatever the stiffness (100 % without any). It is "
                f"not the shape of a cloth at rest by law {law}: {_remedy(law)}"
            )


def notes(found: Balance, strain: float) -> dict[str, Any]:
    """Figures of the fit and of what it leaves undetermined, for the result's JSON.

    Args:
        found: The fit.
        strain: Strain of the edges.

    Returns:
        Numbers, by name.
    """
    from cusick_bench.solvers.convex.force_balance import KNOWN, NAMES

    entries = {
        name: {"value": float(value), "relative_sd": float(sd), "identifiable": bool(sd <= KNOWN)}
        for name, value, sd in zip(NAMES, found.theta, found.relative_sd, strict=True)
    }
    combinations = []
    for value, direction, known in zip(found.singular_values, found.directions, found.identifiable, strict=True):
        largest = np.argsort(-np.abs(direction))[:_SHOWN]
        combinations.append(
            {
                "relative_sd": float(1 / value) if value > 0 else None,
                "identifiable": bool(known),
                "entries": {NAMES[k]: round(float(direction[k]), 3) for k in largest},
            }
        )
    return {
        "edge_strain_rms": strain,
        "misfit": found.misfit,
        "correction_m": found.correction,
        "unexplained_at_given_shape": found.unexplained,
        "identifiable_combinations": int(found.identifiable.sum()),
        "entries": entries,
        "combinations": combinations,
    }
