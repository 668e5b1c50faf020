"""A drape by dropping the cloth: linearly implicit Euler from the shape in which it was laid down.

Per step: (M + h^2 K) v' = M v + h F, x' = x + h v', with F and the positive-semidefinite stiffness K at x (the paper's
Eq. 3 written for the new velocity). The discrete adjoint walks back through the same steps: with
g = g_v' + h g_x' and (M + h^2 K) lambda = g, the older gradients are g_v = M lambda and g_x = g_x' + dS/dx with
S = h lambda . F - h^2 lambda . K v'. Memory grows with the states only (or with the kept factors, where they fit).

References:
    Baraff, Witkin. Large steps in cloth simulation. SIGGRAPH 1998.
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Eq. 3.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.sim.linear import Factor, NotPositiveDefinite
from cusick_bench.sim.system import DrapeSystem, ParameterGradient, Parameters

FACTOR_MEMORY = 2**30  # [bytes] factors kept for the adjoint; beyond it they are computed again


@dataclass(frozen=True)
class Rollout:
    """States of a dropped cloth, and what its adjoint needs.

    Attributes:
        positions: x_0 .. x_n [m].
        velocities: v_0 .. v_n [m/s].
        factors: Factor of every step, or None where it has to be computed again.
    """

    positions: Float[ndarray, "states vertices 3"]
    velocities: Float[ndarray, "states vertices 3"]
    factors: list[Factor | None]


def _step_factor(system: DrapeSystem, blocks: ndarray, mass: ndarray, h: float) -> Factor:
    blocks *= h * h
    system.add_diagonal(blocks, mass)
    return system.linear.factorise(blocks)


def drop(
    system: DrapeSystem,
    parameters: Parameters,
    initial: Float[ndarray, "vertices 3"],
    *,
    steps: int,
    step_seconds: float,
    keep_factors: bool = False,
) -> Rollout:
    """Drops the cloth from rest.

    Args:
        system: Cloth and support.
        parameters: Material.
        initial: Shape in which the cloth is laid down [m]; springs and fixed vertices hold on to it.
        steps: Number of steps.
        step_seconds: Step h [s].
        keep_factors: Keep each step's factor for the adjoint, up to `FACTOR_MEMORY`.

    Returns:
        All states.

    Raises:
        DrapeDiverged: The step matrix is not positive definite, or forces are no longer finite.
    """
    h, mass, free = step_seconds, parameters.mass, system.free
    positions = np.empty((steps + 1, *initial.shape))
    velocities = np.zeros_like(positions)
    positions[0] = initial
    factors: list[Factor | None] = []
    kept = 0
    for step in range(steps):
        x, v = positions[step], velocities[step]
        force, blocks, _ = system.forces(x, initial, parameters, exact=False)
        if not np.isfinite(force[free]).all():
            raise DrapeDiverged(
                f"step {step + 1} of {steps}: forces are no longer finite; use a shorter step than {h} s or check "
                "stiffness and density"
            )
        try:
            factor = _step_factor(system, blocks, mass, h)
        except NotPositiveDefinite as error:
            raise DrapeDiverged(f"step {step + 1} of {steps}: {error}; check the stiffness tables") from error
        velocities[step + 1, free] = factor.solve(mass[free, None] * v[free] + h * force[free])
        positions[step + 1] = x + h * velocities[step + 1]
        keep = keep_factors and kept + factor.nbytes <= FACTOR_MEMORY
        kept += factor.nbytes if keep else 0
        factors.append(factor if keep else None)
    return Rollout(positions, velocities, factors)


def drop_adjoint(
    system: DrapeSystem,
    parameters: Parameters,
    rollout: Rollout,
    g_x: Float[ndarray, "vertices 3"],
    *,
    step_seconds: float,
) -> tuple[ParameterGradient, Float[ndarray, "vertices 3"]]:
    """Gradient of a function of the last positions to all parameters and to the initial shape.

    Args:
        system: As in `drop`.
        parameters: As in `drop`.
        rollout: What `drop` returned.
        g_x: Derivative to the last positions.
        step_seconds: As in `drop`.

    Returns:
        Parameter gradient, and derivative to the initial shape (which also anchors springs and fixed vertices).
    """
    h, mass, free = step_seconds, parameters.mass, system.free
    gradient = ParameterGradient.zeros(system)
    g_x = g_x.copy()
    g_v = np.zeros_like(g_x)
    g_anchor = np.zeros_like(g_x)
    multiplier = np.zeros_like(g_x)
    for step in reversed(range(len(rollout.factors))):
        x, v, v_new = rollout.positions[step], rollout.velocities[step], rollout.velocities[step + 1]
        factor = rollout.factors[step]
        if factor is None:
            _, blocks, _ = system.forces(x, rollout.positions[0], parameters, exact=False)
            factor = _step_factor(system, blocks, mass, h)
        multiplier[free] = factor.solve(g_v[free] + h * g_x[free])
        by_x, by_anchor = system.adjoint(
            x, multiplier, v_new, parameters, gradient, force_factor=h, stiffness_factor=h * h
        )
        gradient.mass[:] += (multiplier * (v - v_new)).sum(1)
        g_v = mass[:, None] * multiplier
        # velocity of fixed vertices is zero whatever the parameters; the springs' stiffness is constant
        g_x += by_x
        g_anchor += by_anchor
    return gradient, g_x + g_anchor
