"""Drops a cloth that may touch itself: the way to the shape from which `contact_equilibrium` finds the rest.

A step of length h goes to the least of the incremental potential

    (x - y)^T M (x - y) / (2 h^2) + E(x) + E_c(x),  y = x_n + h v_n,

with the energy of the cloth E and of its contacts E_c. Where nothing touches, one Newton step with the
positive-semidefinite stiffness is taken, the step of `cusick_bench.sim.engine.dynamics.drop`: a cloth that never
touches itself falls as it does there. Where something touches, no step goes through it or upwards, and Newton goes on
until it may take a whole step.

References:
    Li, Ferguson, Schneider, Langlois, Zorin, Panozzo, Jiang, Kaufman. Incremental Potential Contact: intersection- and
        inversion-free, large-deformation dynamics. ACM Transactions on Graphics 39(4), 2020, Section 3.
"""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.contact.barrier import ContactForces, SelfContact
from cusick_bench.sim.contact.matrix import ContactMatrix
from cusick_bench.sim.engine.cloth_system import ClothSystem
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.errors import DrapeDiverged, SimulationError
from cusick_bench.sim.linear.interface import NotPositiveDefinite

_NEWTON_STEPS = 20  # most Newton steps of a time step
_HALVINGS = 12  # most halvings of a Newton step


def contact_drop(
    system: ClothSystem,
    parameters: Parameters,
    laid: Float[ndarray, "vertices 3"],
    contact: SelfContact,
    *,
    steps: int,
    step_seconds: float,
) -> Float[ndarray, "vertices 3"]:
    """Drops the cloth from rest, without letting it pass through itself.

    Args:
        system: Cloth and support; its law must derive from an energy.
        parameters: Material.
        laid: Shape in which the cloth is laid down [m]; springs and fixed vertices hold on to it.
        contact: How the cloth touches itself.
        steps: Number of time steps.
        step_seconds: Time step h [s].

    Returns:
        Where it is after the last step [m]. Not differentiable: only the rest that follows is.

    Raises:
        SimulationError: The law has no energy, the contact belongs to another mesh, or the cloth intersects itself at
            the start.
        DrapeDiverged: Forces are no longer finite.
    """
    check_contact(system, contact)
    contact.check_apart(laid)
    matrix = ContactMatrix(system)
    x, velocity = laid.copy(), np.zeros_like(laid)
    for step in range(steps):
        try:
            new = _time_step(matrix, parameters, laid, contact, x, x + step_seconds * velocity, step_seconds)
        except NotPositiveDefinite as error:
            raise DrapeDiverged(f"step {step + 1} of {steps}: {error}; check the stiffness tables") from error
        x, velocity = new, (new - x) / step_seconds
    return x


def check_contact(system: ClothSystem, contact: SelfContact) -> None:
    """Checks that a contact acts on a system.

    Args:
        system: Cloth and support.
        contact: How the cloth touches itself.

    Raises:
        SimulationError: The system's law has no energy, or the contact was made for another mesh.
    """
    system.require_energy("contact")
    if contact.mesh is not system.mesh:
        raise SimulationError("the contact was made for another mesh than the system's; make it with system.mesh")


def _time_step(
    matrix: ContactMatrix,
    parameters: Parameters,
    laid: ndarray,
    contact: SelfContact,
    x: ndarray,
    target: ndarray,
    h: float,
) -> ndarray:
    """Minimises the incremental potential from x."""
    system, inertia = matrix.system, parameters.mass / h**2
    free = system.free
    step = np.zeros_like(x)

    def potential(at: ndarray, contacts: ContactForces) -> float:
        _, _, energy = system.forces(at, laid, parameters, exact=True)
        return energy + contacts.energy + 0.5 * float((inertia[:, None] * (at - target) ** 2).sum())

    contacts, before = contact.forces(x), None
    for newton in range(_NEWTON_STEPS):
        force, cloth, _ = system.forces(x, laid, parameters, exact=False)
        force += contacts.force - inertia[:, None] * (x - target)
        if not np.isfinite(force[free]).all():
            raise DrapeDiverged(f"forces are no longer finite; use a shorter step than {h} s or check the material")
        factor = matrix.factorise(matrix.blocks(cloth, contacts, project=True), inertia[free])
        step[free] = factor.solve(force[free])
        share = contact.free_share(x, step)
        new = x + share * step
        new_contacts = contact.forces(new)
        if newton == 0 and share == 1.0 and contacts.count == new_contacts.count == 0:
            return new
        before = potential(x, contacts) if before is None else before
        for _ in range(_HALVINGS):
            after = potential(new, new_contacts)
            if after <= before:
                break
            share *= 0.5
            new = x + share * step
            new_contacts = contact.forces(new)
        else:
            return x
        x, contacts, before = new, new_contacts, after
        if share == 1.0:
            break
    return x
