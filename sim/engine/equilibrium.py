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
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.sparse import csr_array

from cusick_bench.sim.engine.system import DrapeSystem, ParameterGradient, Parameters
from cusick_bench.sim.errors import DrapeDiverged, SimulationError
from cusick_bench.sim.linear.interface import Factor, NotPositiveDefinite

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
class _Point:
    """A configuration with its forces, energy and Hessian; batches of one for the kernels."""

    system: DrapeSystem
    p: Parameters
    anchor: Float[ndarray, "members vertices 3"]
    x: Float[ndarray, "vertices 3"]
    force: Float[ndarray, "rows 3"]
    energy: float
    blocks: Float[ndarray, "members slots 3 3"]
    added: float = 0.0  # mu in the blocks' diagonal

    @classmethod
    def at(cls, system: DrapeSystem, p: Parameters, anchor: ndarray, x: ndarray, storage: ndarray | None) -> "_Point":
        state = system.evaluate(x[None], anchor, p, exact=True)
        blocks = state.matrix(diagonal=system.spring[None], out=storage)
        return cls(system, p, anchor, x, state.force()[0, system.free], float(state.energy()[0]), blocks)

    def moved(self, x: ndarray, storage: ndarray | None = None) -> "_Point":
        """The same cloth elsewhere."""
        return _Point.at(self.system, self.p, self.anchor, x, storage)

    def factor(self, mu: float, old: Factor | None) -> Factor:
        """Factor of H + mu M."""
        self.system.add_diagonal(self.blocks, (mu - self.added) * self.p.mass)
        self.added = mu
        return self.system.linear.factorise(self.blocks[0], out=old)

    def regularised(self, mu: float, old: Factor | None) -> tuple[Factor, float]:
        """Factor of H + mu M, with mu raised until it is positive definite."""
        while True:
            try:
                return self.factor(mu, old), mu
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
    mass, free = parameters.mass[system.free, None], system.free
    weight = system.gravity * parameters.mass.sum()
    point = _Point.at(system, parameters.batch(), anchor[None], start.copy(), None)
    spare = np.zeros_like(point.blocks)  # two sets of blocks take turns
    energies = [point.energy]
    factor: Factor | None = None
    bifurcations, taken, residual = 0, 0, np.inf
    for taken in range(iterations + 1):
        residual = float(np.linalg.norm(point.force) / weight)
        if not np.isfinite(residual) or not np.isfinite(point.energy):
            raise DrapeDiverged(f"Newton step {taken}: forces are no longer finite; check stiffness and density")
        if residual <= tolerance:
            try:
                rest = point.factor(0.0, factor)
                return Equilibrium(point.x, residual, True, taken, bifurcations, energies, rest)
            except NotPositiveDefinite:
                mu = max(mu, 1.0)  # a saddle: fall off it along the next regularised step
                bifurcations += 1
                x = point.x.copy()
                x[free, 2] += 1e-5 * np.sin(np.arange(len(free)))
                point = point.moved(x)
        if taken == iterations:
            break
        while True:
            wanted = mu
            factor, mu = point.regularised(mu, factor)
            bifurcations += int(mu > wanted)
            step = factor.solve(point.force)
            # decrease that the quadratic model (without mu) promises
            promised = 0.5 * float((step * point.force).sum()) + 0.5 * mu * float((mass * step**2).sum())
            x = point.x.copy()
            x[free] += step
            trial = point.moved(x, spare)
            noise = _ROUNDING * max(abs(point.energy), abs(trial.energy))
            agreement = (point.energy - trial.energy) / promised
            if promised <= 10 * noise and np.linalg.norm(trial.force) <= np.linalg.norm(point.force):
                agreement = 1.0
            if agreement > 1e-3:
                break
            mu = max(4 * mu, 4.0)
            if mu > _LARGEST:
                return Equilibrium(point.x, residual, False, taken, bifurcations, energies, None)
        point, spare = trial, point.blocks
        energies.append(point.energy)
        if agreement > 0.75:
            mu = mu / 4 if mu > _SMALLEST else 0.0
        elif agreement < 0.25:
            mu = max(2 * mu, 1.0)
    return Equilibrium(point.x, residual, False, taken, bifurcations, energies, None)


@runtime_checkable
class Rest(Protocol):
    """What the adjoint needs of a rest, with or without contacts."""

    @property
    def positions(self) -> Float[ndarray, "vertices 3"]: ...
    @property
    def residual(self) -> float: ...
    @property
    def factor(self) -> Factor | None: ...


def equilibrium_adjoint(
    system: DrapeSystem,
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
        hessian: Of other energies that act on the cloth, (3 vertices, 3 vertices) [N/m]; of contacts, for one.

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
    if hessian is not None:
        by_x -= (hessian @ multiplier.ravel()).reshape(-1, 3)
    g_held = np.where(system.fixed[:, None], g_x + by_x, 0.0)
    return gradient, g_held + by_anchor
