"""Static equilibrium of a cloth that may rest on itself: Newton with a barrier, and gradients through the contacts.

The way down is that of `cusick_bench.sim.engine.statics.descent`. With contacts every step is also cut short of the
first touch (continuous collision detection), so that a cloth laid down without intersections comes to rest without
any. Which equilibrium is found depends on the path: until the net force is a small part of the weight, the steps are
those of a falling cloth. `contact_drop` falls with inertia, as `drop` does; a search from its end finds the equilibrium
that belongs to that fall.

At rest the forces of cloth and contacts balance, F(x, p) + F_c(x) = 0. F_c does not depend on the parameters, hence
dL/dp = lambda . dF/dp with (H + H_c) lambda = dL/dx.

References:
    Li, Ferguson, Schneider, Langlois, Zorin, Panozzo, Jiang, Kaufman. Incremental Potential Contact: intersection- and
        inversion-free, large-deformation dynamics. ACM Transactions on Graphics 39(4), 2020, Algorithm 1.
    Huang, Tozoni, Gjoka, Ferguson, Schneider, Panozzo, Zorin. Differentiable solver for time-dependent deformation
        problems with contact. ACM Transactions on Graphics 43(3), 2024, Section 4 (adjoint through the barrier).
"""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.contact.barrier import ContactForces, SelfContact, smallest_distance
from cusick_bench.sim.contact.drop import check_contact
from cusick_bench.sim.contact.intersections import checked_positions
from cusick_bench.sim.contact.matrix import ContactMatrix
from cusick_bench.sim.engine.cloth_system import ClothSystem
from cusick_bench.sim.engine.parameters import ParameterGradient, Parameters
from cusick_bench.sim.engine.statics.descent import FALLING, descend, first_definite
from cusick_bench.sim.engine.statics.equilibrium import equilibrium_adjoint
from cusick_bench.sim.linear.interface import Factor, NotPositiveDefinite

AT_REST = 0.05  # net force below which the cloth no longer falls, as a fraction of its weight
_NEAR = 1e-2  # net force below which exact contact Hessians are tried first, as a fraction of the weight
_HALVINGS = 3  # a step is halved this often before it is computed again with a larger mu


@dataclass(frozen=True)
class ContactRest:
    """A cloth at rest on its support and on itself (or the best that was reached).

    Attributes:
        positions: Where it rests [m].
        residual: Norm of the free vertices' net force, contacts included, as a fraction of the cloth's weight.
        converged: Residual within tolerance and Hessian positive definite, i.e. a stable rest.
        iterations: Newton steps taken.
        energies: Energy of cloth and contacts after every step [J]; it never rises.
        contacts: The pairs nearer than the thickness, and what they do.
        smallest_distance: Smallest distance between parts that share no vertex [m].
        factor: Factor of the Hessian at `positions`; None if not converged.
    """

    positions: Float[ndarray, "vertices 3"]
    residual: float
    converged: bool
    iterations: int
    energies: list[float]
    contacts: ContactForces
    smallest_distance: float
    factor: Factor | None


@dataclass(frozen=True)
class _State:
    """A configuration with its net forces on the free vertices, its energy and its Hessian's parts."""

    x: Float[ndarray, "vertices 3"]
    force: Float[ndarray, "rows 3"]
    cloth: Float[ndarray, "slots 3 3"]
    contacts: ContactForces
    energy: float


@dataclass(frozen=True, eq=False)
class _TouchingEnergy:
    """Energy of a cloth and of its contacts with itself."""

    system: ClothSystem
    parameters: Parameters
    anchor: Float[ndarray, "vertices 3"]
    contact: SelfContact
    matrix: ContactMatrix

    @property
    def free(self) -> Int[ndarray, "rows"]:
        return self.system.free

    @property
    def mass(self) -> Float[ndarray, "vertices"]:
        return self.parameters.mass

    @property
    def weight(self) -> float:
        return self.system.gravity * float(self.mass.sum())

    def at(self, x: Float[ndarray, "vertices 3"]) -> _State:
        force, cloth, energy = self.system.forces(x, self.anchor, self.parameters, exact=True)
        contacts = self.contact.forces(x)
        return _State(x, (force + contacts.force)[self.free], cloth, contacts, energy + contacts.energy)

    def regularised(self, state: _State, mu: float, residual: float, old: Factor | None) -> tuple[Factor, float]:
        """Factor of H + mu M; contacts are projected to positive-semidefinite Hessians unless near rest."""
        mass = self.mass[self.free]
        if residual < _NEAR and state.contacts.count:
            with suppress(NotPositiveDefinite):
                exact = self.matrix.blocks(state.cloth, state.contacts, project=False)
                return self.matrix.factorise(exact, mu * mass), mu
        blocks = self.matrix.blocks(state.cloth, state.contacts, project=True)
        return first_definite(lambda at_least: self.matrix.factorise(blocks, at_least * mass), mu)

    def stable(self, state: _State, old: Factor | None) -> Factor:
        blocks = self.matrix.blocks(state.cloth, state.contacts, project=False)
        return self.matrix.factorise(blocks, np.zeros(len(self.free)))

    def free_share(self, x: Float[ndarray, "vertices 3"], step: Float[ndarray, "vertices 3"]) -> float:
        return self.contact.free_share(x, step)


def contact_equilibrium(
    system: ClothSystem,
    parameters: Parameters,
    laid: Float[ndarray, "vertices 3"],
    contact: SelfContact,
    *,
    tolerance: float = 1e-9,
    iterations: int = 500,
    start: Float[ndarray, "vertices 3"] | None = None,
) -> ContactRest:
    """Lets a cloth that touches itself come to rest.

    Args:
        system: Cloth and support; its law must derive from an energy.
        parameters: Material.
        laid: Shape in which the cloth is laid down [m]; springs and fixed vertices hold on to it.
        contact: How the cloth touches itself.
        tolerance: Largest net force as a fraction of the weight.
        iterations: Most steps.
        start: Where the search begins [m], for a warm start near a rest (fixed vertices stay where `laid` has them); by
            default the laid-down cloth, which falls from there.

    Returns:
        The rest, with `converged` False where the steps ran out. It has no intersections either way.

    Raises:
        SimulationError: The law has no energy, the contact belongs to another mesh, or the cloth intersects itself at
            the start.
        DrapeDiverged: Energy or Hessian are not finite.
    """
    check_contact(system, contact)
    x = checked_positions(system.mesh, laid if start is None else start).copy()
    x[system.fixed] = laid[system.fixed]
    contact.check_apart(x)
    cold = start is None
    end = descend(
        _TouchingEnergy(system, parameters, laid, contact, ContactMatrix(system)),
        x,
        tolerance=tolerance,
        iterations=iterations,
        mu=FALLING if cold else 0.0,
        falls_above=AT_REST if cold else np.inf,
        halvings=_HALVINGS,
    )
    return ContactRest(
        positions=end.state.x,
        residual=end.residual,
        converged=end.factor is not None,
        iterations=end.iterations,
        energies=end.energies,
        contacts=end.state.contacts,
        smallest_distance=smallest_distance(contact.mesh, end.state.x),
        factor=end.factor,
    )


def contact_equilibrium_adjoint(
    system: ClothSystem, parameters: Parameters, rest: ContactRest, g_x: Float[ndarray, "vertices 3"]
) -> tuple[ParameterGradient, Float[ndarray, "vertices 3"]]:
    """Gradient of a function of the rest positions to all parameters and to the springs' anchors.

    Args:
        system: As in `contact_equilibrium`.
        parameters: As in `contact_equilibrium`.
        rest: A converged rest.
        g_x: Derivative to the rest positions.

    Returns:
        Parameter gradient, and derivative to the anchors of springs and the positions of fixed vertices.

    Raises:
        DrapeDiverged: The rest has not converged.
    """
    return equilibrium_adjoint(system, parameters, rest, g_x, rest.contacts.hessian())
