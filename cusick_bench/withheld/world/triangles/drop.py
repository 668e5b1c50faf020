"""Drops a cloth of triangles: implicit Euler with one linear solve a step, air drag, loads and internal variables.

Per step, (M (1 + h c) + h^2 (K + k)) v' = M v + h F at the free vertices, c the air's drag, k the support's springs.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.shape import dihedral_angles
from cusick_bench.sim.engine.parameters import Parameters
from cusick_bench.sim.engine.triangles.system import DrapeSystem
from cusick_bench.sim.errors import DrapeDiverged
from cusick_bench.sim.linear.interface import Factor
from cusick_bench.withheld.world.scene import Scene, Vertices, gravity_vector
from cusick_bench.withheld.world.triangles.contact import repulsion
from cusick_bench.withheld.world.triangles.internal_variables import InternalVariables

_FAR = 1.0  # [m]


@dataclass(frozen=True)
class Stepping:
    """Time steps and damping.

    Attributes:
        step: Length of a step [s].
        drag: Drag of the air, per mass [1/s].
    """

    step: float
    drag: float


def drop(
    system: DrapeSystem, p: Parameters, laid: Vertices, scene: Scene, stepping: Stepping, steps: int
) -> tuple[Vertices, dict[str, ndarray]]:
    """Drops one cloth.

    Args:
        system: Cloth and support.
        p: Parameters of the cloth at the beginning.
        laid: Shape in which it is laid down [m].
        scene: Its loads and the laws with internal variables.
        stepping: Time steps and damping.
        steps: Number of steps.

    Returns:
        Positions [m], and what each law keeps for the sample's next picture, by name of the law.

    Raises:
        DrapeDiverged: The cloth flies apart.
    """
    variables = [start(system, p, scene) for start in scene.internal_variables]
    x, v, free, h = laid.copy(), np.zeros_like(laid), system.free, stepping.step
    weight = p.mass[:, None] * gravity_vector(scene)
    diagonal = (p.mass * (1 + h * stepping.drag) + h * h * system.spring)[None]
    blocks: ndarray | None = None
    factor: Factor | None = None
    for step in range(steps):
        now, force = _advanced(system.mesh, variables, x, p, h)
        state = system.evaluate(x[None], laid[None], now.batch(), exact=False)
        force = force + state.force()[0] + weight + _loads(system, p.mass, x, scene)
        blocks = state.matrix(scale=h * h, diagonal=diagonal, out=blocks)
        factor = system.linear.factorise(blocks[0], out=factor)
        v[free] = factor.solve((p.mass[:, None] * v + h * force)[free])
        x = x + h * v
        if not np.abs(x).max() < _FAR:
            raise DrapeDiverged(f"step {step + 1} of {steps}: the cloth flies apart; use weaker loads")
    angle = _angles(system.mesh, x)
    kept = {type(law).__name__: law.carried_over(angle) for law in variables}
    return x, {name: value for name, value in kept.items() if value is not None}


def _loads(system: DrapeSystem, mass: Float[ndarray, "vertices"], x: Vertices, scene: Scene) -> Vertices:
    """Forces of all but gravity from outside, and of the cloth's parts on each other [N]."""
    force = np.zeros_like(x)
    for acceleration in scene.accelerations:
        force = force + mass[:, None] * acceleration(x)
    faces = system.elements.faces
    for pressure in scene.pressures:
        a, b, c = (x[faces[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        unit = normal / np.linalg.norm(normal, axis=1)[:, None]
        push = (pressure(unit) / 6)[:, None] * normal
        force = force + np.column_stack(
            [np.bincount(faces.ravel(), np.repeat(push[:, k], 3), len(x)) for k in range(3)]
        )
    if scene.contact:
        force = force + repulsion(system, mass, x, scene.contact)
    return force


def _advanced(
    mesh: Mesh, variables: list[InternalVariables], x: Vertices, p: Parameters, h: float
) -> tuple[Parameters, Vertices]:
    """Parameters and forces [N] of this step, with all internal variables advanced one after the other."""
    force = np.zeros_like(x)
    if variables:
        angle = _angles(mesh, x)
        for law in variables:
            p, more = law.advance(x, angle, p, h)
            force = force if more is None else force + more
    return p, force


def _angles(mesh: Mesh, x: Vertices) -> ndarray:
    return dihedral_angles(torch.from_numpy(x), mesh.hinges).numpy()
