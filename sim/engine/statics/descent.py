"""Newton's method on an energy: the one descent to rest, of a cloth by itself and of one that touches itself.

Where the Hessian H is not positive definite or a full step does not lower the energy enough, mass times mu is added to
it: an implicit Euler step of length 1/sqrt(mu) without memory of velocity (pseudo-transient continuation). Far from
rest the cloth falls; near rest mu -> 0 and the steps are Newton's.

A step s of H + mu M is compared with the quadratic model of the energy without mu, which predicts a decrease of
a (1 - a/2) F . s + a^2 mu s . M s / 2 for the share a of the step. The ratio of the actual to the predicted decrease,
the agreement, decides whether the step is accepted and how mu changes.

References:
    Kelley, Keyes. Convergence analysis of pseudo-transient continuation. SIAM J. Numerical Analysis 35(2), 1998.
    Nocedal, Wright. Numerical Optimization, 2nd edition, 2006, Chapter 4 (agreement of model and function).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.sim.linear.interface import Factor, NotPositiveDefinite

FALLING = 400.0  # [1/s2] mu of a cold start: pseudo steps of 0.05 s
_SMALLEST = 0.1  # [1/s2] mu below which it is set to 0
_LARGEST = 1e9  # [1/s2] mu beyond which the descent fails
_ROUNDING = 1e-13  # relative changes of the energy below this are rounding
_NUDGE = 1e-5  # [m] displacement by which a saddle is left
_ACCEPTED = 1e-3  # least agreement of a step that is accepted
_GOOD, _POOR = 0.75, 0.25  # agreements above which mu shrinks and below which it grows


@runtime_checkable
class RestState(Protocol):
    """A configuration with its energy and net forces."""

    @property
    def x(self) -> Float[ndarray, "vertices 3"]:
        """Positions [m]."""
        ...

    @property
    def force(self) -> Float[ndarray, "rows 3"]:
        """Net forces on the free vertices [N]."""
        ...

    @property
    def energy(self) -> float:
        """Potential energy [J]."""
        ...


S = TypeVar("S", bound=RestState)


@runtime_checkable
class Landscape(Protocol[S]):
    """The energy that a cloth descends, as a function of its positions."""

    @property
    def free(self) -> Int[ndarray, "rows"]:
        """Indices of the vertices that move."""
        ...

    @property
    def mass(self) -> Float[ndarray, "vertices"]:
        """Vertex masses [kg]."""
        ...

    @property
    def weight(self) -> float:
        """Weight of the cloth [N], the unit of residuals."""
        ...

    def at(self, x: Float[ndarray, "vertices 3"]) -> S:
        """Energy and forces at positions.

        Args:
            x: Positions [m].

        Returns:
            The state there.
        """
        ...

    def regularised(self, state: S, mu: float, residual: float, old: Factor | None) -> tuple[Factor, float]:
        """Factor of H + mu M, or of a positive-definite stand-in for H, with mu raised until there is one.

        Args:
            state: Where the cloth is.
            mu: Least regularisation [1/s2].
            residual: Net force as a fraction of the weight.
            old: Factor whose storage may be used again.

        Returns:
            The factor, and the mu that it has.

        Raises:
            DrapeDiverged: No mu is large enough.
        """
        ...

    def stable(self, state: S, old: Factor | None) -> Factor:
        """Factor of the Hessian itself.

        Args:
            state: Where the cloth is.
            old: Factor whose storage may be used again.

        Returns:
            The factor.

        Raises:
            NotPositiveDefinite: The state is a saddle.
        """
        ...

    def free_share(self, x: Float[ndarray, "vertices 3"], step: Float[ndarray, "vertices 3"]) -> float:
        """Share of a step that may be taken.

        Args:
            x: Positions before [m].
            step: Displacements [m].

        Returns:
            Share in (0, 1].
        """
        ...


@dataclass(frozen=True)
class Descent(Generic[S]):
    """Result of a descent.

    Attributes:
        state: The last state.
        residual: Norm of its net forces as a fraction of the weight.
        factor: Factor of its Hessian; None unless the residual is within tolerance and the rest stable.
        iterations: Newton steps taken.
        bifurcations: How often the Hessian was found indefinite.
        energies: Energy after every step [J].
    """

    state: S
    residual: float
    factor: Factor | None
    iterations: int
    bifurcations: int
    energies: list[float]


def first_definite(factorise: Callable[[float], Factor], mu: float) -> tuple[Factor, float]:
    """Raises mu until a regularised matrix is positive definite.

    Args:
        factorise: Factorises the matrix of a mu; raises NotPositiveDefinite.
        mu: First regularisation tried [1/s2].

    Returns:
        The factor, and its mu.

    Raises:
        DrapeDiverged: No mu is large enough.
    """
    while True:
        try:
            return factorise(mu), mu
        except NotPositiveDefinite:
            mu = max(4 * mu, 1.0)
            if mu > _LARGEST:
                raise DrapeDiverged("the Hessian stays indefinite however large the regularisation") from None


def descend(
    landscape: Landscape[S],
    start: Float[ndarray, "vertices 3"],
    *,
    tolerance: float,
    iterations: int,
    mu: float,
    falls_above: float = np.inf,
    halvings: int = 0,
) -> Descent[S]:
    """Descends from a start to a stable rest.

    Args:
        landscape: Energy of the cloth.
        start: Where the descent begins [m].
        tolerance: Largest net force of a rest, as a fraction of the weight.
        iterations: Most steps.
        mu: First regularisation [1/s2]: `FALLING` for a cold start, 0 for a warm one.
        falls_above: Until the net force is first below this fraction of the weight, mu stays at `FALLING` or above.
        halvings: How often a step is halved before it is computed again with a larger mu.

    Returns:
        The end of the descent, with `factor` None where no stable rest was reached.

    Raises:
        DrapeDiverged: Energy or Hessian are not finite.
    """
    state = landscape.at(start)
    energies = [state.energy]
    factor: Factor | None = None
    falling, bifurcations, taken = True, 0, 0
    for taken in range(iterations + 1):
        residual = _residual(landscape, state)
        if not np.isfinite(residual) or not np.isfinite(state.energy):
            raise DrapeDiverged(f"Newton step {taken}: forces are no longer finite; check stiffness and density")
        falling = falling and residual > falls_above
        if residual <= tolerance:
            try:
                rest = landscape.stable(state, factor)
                return Descent(state, residual, rest, taken, bifurcations, energies)
            except NotPositiveDefinite:  # a saddle: fall off it along the next regularised step
                mu, state = max(mu, 1.0), _nudged(landscape, state)
                bifurcations += 1
        if taken == iterations:
            break
        lower = None
        while lower is None and mu <= _LARGEST:
            wanted = mu
            factor, mu = landscape.regularised(state, mu, residual, factor)
            bifurcations += int(mu > wanted)
            lower = _searched(landscape, state, factor.solve(state.force), mu, halvings)
            if lower is None:
                mu = max(4 * mu, 4.0)
        if lower is None:
            break
        state, mu = lower.state, _next_mu(mu, lower)
        mu = max(mu, FALLING) if falling else mu
        energies.append(state.energy)
    return Descent(state, _residual(landscape, state), None, taken, bifurcations, energies)


@dataclass(frozen=True)
class _Lower(Generic[S]):
    """A state further down: the share of the step taken, and the energy's fall in terms of the one promised."""

    state: S
    share: float
    agreement: float


def _residual(landscape: Landscape[S], state: S) -> float:
    return float(np.linalg.norm(state.force) / landscape.weight)


def _nudged(landscape: Landscape[S], state: S) -> S:
    """The cloth a little off a saddle."""
    kick = np.zeros_like(state.x)
    kick[landscape.free, 2] = _NUDGE * np.sin(np.arange(len(landscape.free)))
    return landscape.at(state.x + landscape.free_share(state.x, kick) * kick)


def _searched(landscape: Landscape[S], state: S, free_step: ndarray, mu: float, halvings: int) -> _Lower[S] | None:
    """Follows a step of the free vertices as far as it may go and the energy falls as promised, or not at all."""
    step = np.zeros_like(state.x)
    step[landscape.free] = free_step
    slope = float((free_step * state.force).sum())
    inertia = mu * float((landscape.mass[landscape.free, None] * free_step**2).sum())
    share = landscape.free_share(state.x, step)
    for _ in range(halvings + 1):
        x = state.x.copy()
        x[landscape.free] += share * free_step
        new = landscape.at(x)
        promised = share * (1 - 0.5 * share) * slope + 0.5 * share**2 * inertia
        noise = _ROUNDING * max(abs(state.energy), abs(new.energy))
        if np.isfinite(new.energy):
            if promised <= 10 * noise and np.linalg.norm(new.force) <= np.linalg.norm(state.force):
                return _Lower(new, share, 1.0)
            agreement = (state.energy - new.energy) / promised
            if agreement > _ACCEPTED:
                return _Lower(new, share, agreement)
        share *= 0.5
    return None


def _next_mu(mu: float, lower: _Lower[S]) -> float:
    if lower.agreement > _GOOD and lower.share == 1.0:
        return mu / 4 if mu > _SMALLEST else 0.0
    return max(2 * mu, 1.0) if lower.agreement < _POOR else mu
