"""Self-contact of a cloth: a smooth barrier keeps its parts apart, and no step may take one through another.

Every vertex-triangle and edge-edge pair without a common vertex that is nearer than the thickness d^ adds

    kappa d^ A b((d / d^)^2),  b(s) = -(1 - s)^2 ln s  for s < 1, else 0

to the energy, with d the distance, A the pair's material area and kappa a pressure [Pa] (Li et al. 2020, Eq. 6, with
the area weights of Li et al. 2023; parallel edges are mollified). b is twice differentiable, infinite at touch and zero
from d^ on, so that forces are exact, continuous gradients. Their slope jumps only where the nearest feature of a pair
changes, e.g. from a triangle's inside to its side; a drape that rests exactly there has one-sided gradients. Two layers
under the pressure p keep about the distance where 2 kappa |db / d(d / d^)| = p, since vertex-triangle and edge-edge
pairs both carry it: 9 kappa at d^ / 2.

Under law `plate` the vertices here are those of the control net, the shell's unknowns. It lies within kappa h^2 / 8 of
the surface (here curvature kappa, edges h; exactly so for a cylinder on equilateral triangles), a tenth of a millimetre
at 50 1/m and 4 mm: the distance of layers that rest on each other is uncertain by that much.

Distances, their derivatives and the continuous collision test come from the IPC toolkit (`ipctk`, MIT licence), which
is imported on first use.

References:
    Li, Ferguson, Schneider, Langlois, Zorin, Panozzo, Jiang, Kaufman. Incremental Potential Contact: intersection- and
        inversion-free, large-deformation dynamics. ACM Transactions on Graphics 39(4), 2020.
    Li, Ferguson, Schneider, Langlois, Zorin, Panozzo, Jiang, Kaufman. Convergent Incremental Potential Contact.
        arXiv:2307.15908, 2023.
    Li, Kaufman, Jiang. Codimensional Incremental Potential Contact. ACM Transactions on Graphics 40(4), 2021, Section 4
        (additive continuous collision detection).
"""

import importlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.contact.intersections import checked_positions, intersections
from cusick_bench.sim.errors import SimulationError

THICKNESS = 1e-3  # [m] distance below which contact acts
STIFFNESS = 100.0  # [Pa] kappa: folds that press with up to 1 kPa keep d^ / 2 apart, a hundred times a cloth's weight
_KEPT = 0.1  # share of the way to the first touch that every step leaves


def _toolkit() -> Any:
    """The IPC toolkit, on one thread: its sums over several have no fixed order."""
    try:
        ipctk = importlib.import_module("ipctk")
    except ImportError as error:
        raise SimulationError(
            "self-contact needs the package ipctk; install it with: pip install 'cusick-bench[contact]'"
        ) from error
    ipctk.set_num_threads(1)
    return ipctk


def _collision_mesh(mesh: Mesh) -> Any:
    return _toolkit().CollisionMesh(mesh.flat, mesh.edges.astype(np.int32), mesh.faces.astype(np.int32))


def smallest_distance(mesh: Mesh, x: Float[ndarray, "vertices 3"]) -> float:
    """Smallest distance between two parts of the cloth that share no vertex [m].

    Of a cloth that passes through itself it says little (the nearest sides may be far from the crossing): see
    `cusick_bench.sim.contact.intersections`.

    Args:
        mesh: The cloth.
        x: Positions [m].

    Returns:
        The distance.

    Raises:
        SimulationError: Positions of another mesh or not finite, or the package ipctk is missing.
    """
    return _smallest_distance(_collision_mesh(mesh), mesh, checked_positions(mesh, x))


def _smallest_distance(collision_mesh: Any, mesh: Mesh, x: ndarray) -> float:
    near = _toolkit().NormalCollisions()
    size = float(np.linalg.norm(np.ptp(x, axis=0)))
    reach = 0.1 * float(np.linalg.norm(x[mesh.edges[:, 0]] - x[mesh.edges[:, 1]], axis=1).mean())
    while reach < size:  # the search is quick where few pairs are within reach
        near.build(collision_mesh, x, reach)
        if not near.empty():
            return float(np.sqrt(near.compute_minimum_distance(collision_mesh, x)))
        reach *= 2
    return size


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Contacts at one configuration.

    Attributes:
        contact: What they belong to.
        x: Positions [m].
        pairs: The pairs nearer than the thickness (an `ipctk.NormalCollisions`).
        force: Force on every vertex [N].
        energy: Barrier energy [J].
    """

    contact: "SelfContact"
    x: Float[ndarray, "vertices 3"]
    pairs: Any
    force: Float[ndarray, "vertices 3"]
    energy: float

    @property
    def count(self) -> int:
        """Number of pairs in contact."""
        return len(self.pairs)

    def hessian(self, *, project: bool = False) -> sparse.csr_array:
        """Second derivative of the energy, rows 3 v + axis [N/m].

        Args:
            project: Take only the positive-semidefinite part of every pair's Hessian.

        Returns:
            Symmetric sparse matrix over all coordinates of all vertices.
        """
        method = _toolkit().PSDProjectionMethod
        chosen = method.CLAMP if project else method.NONE
        # The matrix is symmetric: its compressed columns are compressed rows.
        columns = self.contact.potential.hessian(self.pairs, self.contact.collision_mesh, self.x, chosen)
        return sparse.csr_array((columns.data, columns.indices, columns.indptr), shape=columns.shape)

    def couplings(self) -> Int[ndarray, "couplings 2"]:
        """Vertices that the pairs couple, each coupling once or more."""
        edges, faces = self.contact.collision_mesh.edges, self.contact.collision_mesh.faces
        stencils = np.array([pair.vertex_ids(edges, faces) for pair in self.pairs], np.int64).reshape(-1, 4)
        couplings = np.concatenate([stencils[:, (a, b)] for a in range(4) for b in range(a)])
        return couplings[(couplings >= 0).all(1)]


@dataclass(frozen=True, eq=False)
class SelfContact:
    """Frictionless contact of a cloth with itself.

    Attributes:
        mesh: The cloth.
        thickness: d^, distance below which parts repel each other [m]; less than the flat mesh's own smallest distance
            between parts without a common vertex, or neighbours would repel each other.
        stiffness: kappa, scale of the contact pressure [Pa].

    Raises:
        SimulationError: A value out of range, or the package ipctk is missing.
    """

    mesh: Mesh
    thickness: float = THICKNESS
    stiffness: float = STIFFNESS

    def __post_init__(self) -> None:
        for name, unit in (("thickness", "m"), ("stiffness", "Pa")):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise SimulationError(f"contact {name} must be > 0 and finite, got {value} {unit}")
        finest = _smallest_distance(self.collision_mesh, self.mesh, self.mesh.flat)
        if self.thickness >= finest:
            raise SimulationError(
                f"contact thickness must be less than {finest:.3g} m, the smallest distance between parts of the flat "
                f"mesh that share no vertex, got {self.thickness:g} m; take a smaller thickness or a coarser mesh"
            )

    def __getstate__(self) -> dict[str, Any]:
        """The fields alone, for other processes: the toolkit's objects are made again there."""
        return {"mesh": self.mesh, "thickness": self.thickness, "stiffness": self.stiffness}

    @cached_property
    def collision_mesh(self) -> Any:
        """The cloth as an `ipctk.CollisionMesh`."""
        return _collision_mesh(self.mesh)

    @cached_property
    def potential(self) -> Any:
        """The barrier as an `ipctk.BarrierPotential`, in physical units."""
        return _toolkit().BarrierPotential(self.thickness, self.stiffness, True)

    def forces(self, x: Float[ndarray, "vertices 3"]) -> ContactForces:
        """Contacts, their forces and energy at a configuration without intersections.

        Args:
            x: Positions [m].
        """
        pairs = self._pairs(x, self.thickness)
        energy = float(self.potential(pairs, self.collision_mesh, x))
        gradient = self.potential.gradient(pairs, self.collision_mesh, x)
        return ContactForces(self, x, pairs, -gradient.reshape(-1, 3), energy)

    def couplings(self, x: Float[ndarray, "vertices 3"], reach: float) -> Int[ndarray, "couplings 2"]:
        """Pairs of vertices that belong to parts near each other.

        Args:
            x: Positions [m].
            reach: Distance below which parts couple [m].

        Returns:
            Pairs of vertex indices.
        """
        return ContactForces(self, x, self._pairs(x, reach), np.zeros_like(x), 0.0).couplings()

    def free_share(self, x: Float[ndarray, "vertices 3"], step: Float[ndarray, "vertices 3"]) -> float:
        """Largest share of a straight step, from 0 to 1, that the cloth can take without touching itself.

        Args:
            x: Positions, free of intersections [m].
            step: Displacements [m].

        Returns:
            Share in (0, 1]; 1 where the whole step is free.
        """
        ipctk = _toolkit()
        narrow = ipctk.AdditiveCCD(conservative_rescaling=1 - _KEPT)
        return float(
            ipctk.compute_collision_free_stepsize(self.collision_mesh, x, x + step, 0.0, narrow_phase_ccd=narrow)
        )

    def check_apart(self, x: Float[ndarray, "vertices 3"]) -> None:
        """Checks that contact can start from a shape.

        Args:
            x: Positions [m].

        Raises:
            SimulationError: Positions of another mesh or not finite, or the cloth passes through itself.
        """
        count = intersections(self.mesh, checked_positions(self.mesh, x))
        if count:
            raise SimulationError(
                f"contact must start from a shape without intersections, got {count} edges through triangles; start "
                "from the laid-down cloth"
            )

    def _pairs(self, x: ndarray, reach: float) -> Any:
        pairs = _toolkit().NormalCollisions()
        pairs.use_area_weighting = True
        pairs.build(self.collision_mesh, x, reach)
        return pairs
