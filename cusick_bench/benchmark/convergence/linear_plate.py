"""A stiff annulus under its own weight against the exact deflection of a linear plate.

The plate is clamped along r = b and free along r = a, with load q = rho g. Its deflection solves D lap lap w = q,

    w = A + B ln r + C r^2 + E r^2 ln r + q r^4 / (64 D),

with w = w' = 0 at b, no radial moment w'' + nu w'/r and no shear force (lap w)' at a. At D = rho g a^3 the rim of the
standard's cloth sinks by 1 % of the annulus' width, where a plate is linear to 1e-4.

References:
    Timoshenko, Woinowsky-Krieger. Theory of Plates and Shells. 1959, Sec. 17.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from cusick_bench.benchmark.convergence.order import Order, observed_order
from cusick_bench.benchmark.convergence.plate_cloth import plate_cloth, poisson_of
from cusick_bench.sim.cloth.irregular import jittered_mesh
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.cloth.rim import rim_curve
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS, Law
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import Clamp, DrapeSettings
from cusick_bench.sim.errors import DrapeDiverged


@dataclass(frozen=True)
class LinearPlateRow:
    """The linear plate on one mesh.

    Attributes:
        vertices: Mesh size.
        mesh: Seed of the mesh.
        deflection_mm: Mean way by which the rim sinks [mm].
        ratio: This deflection over the exact one.
    """

    vertices: int
    mesh: int
    deflection_mm: float
    ratio: float


@dataclass(frozen=True)
class LinearPlate:
    """The linear plate on several meshes.

    Attributes:
        poisson: Poisson's ratio with which the law bends.
        exact_mm: Exact deflection of the rim [mm].
        rows: A row a mesh.
        order: Observed order of the deflection's error; None where there are no two sizes.
        failures: Meshes on which the cloth did not come to rest, and why.
    """

    poisson: float
    exact_mm: float
    rows: tuple[LinearPlateRow, ...]
    order: Order | None
    failures: tuple[str, ...]


def exact_rim_deflection(
    poisson: float,
    stiffness: float = 1.0,
    *,
    cloth_radius: float = CLOTH_RADIUS,
    plate_radius: float = PLATE_RADIUS,
) -> float:
    """Way by which the rim of a linear plate sinks under its own weight.

    Args:
        poisson: Poisson's ratio.
        stiffness: Bending stiffness D over q R^3, q the weight per area and R the cloth's radius.
        cloth_radius: Radius of the free rim [m].
        plate_radius: Radius of the clamp [m].

    Returns:
        The deflection [m], positive downwards.
    """
    b, nu = plate_radius / cloth_radius, poisson  # lengths in units of the cloth's radius, at which ln r is 0
    ln = np.log(b)
    unknowns = np.array(
        [
            [1, ln, b**2, b**2 * ln],  # w at b
            [0, 1 / b, 2 * b, 2 * b * ln + b],  # w' at b
            [0, nu - 1, 2 + 2 * nu, 3 + nu],  # w'' + nu w'/r at the rim
            [0, 0, 0, 4],  # (lap w)' at the rim
        ]
    )
    load = np.array([b**4 / 64, b**3 / 16, (3 + nu) / 16, 0.5])
    a, _, c, _ = np.linalg.solve(unknowns, -load)
    return float(a + c + 1 / 64) * cloth_radius / stiffness


def linear_plate(
    sizes: Sequence[int],
    law: Law,
    *,
    clamp: Clamp | None = None,
    meshes: int = 1,
    jitter: float = 0.0,
    seed: int = 0,
    done: Callable[[int], None] = lambda drapes: None,
) -> LinearPlate:
    """Lets a stiff flat disc sink to rest on meshes of several sizes.

    Args:
        sizes: Numbers of vertices.
        law: Material law with an energy.
        clamp: How hinges on the plate's edge bend (see `DrapeSettings`).
        meshes: Meshes of each size.
        jitter: Share of the spacing by which interior vertices are moved.
        seed: Seed of the first mesh.
        done: Called with the number of drapes made.

    Returns:
        Deflections and their order.

    Raises:
        SimulationError: The law has no rests, or a size or jitter is out of range.
    """
    settings = DrapeSettings(law=law, clamp=clamp, mode="equilibrium")
    poisson = poisson_of(law, 0.0)
    exact = exact_rim_deflection(poisson)
    rows, failures = [], []
    for size in sizes:
        for number in range(seed, seed + meshes):
            mesh = jittered_mesh(cloth_mesh(law, size, seed=number), jitter, seed=number)
            flat = torch.from_numpy(mesh.flat)
            done(1)
            try:
                drape = DrapeSimulator(mesh, settings).drape(plate_cloth(0.0, 0.0, law), initial=flat)
            except DrapeDiverged as error:
                failures.append(f"{size} vertices, mesh {number}: {error}")
                continue
            sunk = -float(rim_curve(mesh, drape.vertices.numpy()).heights.mean())
            rows.append(LinearPlateRow(size, number, 1e3 * sunk, sunk / exact))
    order = observed_order([row.vertices for row in rows], [row.ratio - 1 for row in rows])
    return LinearPlate(poisson, 1e3 * exact, tuple(rows), order, tuple(failures))
