"""Drops of a batch of cloths: which diverged, which had shorter steps, and the adjoint of the steps that were taken.

A few limp cloths fly apart in long steps. Such a cloth is dropped again with half the step and twice as many steps,
over the same time, as often as the settings allow (`DrapeSettings.halvings`); the others keep their drape to the bit.
Drops with shorter steps always have the pace `steady`. A cloth that diverges in its first step is not dropped again:
its forces as laid down do not depend on the step, so its tables or its loads are at fault.

In lockstep, the factor of a matrix differs by rounding from that of the same matrix alone, and limp cloth can amplify
rounding to centimetres. So that no drape depends on the other cloths of its batch, all first drops are in lockstep,
even that of a single cloth, and drops with shorter steps, of which a batch has few, are made one by one.
"""

from dataclasses import dataclass, field, replace

import numba
import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from cusick_bench.sim.engine.cloth_system import ClothSystem
from cusick_bench.sim.engine.dynamics.drop import Rollout, drop, drop_adjoint, evaluated
from cusick_bench.sim.engine.pace import pace_of
from cusick_bench.sim.engine.parameters import ParameterGradient, Parameters
from cusick_bench.sim.engine.settings import DrapeSettings
from cusick_bench.sim.errors import MembersDiverged

_BLOWN_UP = 100.0  # [weights] net force of a cloth that flew apart; in free fall it is about 1


def flown_apart(settings: DrapeSettings, residual: float) -> str | None:
    """Message about a cloth that flew apart in a drop's long steps; None for any other.

    Args:
        settings: How it was dropped.
        residual: Its net force at the end, as a fraction of its weight.

    Returns:
        The message, or None.
    """
    if residual < _BLOWN_UP:
        return None
    return (
        f"the cloth flies apart: net force {residual:.2g} of the weight after {settings.steps} steps; use a shorter "
        f"step than {settings.step_seconds} s"
    )


def halved(settings: DrapeSettings, halvings: int) -> DrapeSettings:
    """Settings of the same fall in shorter steps.

    Args:
        settings: How cloths are dropped.
        halvings: How often the step is halved.

    Returns:
        The settings; the same object where nothing is halved.
    """
    if halvings == 0:
        return settings
    steps, step_seconds = settings.steps * 2**halvings, settings.step_seconds / 2**halvings
    return replace(settings, steps=steps, step_seconds=step_seconds, pace="steady")


@dataclass(frozen=True, eq=False)
class _Group:
    """Cloths that dropped together, and the way back.

    Attributes:
        parameters: Theirs.
        rollout: Their states.
        members: Their places in the batch.
        settled: Which of them keep this drop; the others are dropped again, or have no drape.
        step_seconds: Step that it took [s].
    """

    parameters: Parameters
    rollout: Rollout
    members: Int[ndarray, "alive"]
    settled: Bool[ndarray, "alive"]
    step_seconds: float

    def add_gradient(
        self, system: ClothSystem, g_x: Float[ndarray, "members vertices 3"], gradient: ParameterGradient,
        g_initial: ndarray,
    ) -> None:  # fmt: skip
        """Sets these cloths' gradients among those of the batch, in place."""
        by_last = np.where(self.settled[:, None, None], g_x[self.members], 0.0)
        found, g_initial[self.members] = drop_adjoint(
            system, self.parameters, self.rollout, by_last, step_seconds=self.step_seconds
        )
        gradient.put(self.members, found)


@dataclass(eq=False)
class DroppedBatch:
    """A batch of cloths after its drop.

    Attributes:
        system: Cloth and support.
        settings: How the cloths are dropped.
        parameters: The cloths.
        laid: Shapes in which they are laid down [m].
        factor_memory: Most memory for kept factors [bytes]; None where no gradient is wanted.
        positions: Where they fell [m], NaN where a cloth diverged.
        failures: Why a cloth diverged, with the shortest step tried, or None.
        residual: Net forces as fractions of the weights; NaN where diverged.
        iterations: Steps that the cloths took; 0 where diverged.
        halvings: How often their step was halved.
    """

    system: ClothSystem
    settings: DrapeSettings
    parameters: Parameters
    laid: Float[ndarray, "members vertices 3"]
    factor_memory: int | None
    positions: Float[ndarray, "members vertices 3"] = field(init=False)
    failures: list[str | None] = field(init=False)
    residual: Float[ndarray, "members"] = field(init=False)
    iterations: Int[ndarray, "members"] = field(init=False)
    halvings: Int[ndarray, "members"] = field(init=False)
    _groups: list[_Group] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        members = len(self.laid)
        self.positions, self.residual = np.full_like(self.laid, np.nan), np.full(members, np.nan)
        self.failures = [None] * members
        self.iterations, self.halvings = np.zeros(members, np.int64), np.zeros(members, np.int64)

    def gradient(self, g_x: Float[ndarray, "members vertices 3"]) -> tuple[ParameterGradient, ndarray]:
        """Derivatives to the parameters and to the initial shapes, by the steps that each cloth took.

        Args:
            g_x: Derivative to the last positions.

        Returns:
            Parameter gradient, and derivative to the initial shapes; 0 for a cloth without a drape.
        """
        gradient, g_initial = self.system.zero_gradient(len(self.laid)), np.zeros_like(g_x)
        for group in self._groups:  # those with shorter steps come later, and overwrite
            group.add_gradient(self.system, g_x, gradient, g_initial)
        return gradient, g_initial

    def drop(self, members: Int[ndarray, "some"], halvings: int) -> Int[ndarray, "again"]:
        """Drops some cloths, as many at once as the threads factorise: each thread's matrix then stays in its cache.

        Args:
            members: Their places in the batch.
            halvings: How often their step is halved.

        Returns:
            Places of those that a shorter step may help.
        """
        width = self.system.linear.width
        together = 1 if width > 1 and halvings else numba.get_num_threads() * width
        groups = np.array_split(members, -(-len(members) // together))
        memory = None
        if self.factor_memory is not None:
            memory = (self.factor_memory - sum(group.rollout.factor_bytes for group in self._groups)) // len(groups)
        self.halvings[members] = halvings
        return np.array([one for group in groups for one in self._drop_group(group, halvings, memory)], np.int64)

    def _drop_group(self, alive: Int[ndarray, "alive"], halvings: int, memory: int | None) -> list[int]:
        """Drops cloths together; those that diverge are set aside and the others dropped again without them."""
        s, system, again = halved(self.settings, halvings), self.system, []
        pace, lockstep = pace_of(s.pace, s.steps), system.linear.width > 1 and not halvings
        while len(alive):
            own, laid = self.parameters.take(alive), self.laid[alive]
            try:
                rollout = drop(
                    system, own, laid, steps=pace.steps, step_seconds=s.step_seconds, record=memory is not None,
                    keep_factors=memory is not None, factor_memory=memory or 0, pace=pace, lockstep=lockstep,
                )  # fmt: skip
            except MembersDiverged as error:
                lost = alive[list(error.members)]
                self._lose(lost, str(error))
                again += [] if error.steps == 0 else lost.tolist()
                alive = np.delete(alive, error.members)
                continue
            x = rollout.positions[-1]
            force = np.concatenate([state.force() for _, state in evaluated(system, x, laid, own)])
            weight = s.gravity * own.mass.sum(1)
            self.residual[alive] = np.linalg.norm(force[:, system.free].reshape(len(alive), -1), axis=1) / weight
            self.iterations[alive], self.positions[alive] = pace.steps, x
            wild = [flown_apart(s, residual) for residual in self.residual[alive].tolist()]
            settled = np.array([failure is None for failure in wild])
            for member, failure in zip(alive, wild, strict=True):
                self.failures[member] = None
                if failure is not None:
                    self._lose(np.array([member]), failure)
            if settled.any():  # or the way back would pass through it for nothing
                self._groups.append(_Group(own, rollout, alive, settled, s.step_seconds))
            again += alive[~settled].tolist()
            break
        return again

    def _lose(self, members: Int[ndarray, "lost"], why: str) -> None:
        """Notes that cloths have no drape, not even one that flew apart with a longer step."""
        self.positions[members], self.residual[members], self.iterations[members] = np.nan, np.nan, 0
        for member in members:
            self.failures[member] = why


def drop_batch(
    system: ClothSystem,
    settings: DrapeSettings,
    parameters: Parameters,
    laid: Float[ndarray, "members vertices 3"],
    *,
    factor_memory: int | None,
    halvings: int,
) -> DroppedBatch:
    """Drops a batch of cloths; those that fly apart again with shorter steps.

    Args:
        system: Cloth and support.
        settings: How they are dropped.
        parameters: The cloths.
        laid: Shapes in which they are laid down [m].
        factor_memory: Most memory for the factors that gradients keep [bytes]; None where no gradient is wanted.
        halvings: How often a cloth's step may be halved.

    Returns:
        The batch after its drop.
    """
    batch, left = DroppedBatch(system, settings, parameters, laid, factor_memory), np.arange(len(laid))
    for halving in range(halvings + 1):
        left = batch.drop(left, halving)
        if not len(left):
            break
    return batch
