"""A drape as static equilibrium: Newton on the energy with its exact Hessian, gradients by implicit differentiation.

The way down is that of `descent`. At rest F(x, p) = 0, hence dL/dp = lambda . dF/dp with
H lambda = dL/dx, H = -dF/dx: one more solve.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.sparse import csr_array

from cusick_bench.sim.engine.cloth_system import ClothSystem
from cusick_bench.sim.engine.parameters import ParameterGradient, Parameters
from cusick_bench.sim.engine.statics.descent import FALLING, descend, first_definite
from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.sim.linear.interface import Factor


@dataclass(frozen=True)
class Equilibrium:
    """A cloth at rest (or the best that was reached).

    Attributes:
        positions: Where it rests [m].
        residual: Norm of the free vertices' net force as a fraction of the cloth's weight.
        converged: Residual within tolerance and Hessian positive definite, i.e. a stable rest.
        iterations: Newton steps taken.
        bifurcations: How often the Hessian was found indefinite: from a warm start, a sign of a lost branch.
        energies: Potential energy after every step [J]; it never rises.
        factor: Factor of the Hessian at `positions`; None if not converged.
    """

    positions: Float[ndarray, "vertices 3"]
    residual: float
    converged: bool
    iterations: int
    bifurcations: int
    energies: list[float]
    factor: Factor | None


@dataclass(eq=False)
class _State:
    """A configuration with its net forces on the free vertices, its energy and its Hessian; a batch of one."""

    x: Float[ndarray, "vertices 3"]
    force: Float[ndarray, "rows 3"]
    energy: float
    blocks: Float[ndarray, "members slots 3 3"]
    mu: float = 0.0  # mass times mu is part of the blocks' diagonal


@dataclass(frozen=True, eq=False)
class _ClothEnergy:
    """Energy of a cloth that may pass through itself."""

    system: ClothSystem
    parameters: Parameters
    anchor: Float[ndarray, "vertices 3"]

    @property
    def free(self) -> Int[ndarray, "rows"]:
        return self.system.free

    @property
    def mass(self) -> Float[ndarray, "vertices"]:
        return self.parameters.mass

    @property
    def weight(self) -> float:
        return self.system.gravity * self.mass.sum()

    def at(self, x: Float[ndarray, "vertices 3"]) -> _State:
        system = self.system
        elements = system.evaluate(x[None], self.anchor[None], self.parameters.batch(), exact=True)
        blocks = elements.matrix(diagonal=system.spring[None])
        return _State(x, elements.force()[0, system.free], float(elements.energy()[0]), blocks)

    def regularised(self, state: _State, mu: float, residual: float, old: Factor | None) -> tuple[Factor, float]:
        return first_definite(lambda at_least: self._factor(state, at_least, old), mu)

    def stable(self, state: _State, old: Factor | None) -> Factor:
        return self._factor(state, 0.0, old)

    def free_share(self, x: Float[ndarray, "vertices 3"], step: Float[ndarray, "vertices 3"]) -> float:
        return 1.0

    def _factor(self, state: _State, mu: float, old: Factor | None) -> Factor:
        """Factor of H + mu M."""
        self.system.add_diagonal(state.blocks, (mu - state.mu) * self.mass)
        state.mu = mu
        return self.system.linear.factorise(state.blocks[0], out=old)


def equilibrium(
    system: ClothSystem,
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
    system.require_energy("an equilibrium")
    end = descend(
        _ClothEnergy(system, parameters, anchor), start.copy(), tolerance=tolerance, iterations=iterations, mu=mu
    )
    return Equilibrium(
        end.state.x, end.residual, end.factor is not None, end.iterations, end.bifurcations, end.energies, end.factor
    )


@runtime_checkable
class Rest(Protocol):
    """Data of an equilibrium that the adjoint needs, with or without contacts."""

    @property
    def positions(self) -> Float[ndarray, "vertices 3"]: ...
    @property
    def residual(self) -> float: ...
    @property
    def factor(self) -> Factor | None: ...


def equilibrium_adjoint(
    system: ClothSystem,
    parameters: Parameters,
    rest: Rest,
    g_x: Float[ndarray, "vertices 3"],
    hessian: csr_array | None = None,
) -> tuple[ParameterGradient, Float[ndarray, "vertices 3"]]:
    """Gradient of a function of the rest positions to all parameters and to the held vertices.

    Args:
        system: As in `equilibrium`.
        parameters: As in `equilibrium`.
        rest: A converged rest.
        g_x: Derivative to the rest positions.
        hessian: Hessian of other energies that act on the cloth, (3 vertices, 3 vertices) [N/m]; of contacts, for one.

    Returns:
        Parameter gradient, and derivative to the anchors of springs and the positions of fixed vertices (zero at
        free vertices without a spring: where the cloth starts does not matter while it comes to the same rest).

    Raises:
        DrapeDiverged: The rest has not converged.
    """
    if rest.factor is None:
        raise DrapeDiverged(f"no gradient: the drape has not converged (residual {rest.residual:.2g} of the weight)")
    gradient = system.zero_gradient()
    multiplier = np.zeros_like(g_x)
    multiplier[system.free] = rest.factor.solve(g_x[system.free])
    by_x, by_anchor = system.adjoint(
        rest.positions, multiplier, np.zeros_like(g_x), parameters, gradient, force_factor=1.0, stiffness_factor=0.0
    )
    if hessian is not None:
        by_x -= (hessian @ multiplier.ravel()).reshape(-1, 3)
    g_held = np.where(system.fixed[:, None], g_x + by_x, 0.0)
    return gradient, g_held + by_anchor
