"""A drape as static equilibrium: Newton on the energy with its exact Hessian, gradients by implicit differentiation.

Where the Hessian is not positive definite or a full step does not lower the energy enough, mass times mu is added to
it: an implicit Euler step of length 1/sqrt(mu) without memory of velocity (pseudo-transient continuation). Far from
rest the cloth falls; near rest mu -> 0 and the steps are Newton's.

At rest F(x, p) = 0, hence dL/dp = lambda . dF/dp with H lambda = dL/dx, H = -dF/dx: one more solve.

References:
    Kelley, Keyes. Convergence analysis of pseudo-transient continuation. SIAM J. Numerical Analysis 35(2), 1998.
    Nocedal, Wright. Numerical Optimization, 2nd edition, 2006, Chapter 4 (agreement of model and function).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.errors import DrapeDiverged, SimulationError
from cusick_bench.sim.linear import Factor, NotPositiveDefinite
from cusick_bench.sim.system import DrapeSystem, ParameterGradient, Parameters

FALLING = 400.0  # [1/s2] mu of a cold start: pseudo steps of 0.05 s
_SMALLEST = 0.1  # [1/s2] below it mu is dropped
_LARGEST = 1e9
_ROUNDING = 1e-13  # energy changes below this fraction of the energy are noise


@dataclass(frozen=True)
class Equilibrium:
    """A cloth at rest (or the best that was reached).

    Attributes:
        positions: Where it rests [m].
        residual: Norm of the free vertices' net force as a fraction of the cloth's weight.
        converged: Residual within tolerance and Hessian positive definite, i.e. a stable rest.
        iterations: Newton steps taken.
        energies: Potential energy after every step [J]; it never rises.
        factor: Factor of the Hessian at `positions`; None if not converged.
    """

    positions: Float[ndarray, "vertices 3"]
    residual: float
    converged: bool
    iterations: int
    energies: list[float]
    factor: Factor | None


def _regularised(system: DrapeSystem, blocks: ndarray, mass: ndarray, mu: float) -> tuple[Factor, float]:
    """Factor of H + mu M, with mu raised until it is positive definite."""
    added = 0.0
    while True:
        system.add_diagonal(blocks, (mu - added) * mass)
        added = mu
        try:
            return system.linear.factorise(blocks), mu
        except NotPositiveDefinite:
            mu = max(4 * mu, 1.0)
            if mu > _LARGEST:
                raise DrapeDiverged("the Hessian stays indefinite however large the regularisation") from None


def equilibrium(
    system: DrapeSystem,
    parameters: Parameters,
    start: Float[ndarray, "vertices 3"],
    anchor: Float[ndarray, "vertices 3"],
    *,
    tolerance: float = 1e-9,
    iterations: int = 500,
    mu: float = FALLING,
) -> Equilibrium:
    """Lets the cloth come to rest.

    Args:
        system: Cloth and support; its law must derive from an energy.
        parameters: Material.
        start: Where the search begins [m]; near a rest for a warm start.
        anchor: Where springs hold [m]; fixed vertices stay where `start` has them.
        tolerance: Largest net force as a fraction of the weight.
        iterations: Most steps.
        mu: First regularisation [1/s2]: `FALLING` for a cold start, 0 for a warm one.

    Returns:
        The rest, with `converged` False where the steps ran out.

    Raises:
        SimulationError: The law has no energy.
        DrapeDiverged: Energy or Hessian are not finite.
    """
    if system.law != "paper":
        raise SimulationError(
            f"equilibrium needs a law that derives from an energy, got {system.law!r}; use law 'paper', or mode 'drop'"
        )
    mass, free = parameters.mass, system.free
    weight = system.gravity * mass.sum()
    x = start.copy()
    force, blocks, energy = system.forces(x, anchor, parameters, exact=True)
    energies = [energy]
    taken, residual = 0, np.inf
    for taken in range(iterations + 1):
        residual = float(np.linalg.norm(force[free]) / weight)
        if not np.isfinite(residual) or not np.isfinite(energy):
            raise DrapeDiverged(f"Newton step {taken}: forces are no longer finite; check stiffness and density")
        if residual <= tolerance:
            try:
                return Equilibrium(x, residual, True, taken, energies, system.linear.factorise(blocks.copy()))
            except NotPositiveDefinite:
                mu = max(mu, 1.0)  # a saddle: fall off it along the next regularised step
                x = x.copy()
                x[free, 2] += 1e-5 * np.sin(np.arange(len(free)))
                force, blocks, energy = system.forces(x, anchor, parameters, exact=True)
        if taken == iterations:
            break
        while True:
            factor, mu = _regularised(system, blocks.copy(), mass, mu)
            step = factor.solve(force[free])
            # decrease that the quadratic model (without mu) promises
            slope = float((step * force[free]).sum())
            promised = 0.5 * slope + 0.5 * mu * float((mass[free, None] * step**2).sum())
            trial = x.copy()
            trial[free] += step
            new_force, new_blocks, new_energy = system.forces(trial, anchor, parameters, exact=True)
            noise = _ROUNDING * max(abs(energy), abs(new_energy))
            agreement = (energy - new_energy) / promised
            if promised <= 10 * noise and np.linalg.norm(new_force[free]) <= np.linalg.norm(force[free]):
                agreement = 1.0
            if agreement > 1e-3:
                break
            mu = max(4 * mu, 4.0)
            if mu > _LARGEST:
                return Equilibrium(x, residual, False, taken, energies, None)
        x, force, blocks, energy = trial, new_force, new_blocks, new_energy
        energies.append(energy)
        if agreement > 0.75:
            mu = mu / 4 if mu > _SMALLEST else 0.0
        elif agreement < 0.25:
            mu = max(2 * mu, 1.0)
    return Equilibrium(x, residual, False, taken, energies, None)


def equilibrium_adjoint(
    system: DrapeSystem, parameters: Parameters, rest: Equilibrium, g_x: Float[ndarray, "vertices 3"]
) -> tuple[ParameterGradient, Float[ndarray, "vertices 3"]]:
    """Gradient of a function of the rest positions to all parameters and to the held vertices.

    Args:
        system: As in `equilibrium`.
        parameters: As in `equilibrium`.
        rest: A converged rest.
        g_x: Derivative to the rest positions.

    Returns:
        Parameter gradient, and derivative to the anchors of springs and the positions of fixed vertices (zero at
        free vertices without a spring: where the cloth starts does not matter while it comes to the same rest).

    Raises:
        DrapeDiverged: The rest has not converged.
    """
    if rest.factor is None:
        raise DrapeDiverged(f"no gradient: the drape has not converged (residual {rest.residual:.2g} of the weight)")
    gradient = ParameterGradient.zeros(system)
    multiplier = np.zeros_like(g_x)
    multiplier[system.free] = rest.factor.solve(g_x[system.free])
    by_x, by_anchor = system.adjoint(
        rest.positions, multiplier, np.zeros_like(g_x), parameters, gradient, force_factor=1.0, stiffness_factor=0.0
    )
    g_held = np.where(system.fixed[:, None], g_x + by_x, 0.0)
    return gradient, g_held + by_anchor
