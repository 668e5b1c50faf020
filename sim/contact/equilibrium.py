"""Static equilibrium of a cloth that may rest on itself: Newton with a barrier, and gradients through the contacts.

As in `cusick_bench.sim.engine.equilibrium`, mass times mu regularises the Hessian: an implicit Euler step of length
1/sqrt(mu) without memory of velocity, which becomes Newton's step near rest. With contacts every step is also cut short
of the first touch (continuous collision detection) and never raises the energy, so that a cloth laid down without
intersections comes to rest without any. The path decides where it rests: until the net force is a small part of the
weight the steps stay those of a falling cloth. `contact_drop` falls with memory of velocity, as `drop` does; a search
from its end finds the rest that belongs to that fall.

At rest the forces of cloth and contacts balance, F(x, p) + F_c(x) = 0. F_c does not depend on the parameters, hence
dL/dp = lambda . dF/dp with (H + H_c) lambda = dL/dx.

References:
    Li, Ferguson, Schneider, Langlois, Zorin, Panozzo, Jiang, Kaufman. Incremental Potential Contact: intersection- and
        inversion-free, large-deformation dynamics. ACM Transactions on Graphics 39(4), 2020, Algorithm 1.
    Huang, Tozoni, Gjoka, Ferguson, Schneider, Panozzo, Zorin. Differentiable solver for time-dependent deformation
        problems with contact. ACM Transactions on Graphics 43(3), 2024, Section 4 (adjoint through the barrier).
    Kelley, Keyes. Convergence analysis of pseudo-transient continuation. SIAM J. Numerical Analysis 35(2), 1998.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.contact.barrier import ContactForces, SelfContact, smallest_distance
from cusick_bench.sim.contact.drop import check_contact
from cusick_bench.sim.contact.intersections import checked_positions
from cusick_bench.sim.contact.matrix import ContactMatrix
from cusick_bench.sim.engine.equilibrium import FALLING, equilibrium_adjoint
from cusick_bench.sim.engine.system import DrapeSystem, ParameterGradient, Parameters
from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.sim.linear.interface import Factor, NotPositiveDefinite

AT_REST = 0.05  # net force below which the cloth no longer falls, as a fraction of its weight
_NEAR = 1e-2  # net force below which exact contact Hessians are tried first, as a fraction of the weight
_SMALLEST = 0.1  # [1/s2] below it mu is dropped
_LARGEST = 1e9
_ROUNDING = 1e-13  # energy changes below this fraction of the energy are noise
_HALVINGS = 3  # a step is halved this often before it is computed again with a larger mu
_NUDGE = 1e-5  # [m] kick off a saddle


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
    """Forces and energy of cloth and contacts at a configuration."""

    x: Float[ndarray, "vertices 3"]
    force: Float[ndarray, "vertices 3"]
    cloth: Float[ndarray, "slots 3 3"]
    contacts: ContactForces
    energy: float


@dataclass(frozen=True)
class _Descent:
    """What stays the same while a cloth comes to rest."""

    system: DrapeSystem
    parameters: Parameters
    anchor: Float[ndarray, "vertices 3"]
    contact: SelfContact
    matrix: ContactMatrix
    weight: float

    def state(self, x: ndarray) -> _State:
        force, cloth, energy = self.system.forces(x, self.anchor, self.parameters, exact=True)
        contacts = self.contact.forces(x)
        return _State(x, force + contacts.force, cloth, contacts, energy + contacts.energy)

    def residual(self, state: _State) -> float:
        return float(np.linalg.norm(state.force[self.system.free]) / self.weight)

    def stable(self, state: _State) -> Factor:
        """Factor of the exact Hessian; raises NotPositiveDefinite at a saddle."""
        blocks = self.matrix.blocks(state.cloth, state.contacts, project=False)
        return self.matrix.factorise(blocks, np.zeros(len(self.system.free)))

    def nudged(self, state: _State) -> _State:
        """The cloth a little off a saddle, for the next regularised step to fall off."""
        kick = np.zeros_like(state.x)
        kick[self.system.free, 2] = _NUDGE * np.sin(np.arange(len(self.system.free)))
        return self.state(state.x + self.contact.free_share(state.x, kick) * kick)

    def regularised(self, state: _State, mu: float, *, near: bool) -> tuple[Factor, float]:
        """Factor of H + mu M, with contacts projected unless near rest, and mu raised until it is positive definite."""
        mass = self.parameters.mass[self.system.free]
        if near and state.contacts.count:
            try:
                exact = self.matrix.blocks(state.cloth, state.contacts, project=False)
                return self.matrix.factorise(exact, mu * mass), mu
            except NotPositiveDefinite:
                pass
        blocks = self.matrix.blocks(state.cloth, state.contacts, project=True)
        while True:
            try:
                return self.matrix.factorise(blocks, mu * mass), mu
            except NotPositiveDefinite:
                mu = max(4 * mu, 1.0)
                if mu > _LARGEST:
                    raise DrapeDiverged("the Hessian stays indefinite however large the regularisation") from None

    def searched(self, state: _State, step: ndarray, mu: float) -> tuple[_State, float, float] | None:
        """Follows a step as far as nothing touches and the energy falls as promised.

        Returns:
            New state, share of the step taken, and fall of the energy in terms of what the quadratic model (without
            mu) promises; None where the energy does not fall.
        """
        free, mass = self.system.free, self.parameters.mass
        force = state.force[free]
        slope = float((step[free] * force).sum())
        curvature = slope - mu * float((mass[free, None] * step[free] ** 2).sum())
        share = self.contact.free_share(state.x, step)
        for _ in range(_HALVINGS + 1):
            new = self.state(state.x + share * step)
            promised = share * slope - 0.5 * share**2 * curvature
            noise = _ROUNDING * max(abs(state.energy), abs(new.energy))
            if np.isfinite(new.energy):
                if promised <= 10 * noise and np.linalg.norm(new.force[free]) <= np.linalg.norm(force):
                    return new, share, 1.0
                agreement = (state.energy - new.energy) / promised
                if agreement > 1e-3:
                    return new, share, agreement
            share *= 0.5
        return None


def contact_equilibrium(
    system: DrapeSystem,
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
    descent = _descent(system, parameters, laid, contact)
    x = checked_positions(system.mesh, laid if start is None else start).copy()
    x[system.fixed] = laid[system.fixed]
    contact.check_apart(x)
    falling = start is None
    mu = FALLING if falling else 0.0
    state = descent.state(x)
    energies = [state.energy]
    factor, taken = None, 0
    for taken in range(iterations + 1):
        residual = descent.residual(state)
        if not np.isfinite(residual) or not np.isfinite(state.energy):
            raise DrapeDiverged(f"Newton step {taken}: forces are no longer finite; check stiffness and density")
        falling = falling and residual > AT_REST
        if residual <= tolerance:
            try:
                factor = descent.stable(state)
                break
            except NotPositiveDefinite:
                mu, state = max(mu, 1.0), descent.nudged(state)
        if taken == iterations:
            break
        moved = _moved(descent, state, mu, near=residual < _NEAR)
        if moved is None:
            break
        state, mu = moved
        mu = max(mu, FALLING) if falling else mu
        energies.append(state.energy)
    return ContactRest(
        positions=state.x,
        residual=descent.residual(state),
        converged=factor is not None,
        iterations=taken,
        energies=energies,
        contacts=state.contacts,
        smallest_distance=smallest_distance(contact.mesh, state.x),
        factor=factor,
    )


def _descent(system: DrapeSystem, parameters: Parameters, laid: ndarray, contact: SelfContact) -> _Descent:
    check_contact(system, contact)
    weight = system.gravity * float(parameters.mass.sum())
    return _Descent(system, parameters, laid, contact, ContactMatrix(system), weight)


def _moved(descent: _Descent, state: _State, mu: float, *, near: bool) -> tuple[_State, float] | None:
    """One step down, and the mu of the next; None where no step goes down."""
    free = descent.system.free
    step = np.zeros_like(state.x)
    while True:
        factor, mu = descent.regularised(state, mu, near=near)
        step[free] = factor.solve(state.force[free])
        found = descent.searched(state, step, mu)
        if found is not None:
            break
        mu = max(4 * mu, 4.0)
        if mu > _LARGEST:
            return None
    new, share, agreement = found
    if agreement > 0.75 and share == 1.0:
        mu = mu / 4 if mu > _SMALLEST else 0.0
    elif agreement < 0.25:
        mu = max(2 * mu, 1.0)
    return new, mu


def contact_equilibrium_adjoint(
    system: DrapeSystem, parameters: Parameters, rest: ContactRest, g_x: Float[ndarray, "vertices 3"]
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
