"""Drops the true cloth: implicit Euler with a shorter step than the diagnosis', air drag, loads and memories.

Per step, (M (1 + h c) + h^2 K) v' = M v + h F at the free vertices, c the drag of the air.
"""

import numpy as np
import torch
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.shape import dihedral_angles
from cusick_bench.sim.constants import GRAVITY
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.system import DrapeSystem
from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.sim.linear.interface import Factor
from cusick_bench.withheld.world.scene import Remembering, Scene, Vertices, unit

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
        p: The cloth without its memories.
        laid: Shape in which it is laid down [m].
        scene: Its loads and memories.
        steps: Number of steps.

    Returns:
        Positions [m], and what the memories keep for the sample's next picture.

    Raises:
        DrapeDiverged: The cloth flies apart.
    """
    memories = [start(system, p, scene) for start in scene.memories]
    x, v, free = laid.copy(), np.zeros_like(laid), system.free
    weight = p.mass[:, None] * _gravity(scene)
    diagonal = (p.mass * (1 + STEP * _DRAG))[None]
    blocks: ndarray | None = None
    factor: Factor | None = None
    for step in range(steps):
        now, force = _remembered(system.mesh, memories, x, p)
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
    kept = {type(memory).__name__: memory.end(angle) for memory in memories}
    return x, {name: value for name, value in kept.items() if value is not None}


def _gravity(scene: Scene) -> ndarray:
    """Acceleration in the plate's frame [m/s2]."""
    slope = np.radians(scene.tilt[0])
    return GRAVITY * np.append(np.sin(slope) * unit(scene.tilt[1]), -np.cos(slope))


def _remembered(mesh: Mesh, memories: list[Remembering], x: Vertices, p: Parameters) -> tuple[Parameters, Vertices]:
    force = np.zeros_like(x)
    if memories:
        angle = _angles(mesh, x)
        for memory in memories:
            p, more = memory.advance(x, angle, p, STEP)
            force = force if more is None else force + more
    return p, force


def _angles(mesh: Mesh, x: Vertices) -> ndarray:
    return dihedral_angles(torch.from_numpy(x), mesh.hinges).numpy()
