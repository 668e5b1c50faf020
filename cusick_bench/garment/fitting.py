"""A skirt on a waist, at rest and in motion: implicit Euler steps about the cloth carried along with the waist.

Per step the waist moves rigidly, and w is the velocity that would carry the whole skirt along with it. About these
carried positions g = x + h w one linear solve gives the rest of the motion, for a batch of cloths at a time:

    ((1 + h c) M + h^2 K(g)) u = M (v - w) + h (F(g) - c M w),    v' = w + u,    x' = g + h u,

with c the drag of still air. With a still waist and no drag it is the step of `cusick_bench.sim.engine.dynamics.drop`,
and cloth that moves along with the waist is not strained. A step in which a vertex would pass its neighbours is made in
parts: forces are linear over a step, and cloth that moves past itself in one step crumples or flies apart.

A skirt comes to rest out of a twirl: in the frame of the waist, the centrifugal acceleration W^2 r holds the cloth up,
and fades as the rotation slows down (the cloth's rotation relative to the waist is neglected). So it sinks taut, with
folds from waist to hem. Cloth that is dropped from flat would instead fall on itself, and stay tucked under and
crumpled. There is no contact between folds: they may pass through one another, as in the Cusick drapes of the paper.

References:
    Baraff, Witkin. Large steps in cloth simulation. SIGGRAPH 1998.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from cusick_bench.garment.body import Body, contact_stiffness
from cusick_bench.garment.errors import GarmentError
from cusick_bench.garment.motion import STILL, WaistMotion
from cusick_bench.garment.skirt import Skirt
from cusick_bench.sim.constants import GRAVITY, Law
from cusick_bench.sim.engine.dynamics.step_kernels import move, right_hand_side
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.errors import DrapeDiverged, SimulationError
from cusick_bench.sim.linear.interface import Factor

Progress = Callable[[int, int], None]  # told the steps done, and of how many

AT_REST = 0.003  # [m/s] root-mean-square speed below which a skirt counts as at rest
AIR = 4.0  # [1/s] drag; the terminal velocity of flat cloth of 0.2 kg/m2 is some 2.5 m/s
TWIRL = 12.0  # [rad/s] about the waist when the skirt begins to sink; at the hem of a circular skirt nearly 7 g
TWIRL_SECONDS = 4.0  # until the turning, which slows down evenly, has stopped
_MOST_PARTS = 8  # largest number of parts of a step
_STEPS_BETWEEN_CHECKS = 10  # steps between two checks of whether all skirts are at rest
_DEEPEST_START = 0.005  # [m] largest depth inside the body at the start
_FAR = 20.0  # [sizes of the skirt] displacement beyond which it has flown apart


def _unwatched(done: int, total: int) -> None:
    """The progress of skirts that nobody waits for."""


@dataclass(frozen=True, eq=False)
class State:
    """Skirts of a batch at one time.

    Attributes:
        positions: Positions of the vertices [m].
        velocities: Velocities of the vertices [m/s].
        time: Time since the waist's motion began [s].
    """

    positions: Float[ndarray, "members vertices 3"]
    velocities: Float[ndarray, "members vertices 3"]
    time: float = 0.0

    def speeds(self) -> Float[ndarray, "members"]:
        """Root-mean-square speed of every skirt [m/s]."""
        return np.sqrt((self.velocities**2).sum(-1).mean(-1))


@dataclass(frozen=True, eq=False)
class Fitting:
    """Skirts of one pattern, each of its own cloth, on the same body.

    Attributes:
        skirt: The pattern.
        system: Its mechanics; the waist is held.
        parameters: A batch of cloths.
        body: What the skirt is worn on, or None.
        drag: Deceleration by the air per velocity [1/s].

    Raises:
        GarmentError: Cloths that were drawn for another skirt, or are no batch, or a drag that is none.
    """

    skirt: Skirt
    system: DrapeSystem
    parameters: Parameters
    body: Body | None
    drag: float = AIR

    def __post_init__(self) -> None:
        mesh, p, members = self.skirt.mesh, self.parameters, self.members
        tables = {"stretch": (len(mesh.faces), 6, 4), "bending": (len(mesh.hinges), 3, 5)}
        fields = {"mass": (mesh.vertices,), "rest_angle": (len(mesh.hinges),)}
        for name, shape in (tables | fields).items():
            found, shared = getattr(p, name).shape, (members, 1, *shape[1:])
            if found != (members, *shape) and not (name in tables and found == shared):
                raise GarmentError(
                    f"cloths of this skirt must be a batch with {name} of shape {(members, *shape)}, got {found}; draw "
                    "them for its mesh (Cloth.draw)"
                )
        if not 0 <= self.drag < np.inf:
            raise GarmentError(f"the drag of the air must be >= 0 1/s and finite, got {self.drag}")

    @property
    def members(self) -> int:
        """Number of skirts."""
        return len(self.parameters.mass)

    @classmethod
    def of(
        cls, skirt: Skirt, parameters: Parameters, *, law: Law = "paper", body: Body | None = None,
        gravity: float = GRAVITY, drag: float = AIR,
    ) -> "Fitting":  # fmt: skip
        """Puts a batch of skirts on a body.

        Args:
            skirt: The pattern.
            parameters: A batch of cloths.
            law: Material law.
            body: What the skirt is worn on, or None.
            gravity: Acceleration along -z [m/s2].
            drag: Deceleration by the air per velocity [1/s].

        Returns:
            The skirts on the body.

        Raises:
            GarmentError: The body is too wide for the skirt, the cloths are not of this skirt, or gravity or drag are
                out of range.
        """
        if not 0 < gravity < np.inf:
            raise GarmentError(f"gravity must be > 0 m/s2 and finite, got {gravity}")
        if body is not None:
            depth, _ = body.depth(skirt.start[~skirt.waist])
            if depth.max() > _DEEPEST_START:
                raise GarmentError(
                    f"the body must fit into the skirt, but it is {depth.max():.3f} m too wide (hip {body.hip} m); "
                    "take a wider hem or narrower hips, or a hip of 0 for no body"
                )
        system = DrapeSystem(skirt.mesh, law, gravity, skirt.waist, np.zeros(skirt.mesh.vertices))
        return cls(skirt, system, parameters, body, drag)

    def start(self, laid: Float[ndarray, "members vertices 3"]) -> State:
        """The skirts as they are put on, at rest.

        Args:
            laid: Positions [m].

        Returns:
            The state at time 0.

        Raises:
            GarmentError: Positions of other skirts, or not finite.
        """
        self.check_positions(laid)
        return State(laid, np.zeros_like(laid))

    def check_positions(self, positions: Float[ndarray, "members vertices 3"]) -> None:
        """Checks that positions are of these skirts.

        Args:
            positions: Positions of the vertices [m].

        Raises:
            GarmentError: They have another shape, or are not finite.
        """
        shape = (self.members, self.skirt.mesh.vertices, 3)
        if positions.shape != shape or not np.isfinite(positions).all():
            found = f"shape {positions.shape}" if positions.shape != shape else "NaN or infinity"
            raise GarmentError(f"positions of the skirts must be finite with shape {shape}, got {found}")

    @cached_property
    def _spacing(self) -> float:
        """Median distance of neighbouring vertices [m]."""
        corners = self.skirt.mesh.corners[:, [0, 1, 2, 0]]
        return float(np.median(np.linalg.norm(np.diff(corners, axis=1), axis=-1)))

    def advance(
        self, state: State, motion: WaistMotion, seconds: float, old: Factor | None = None, *, twirl: float = 0.0
    ) -> tuple[State, Factor]:  # fmt: skip
        """Makes a time step, in parts where cloth moves by more than the distance of its vertices.

        Args:
            state: State before the step.
            motion: Motion of the waist.
            seconds: Step [s].
            old: A factor whose storage is used again.
            twirl: Turning whose outward acceleration is felt [rad/s].

        Returns:
            State after the step, and the factor of its last matrix.

        Raises:
            DrapeDiverged: A skirt flies apart.
        """
        carried = _carried(state.positions, motion.pose(state.time), motion.pose(state.time + seconds))
        moved = seconds * state.velocities - (carried - state.positions)  # beside what moves along with the waist
        farthest = np.sqrt((moved**2).sum(-1).max())
        parts = int(np.clip(np.ceil(farthest / self._spacing), 1, _MOST_PARTS))
        for _ in range(parts):
            state, old = self.step(state, motion, seconds / parts, old, twirl=twirl)
        assert old is not None
        return state, old

    def step(
        self, state: State, motion: WaistMotion, h: float, old: Factor | None = None, *, twirl: float = 0.0
    ) -> tuple[State, Factor]:  # fmt: skip
        """Makes one time step.

        Args:
            state: State before the step.
            motion: Motion of the waist.
            h: Step [s].
            old: A factor whose storage is used again.
            twirl: Turning whose outward acceleration is felt [rad/s].

        Returns:
            State after the step, and the factor of its matrix.

        Raises:
            DrapeDiverged: A skirt flies apart.
        """
        system, p, free = self.system, self.parameters, self.system.free
        x, v = state.positions, state.velocities
        after = motion.pose(state.time + h)
        carried = _carried(x, motion.pose(state.time), after)
        w = (carried - x) / h
        found = system.evaluate(carried, carried, p, exact=False)
        right = np.empty((len(x), len(free), 3))
        force = found.force() - self.drag * p.mass[..., None] * w
        force[..., :2] += twirl**2 * p.mass[..., None] * carried[..., :2]
        right_hand_side(free, p.mass, h, v - w, force, right)
        blocks = found.matrix(scale=h * h, diagonal=(1 + h * self.drag) * p.mass)
        if self.body is not None:
            self._press(carried, x + h * v, after, h, right, blocks)
        factor = self._factor(blocks, old)
        solution = factor.solve(right[0])[None] if factor.members is None else factor.solve(right)
        moved, velocities = np.empty_like(x), np.zeros_like(x)
        reached = move(free, h, solution, carried, velocities, moved)
        if not (reached < _FAR * np.abs(self.skirt.start).max()).all():
            remedy = "lay it flatter, or take less uneven cloth" if motion is STILL else "move the waist less or slower"
            raise DrapeDiverged(
                f"a skirt flies apart at {state.time:.2f} s; {remedy}; or, in Python, take shorter steps than {h} s"
            )
        return State(moved, velocities + w, state.time + h), factor

    def _factor(self, blocks: ndarray, old: Factor | None) -> Factor:
        linear = self.system.linear
        try:
            if len(blocks) == 1:
                return linear.factorise(blocks[0], out=old)
            return linear.factorise_batch(blocks, out=old)
        except SimulationError as error:
            raise DrapeDiverged(f"a skirt cannot take the next step ({error}); check stiffness and density") from error

    def _press(
        self, carried: ndarray, bound_for: ndarray, pose: tuple[ndarray, ndarray], h: float, right: ndarray,
        blocks: ndarray,
    ) -> None:  # fmt: skip
        """Adds the body's pressure to the step, in place; see `cusick_bench.garment.body`."""
        assert self.body is not None
        free = self.system.free
        ahead, _ = self.body.depth(_taken_back(bound_for[:, free], pose))
        depth, normal = self.body.depth(_taken_back(carried[:, free], pose))
        normal = normal @ pose[0].T
        spring = np.where(
            np.maximum(ahead, depth) > 0, contact_stiffness(self.parameters.mass[:, free], self.system.gravity), 0.0
        )
        right += (h * spring * depth)[..., None] * normal
        blocks[:, self.system.layout.diagonal] += (h * h * spring)[..., None, None] * (
            normal[..., :, None] * normal[..., None, :]
        )


def _taken_back(x: ndarray, pose: tuple[ndarray, ndarray]) -> ndarray:
    """Positions in the waist's frame."""
    rotation, shift = pose
    return (x - shift) @ rotation


def _placed(x: ndarray, pose: tuple[ndarray, ndarray]) -> ndarray:
    """Positions in space of what is given in the waist's frame."""
    rotation, shift = pose
    return x @ rotation.T + shift


def _carried(x: ndarray, before: tuple[ndarray, ndarray], after: tuple[ndarray, ndarray]) -> ndarray:
    """Positions after they have moved rigidly along with the waist."""
    return _placed(_taken_back(x, before), after)


def hang(
    fitting: Fitting, laid: Float[ndarray, "members vertices 3"], *, seconds: float = 16.0, step_seconds: float = 0.02,
    progress: Progress = _unwatched,
) -> tuple[State, Bool[ndarray, "members"]]:  # fmt: skip
    """Lets skirts sink out of a twirl until they rest.

    Args:
        fitting: The skirts.
        laid: How they are put on [m].
        seconds: Longest time [s].
        step_seconds: Step [s].
        progress: Called with the steps done and the most that there can be.

    Returns:
        The last state, and which skirts rest: the twirl is over, and their root-mean-square speed is below `AT_REST`.

    Raises:
        GarmentError: Positions of other skirts or not finite, or a time or step that is not positive.
        DrapeDiverged: A skirt flies apart.
    """
    _require_positive(seconds=seconds, step_seconds=step_seconds)
    state, factor = fitting.start(laid), None
    steps, twirl = max(round(seconds / step_seconds), 1), TWIRL
    for step in range(steps):
        twirl = TWIRL * max(1 - step * step_seconds / TWIRL_SECONDS, 0.0)
        state, factor = fitting.advance(state, STILL, step_seconds, factor, twirl=twirl)
        progress(step + 1, steps)
        if not twirl and (step + 1) % _STEPS_BETWEEN_CHECKS == 0 and (state.speeds() < AT_REST).all():
            break
    return State(state.positions, state.velocities), (state.speeds() < AT_REST) & (twirl == 0)


def walk(
    fitting: Fitting, rest: State, motion: WaistMotion, *, settle: float = 0.8, step_seconds: float = 0.02,
    every: int = 2, progress: Progress = _unwatched,
) -> tuple[Float[ndarray, "frames"], Float[ndarray, "frames members vertices 3"]]:  # fmt: skip
    """Moves the waist.

    Args:
        fitting: The skirts.
        rest: Where they hang when the motion begins.
        motion: Motion of the waist.
        settle: Time that is simulated after the waist has stopped [s].
        step_seconds: Step [s].
        every: Steps between frames.
        progress: Called with the steps done and their number.

    Returns:
        Times [s] and positions [m] of the frames; the first is the start.

    Raises:
        GarmentError: Skirts at rest that are others or not finite, or a time, step or number that is out of range.
        DrapeDiverged: A skirt flies apart.
    """
    _require_positive(step_seconds=step_seconds)
    if not (0 <= settle < np.inf and every >= 1):
        raise GarmentError(f"settle must be >= 0 s and finite, and every >= 1, got {settle} s and {every}")
    fitting.check_positions(rest.positions)
    state, factor = State(rest.positions, rest.velocities), None
    steps = round((motion.seconds + settle) / step_seconds)
    times = np.zeros(steps // every + 1)
    frames = np.empty((len(times), *state.positions.shape))  # of a long motion gigabytes, which a list would hold twice
    frames[0] = state.positions
    for step in range(1, steps + 1):
        state, factor = fitting.advance(state, motion, step_seconds, factor)
        progress(step, steps)
        if step % every == 0:
            times[step // every], frames[step // every] = state.time, state.positions
    return times, frames


def _require_positive(**numbers: float) -> None:
    for name, value in numbers.items():
        if not 0 < value < np.inf:
            raise GarmentError(f"{name} must be > 0 s and finite, got {value}")
