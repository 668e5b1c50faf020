"""A drape by dropping the cloth: linearly implicit Euler from the shape in which it was laid down.

Per step: (M + h^2 K) v' = M v + h F, x' = x + h v', with F and the positive-semidefinite stiffness K at x (the paper's
Eq. 3 written for the new velocity). The discrete adjoint walks back through the same steps: with
g = g_v' + h g_x' and (M + h^2 K) lambda = g, the older gradients are g_v = M lambda and g_x = g_x' + dS/dx with
S = h lambda . F - h^2 lambda . K v'. Memory grows with the states only, and with the factors kept within a limit.

A batch of cloths on one mesh drops together: every array then has a leading axis of members.

References:
    Baraff, Witkin. Large steps in cloth simulation. SIGGRAPH 1998.
    Gong, Mao, Wang. Bayesian Differentiable Physics for Cloth Digitalization. CVPR 2024, Eq. 3.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from numba import get_num_threads
from numpy import ndarray

from cusick_bench.sim.engine.cloth_system import ClothSystem, Evaluated
from cusick_bench.sim.engine.dynamics.step_kernels import move, right_hand_side
from cusick_bench.sim.engine.pace import Pace
from cusick_bench.sim.engine.parameters import ParameterGradient, Parameters
from cusick_bench.sim.errors import DrapeDiverged, MembersDiverged, SimulationError
from cusick_bench.sim.linear.interface import Factor, NotPositiveDefinite

FACTOR_MEMORY = 2**30  # [bytes] factors kept for the adjoint; beyond it they are computed again
_CACHE = 8 * 2**20  # [bytes] elements evaluated together, so that they stay in the cache until assembly
States = Iterator[tuple[slice, Evaluated]]
"""Elements of a batch, part by part; each is valid until the next one is asked for."""

_FAR = 20.0  # [sizes of the cloth] displacement beyond which the cloth has flown apart


@dataclass(frozen=True)
class Rollout:
    """States of a dropped cloth, or of a batch, and what its adjoint needs.

    Attributes:
        positions: x_0 .. x_n [m]; x_n alone where no states were recorded.
        velocities: v_0 .. v_n [m/s], or v_n.
        factors: Factor of every step, or None where it has to be computed again.
    """

    positions: Float[ndarray, "states *members vertices 3"]
    velocities: Float[ndarray, "states *members vertices 3"]
    factors: list[Factor | None]

    @property
    def factor_bytes(self) -> int:
        """Memory of the kept factors [bytes]."""
        return sum(factor.nbytes for factor in self.factors if factor is not None)


def parts(system: ClothSystem, members: int) -> list[slice]:
    """Parts of a batch whose elements are evaluated together: as many cloths as the cache holds, one a thread at least.

    Args:
        system: Cloth and support.
        members: Cloths of the batch.

    Returns:
        Neighbouring cloths.
    """
    together = max(get_num_threads(), _CACHE // system.element_bytes)
    return [slice(start, start + together) for start in range(0, members, together)]


def evaluated(
    system: ClothSystem, x: Float[ndarray, "members vertices 3"], laid: Float[ndarray, "members vertices 3"],
    p: Parameters,
) -> States:  # fmt: skip
    """Evaluates a batch part by part.

    Args:
        system: Cloth and support.
        x: Positions [m].
        laid: Where springs hold [m].
        p: The batch of cloths.

    Yields:
        The elements of each part, valid until the next one is asked for.
    """
    for some in parts(system, len(x)):
        yield some, system.evaluate(x[some], laid[some], p.part(some), exact=False)


@dataclass(frozen=True, eq=False)
class Stepper:
    """Implicit Euler steps of a batch, with storage that every step uses again.

    Attributes:
        system: Cloth and support; its pattern and its springs count, not its elements.
        mass: Vertex masses [kg].
        h: Step [s].
        batch: Whether errors say whose cloth they are about.
        lockstep: Whether a solver in lockstep is to factorise even a single matrix as it does those of a batch.
    """

    system: ClothSystem
    mass: Float[ndarray, "members vertices"]
    h: float
    batch: bool = True
    lockstep: bool = False

    @cached_property
    def blocks(self) -> Float[ndarray, "members slots 3 3"]:
        """Storage of the step matrix."""
        return np.zeros((len(self.mass), len(self.system.layout.indices), 3, 3))

    @cached_property
    def right(self) -> Float[ndarray, "members rows 3"]:
        """Storage of the right-hand side."""
        return np.empty((len(self.mass), len(self.system.free), 3))

    def assemble(self, states: States, v: ndarray | None = None) -> Bool[ndarray, "members"]:
        """Puts the step matrix M + h^2 K into `blocks`, and M v + h F into `right` where v is given.

        Args:
            states: Elements at the positions before the step.
            v: Velocities before (members, vertices, 3) [m/s].

        Returns:
            Which members have finite forces.
        """
        system, h, finite = self.system, self.h, np.ones(len(self.mass), bool)
        for part, state in states:
            mass = self.mass[part]
            if v is not None:
                finite[part] = right_hand_side(system.free, mass, h, v[part], state.force(), self.right[part])
            state.matrix(scale=h * h, diagonal=mass + h * h * system.spring, out=self.blocks[part])
        return finite

    def factor(self, old: Factor | None) -> Factor:
        """Factor of the step matrix in `blocks`.

        Args:
            old: Factor whose storage may be used again.

        Returns:
            The factor, of one matrix or of a batch.
        """
        linear = self.system.linear
        if len(self.blocks) == 1 and not self.lockstep:
            return linear.factorise(self.blocks[0], out=old)
        return linear.factorise_batch(self.blocks, out=old)

    def solve(self, factor: Factor) -> Float[ndarray, "members rows 3"]:
        """Velocities, or multipliers, of the free vertices, for the right-hand side that `right` holds."""
        return factor.solve(self.right[0])[None] if factor.members is None else factor.solve(self.right)

    def step(
        self, number: tuple[int, int], states: States, before: tuple[ndarray, ndarray],
        after: tuple[ndarray, ndarray], far: Float[ndarray, "members"], old: Factor | None,
    ) -> Factor:  # fmt: skip
        """One step from evaluated states.

        Args:
            number: Steps taken before, and those of the whole drop; errors tell them.
            states: Elements at the positions before.
            before: Positions [m] and velocities [m/s] before (members, vertices, 3).
            after: Receive those after.
            far: A cloth with a coordinate beyond its own has blown up [m].
            old: Storage of a factor to use again.

        Returns:
            The factor that it solved with.

        Raises:
            DrapeDiverged: As `drop` does.
        """
        (x, v), (x_new, v_new), h = before, after, self.h
        finite = self.assemble(states, v)
        if not finite.all():
            reason = f"forces are no longer finite; use a shorter step than {h} s or check stiffness and density"
            raise self._diverged(number, ~finite, reason)
        try:
            factor = self.factor(old)
        except NotPositiveDefinite as error:
            raise self._diverged(number, error.members, f"{error}; check the stiffness tables") from error
        except SimulationError as error:  # a matrix that is not finite
            bad = np.asarray(~np.isfinite(self.blocks).all((1, 2, 3)))
            raise self._diverged(number, bad, str(error)) from error
        reached = move(self.system.free, h, self.solve(factor), x, v_new, x_new)
        if not (reached < far).all():
            raise self._diverged(number, ~(reached < far), f"the cloth flies apart; use a shorter step than {h} s")
        return factor

    def _diverged(self, number: tuple[int, int], members: ndarray, reason: str) -> DrapeDiverged:
        before, steps = number
        message = f"step {before + 1} of {steps}: {reason}"
        return MembersDiverged(message, np.flatnonzero(members), before) if self.batch else DrapeDiverged(message)


def too_far(laid: Float[ndarray, "members vertices 3"]) -> Float[ndarray, "members"]:
    """Coordinates that only a cloth that has blown up reaches, each laid down as it was [m].

    Args:
        laid: Shapes in which the cloths are laid down [m].

    Returns:
        The coordinate of every cloth.
    """
    return _FAR * np.abs(laid).max((1, 2))


def drop(
    system: ClothSystem,
    parameters: Parameters,
    initial: Float[ndarray, "*members vertices 3"],
    *,
    steps: int,
    step_seconds: float,
    keep_factors: bool = False,
    record: bool = True,
    factor_memory: int = FACTOR_MEMORY,
    pace: Pace | None = None,
    lockstep: bool = False,
) -> Rollout:
    """Drops a cloth, or a batch of cloths, from rest.

    Args:
        system: Cloth and support.
        parameters: Material, of one cloth or of a batch.
        initial: Shape in which the cloth is laid down [m]; springs and fixed vertices hold on to it.
        steps: Number of steps.
        step_seconds: Step h [s].
        keep_factors: Keep each step's factor for the adjoint, within `factor_memory`.
        record: Keep all states, as the adjoint needs them; otherwise the last one only.
        factor_memory: Most memory for kept factors [bytes].
        pace: Pushes between steps, of as many steps; none by default. The adjoint knows of none, so that states can
            not be recorded with them.
        lockstep: Whether a single cloth is to fall as in a batch, to the bit, with a linear solver in lockstep.

    Returns:
        The states.

    Raises:
        SimulationError: States of a drop with pushes shall be recorded.
        DrapeDiverged: The step matrix is not positive definite, or forces are no longer finite. For a batch it is
            MembersDiverged, which says whose.
    """
    if pace is not None and pace.push and record:
        raise SimulationError("a brisk drop has no gradient; use pace 'steady', or ask for none")
    batch = initial.ndim == 3
    p, laid = (parameters, initial) if batch else (parameters.batch(), initial[None])
    displacement = np.zeros_like(laid)
    positions = np.empty((steps + 1 if record else 2, *laid.shape))
    velocities = np.zeros_like(positions)
    positions[0] = laid
    stepper, far = Stepper(system, p.mass, step_seconds, batch, lockstep), too_far(laid)
    factors: list[Factor | None] = []
    kept, factor = 0, None
    for step in range(steps):
        here, there = (step, step + 1) if record else (step % 2, (step + 1) % 2)
        before, after = (positions[here], velocities[here]), (positions[there], velocities[there])
        factor = stepper.step((step, steps), evaluated(system, positions[here], laid, p), before, after, far, factor)
        if pace is not None and pace.push:
            after[0][:] += pace.push_of(step) * displacement
            np.subtract(after[0], before[0], out=displacement)
        keep = keep_factors and kept + factor.nbytes <= factor_memory
        factors.append(factor if keep else None)
        if keep:
            kept, factor = kept + factor.nbytes, None
    if not record:
        positions, velocities = (states[[steps % 2]] for states in (positions, velocities))
    return Rollout(*(states if batch else states[:, 0] for states in (positions, velocities)), factors)


def drop_adjoint(
    system: ClothSystem,
    parameters: Parameters,
    rollout: Rollout,
    g_x: Float[ndarray, "*members vertices 3"],
    *,
    step_seconds: float,
) -> tuple[ParameterGradient, Float[ndarray, "*members vertices 3"]]:
    """Gradient of a function of the last positions to all parameters and to the initial shape.

    Args:
        system: As in `drop`.
        parameters: As in `drop`.
        rollout: What `drop` returned, with its states recorded.
        g_x: Derivative to the last positions.
        step_seconds: As in `drop`.

    Returns:
        Parameter gradient, and derivative to the initial shape (which also anchors springs and fixed vertices).
    """
    if len(rollout.positions) != len(rollout.factors) + 1:
        raise SimulationError("the adjoint of a drop needs all its states; drop with record=True")
    batch = g_x.ndim == 3
    p = parameters if batch else parameters.batch()
    positions, velocities = (states if batch else states[:, None] for states in (rollout.positions, rollout.velocities))
    g_x = g_x.copy() if batch else g_x[None].copy()
    gradient = system.zero_gradient(len(g_x))
    g_v, g_anchor, multiplier = np.zeros_like(g_x), np.zeros_like(g_x), np.zeros_like(g_x)
    h, mass, free = step_seconds, p.mass, system.free
    ones, stepper = np.ones_like(mass), Stepper(system, mass, h)
    again: Factor | None = None
    kept = sum(factor is not None for factor in rollout.factors)  # as many as the next drop has memory for
    for step in reversed(range(len(rollout.factors))):
        x, v, v_new = positions[step], velocities[step], velocities[step + 1]
        factor = rollout.factors[step]
        if factor is None:
            stepper.assemble(evaluated(system, x, positions[0], p))
            factor = again = stepper.factor(again)
        right_hand_side(free, ones, h, g_v, g_x, stepper.right)
        multiplier[:, free] = stepper.solve(factor)
        if rollout.factors[step] is not None:  # a second adjoint of this rollout computes it again
            rollout.factors[step] = None
            system.linear.recycle(factor, kept)
        for some in parts(system, len(x)):
            by_x, by_anchor = system.adjoint(
                x[some], multiplier[some], v_new[some], p.part(some), gradient.part(some), force_factor=h,
                stiffness_factor=h * h,
            )  # fmt: skip
            # velocity of fixed vertices is zero whatever the parameters; the springs' stiffness is constant
            g_x[some] += by_x
            g_anchor[some] += by_anchor
        gradient.mass[:] += (multiplier * (v - v_new)).sum(-1)
        g_v = mass[..., None] * multiplier
    g_initial = g_x + g_anchor
    return (gradient, g_initial) if batch else (gradient.member(0), g_initial[0])
