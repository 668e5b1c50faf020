"""Drops the true cloth: implicit Euler with a shorter step than the diagnosis', air drag, loads and internal variables.

Per step, (M (1 + h c) + h^2 K) v' = M v + h F at the free vertices, c the drag of the air.
"""

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.shape import dihedral_angles
from cusick_bench.sim.constants import GRAVITY
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.system import DrapeSystem
from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.sim.linear.interface import Factor
from cusick_bench.withheld.world.scene import InternalVariables, Scene, Vertices, unit_vector

STEP = 0.03  # [s]
STEPS = 160
_DRAG = 0.4  # [1/s]
_FAR = 1.0  # [m]


def drop(
    system: DrapeSystem, p: Parameters, laid: Vertices, scene: Scene, *, steps: int = STEPS
) -> tuple[Vertices, dict[str, ndarray]]:
    """Drops one cloth.

    Args:
        system: Cloth and support.
        p: Parameters of the cloth at the beginning.
        laid: Shape in which it is laid down [m].
        scene: Its loads and the laws with internal variables.
        steps: Number of steps.

    Returns:
        Positions [m], and what each law keeps for the sample's next picture, by name of the law.

    Raises:
        DrapeDiverged: The cloth flies apart.
    """
    variables = [start(system, p, scene) for start in scene.internal_variables]
    x, v, free = laid.copy(), np.zeros_like(laid), system.free
    weight = p.mass[:, None] * gravity_vector(scene)
    diagonal = (p.mass * (1 + STEP * _DRAG))[None]
    blocks: ndarray | None = None
    factor: Factor | None = None
    for step in range(steps):
        now, force = _advanced(system.mesh, variables, x, p)
        state = system.evaluate(x[None], laid[None], now.batch(), exact=False)
        force = force + state.force()[0] + weight
        for load in scene.loads:
            force = force + load(system, p.mass, x)
        blocks = state.matrix(scale=STEP * STEP, diagonal=diagonal, out=blocks)
        factor = system.linear.factorise(blocks[0], out=factor)
        v[free] = factor.solve((p.mass[:, None] * v + STEP * force)[free])
        x = x + STEP * v
        if not np.abs(x).max() < _FAR:
            raise DrapeDiverged(f"step {step + 1} of {steps}: the cloth flies apart; use weaker loads")
    angle = _angles(system.mesh, x)
    kept = {type(law).__name__: law.carried_over(angle) for law in variables}
    return x, {name: value for name, value in kept.items() if value is not None}


def gravity_vector(scene: Scene) -> Float[ndarray, "3"]:
    """Acceleration of gravity in the frame of a plate that may be tilted.

    Args:
        scene: Its tilt.

    Returns:
        The vector [m/s2].
    """
    slope = np.radians(scene.tilt[0])
    return GRAVITY * np.append(np.sin(slope) * unit_vector(scene.tilt[1]), -np.cos(slope))


def _advanced(
    mesh: Mesh, variables: list[InternalVariables], x: Vertices, p: Parameters
) -> tuple[Parameters, Vertices]:
    """Parameters and forces [N] of this step, with all internal variables advanced one after the other."""
    force = np.zeros_like(x)
    if variables:
        angle = _angles(mesh, x)
        for law in variables:
            p, more = law.advance(x, angle, p, STEP)
            force = force if more is None else force + more
    return p, force


def _angles(mesh: Mesh, x: Vertices) -> ndarray:
    return dihedral_angles(torch.from_numpy(x), mesh.hinges).numpy()
