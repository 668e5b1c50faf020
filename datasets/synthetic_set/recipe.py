"""The recipe of the shipped `synthetic` set: five cloths whose stiffness, shapes and meshes are known.

Each cloth is homogeneous on average. Each of its 12 samples has its own smooth stiffness field and its own rest shape.
It is laid down once with each face up, each time in a new random shape, and captured twice per face, with a small
change of that shape and of its place on the plate in between. Turned over about y, the cloth's x points to the other
side and its rest shape is seen from below. The spreads are set so that image distances between repeats, faces and
samples match those of real cloth (`cusick-bench data stats` prints both).

The whole set follows from one seed; `cusick-bench data synthetic` makes it again, bit for bit on the same platform.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from cusick_bench.sim.cloth.heterogeneity import modulated
from cusick_bench.sim.cloth.material import Material
from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.cloth.shape import dihedral_angles, laid_down, smooth_field
from cusick_bench.sim.constants import CLOTH_RADIUS, PLATE_RADIUS, VERTICES_OF_TRUTH
from cusick_bench.sim.drape import DrapeSimulator
from cusick_bench.sim.engine.settings import DrapeSettings

VERSION = 2  # of the set's files; 2: its cloths have the membrane that their mesh can bend (`sim.cloth.membrane`)
SEED = 2024
SAMPLES = 12
TOGETHER = 4  # samples that are draped in one batch
CAPTURES = {1: "up", 2: "up", 3: "down", 4: "down"}
VERTICES = VERTICES_OF_TRUTH  # of the true mesh; fits use meshes with another seed, so that truth and model differ
MESH_SEED = 77
LAW = "plate"

# Spread of the random elements; see the module's docstring for what they are matched to.
STIFFNESS_SPREAD = 0.10  # sd of log stiffness over the cloth
STIFFNESS_LENGTH = 0.02  # [m]
REST_HEIGHT = 4e-4  # [m]
LAYING_HEIGHT = 1e-3  # [m], each time a face is laid down
REPEAT_HEIGHT = 2e-5  # [m], change between captures
SHAPE_LENGTH = 0.03  # [m]
PLACE_SHIFT = 3e-4  # [m]
PLACE_TURN = 0.008  # [rad]


@dataclass(frozen=True)
class Cloth:
    """A cloth of the set, homogeneous in the mean.

    Attributes:
        number: Fabric number, from 1.
        material: Mean stiffness and areal density.
        thickness: [m].
    """

    number: int
    material: Material
    thickness: float


@dataclass(frozen=True)
class TrueDrape:
    """One capture, without image.

    Attributes:
        cloth: Its cloth.
        sample: Number of the sample, from 1.
        capture: Number of the capture, from 1.
        side: "up" or "down".
        vertices: Positions of the cloth at rest, in the camera's frame [m].
        faces: Counter-clockwise seen from above where the cloth lies flat.
    """

    cloth: Cloth
    sample: int
    capture: int
    side: str
    vertices: Float[ndarray, "vertices 3"]
    faces: Int[ndarray, "faces 3"]


def cloths(seed: int = SEED) -> list[Cloth]:
    """The five cloths: bending stiffness over density in even steps over what drapes from limp to stiff.

    Args:
        seed: Seed of the set.

    Returns:
        The cloths, from limp to stiff.
    """
    generator = np.random.default_rng([seed, 0])
    made = []
    for number, level in enumerate(np.linspace(np.log(8e-6), np.log(1.5e-4), 5), 1):
        density = round(float(np.exp(generator.uniform(np.log(0.08), np.log(0.28)))), 3)
        ratio = np.exp(level + generator.uniform(-0.2, 0.2))  # B / rho [N m / (kg/m2)]
        anisotropy = np.exp(generator.normal(0, 0.25))
        warp, weft = ratio * density * np.sqrt(anisotropy), ratio * density / np.sqrt(anisotropy)
        rows = np.array([warp, np.sqrt(warp * weft), weft])
        growth = np.linspace(1.0, generator.uniform(0.7, 1.1), 5)  # bending stiffness falls or rises with curvature
        stretch, shear = np.exp(generator.uniform(np.log(80), np.log(250), 2)), np.exp(generator.uniform(3.2, 4.2))
        table = np.column_stack(
            [np.full(6, stretch[0]), np.full(6, 0.05 * stretch.min()), np.full(6, stretch[1]), np.full(6, shear)]
        )
        material = Material(
            torch.from_numpy(table),
            torch.from_numpy(rows[:, None] * growth),
            torch.tensor(density, dtype=torch.float64),
        )
        made.append(Cloth(number, material, round(2e-4 + 1.2e-3 * density, 6)))
    return made


def true_mesh(radius: float = CLOTH_RADIUS, plate_radius: float = PLATE_RADIUS, vertices: int = VERTICES) -> Mesh:
    """The mesh of the true drapes.

    Args:
        radius: Cloth radius [m].
        plate_radius: Plate radius [m].
        vertices: Mesh size.

    Returns:
        The flat cloth.
    """
    return cloth_mesh(LAW, vertices, seed=MESH_SEED, radius=radius, plate_radius=plate_radius)


@dataclass(frozen=True)
class _Capture:
    """A capture about to be draped: all that is random about it is drawn.

    Attributes:
        sample: Number of the sample.
        capture: Number of the capture.
        side: "up" or "down".
        material: Tables per element.
        initial: How it is laid down [m].
        rest_angle: Stress-free angles [rad], of its mirror image where it lies face down.
        turn: Angle by which it is put down turned [rad].
        shift: By how much it is put down beside the centre [m].
    """

    sample: int
    capture: int
    side: str
    material: Material
    initial: Float[ndarray, "vertices 3"]
    rest_angle: Float[Tensor, " hinges"]
    turn: float
    shift: Float[ndarray, " 2"]


def _captures(cloth: Cloth, sample: int, seed: int, mesh: Mesh, plate_radius: float) -> Iterator[_Capture]:
    generator = np.random.default_rng([seed, cloth.number, sample])
    stiffness = [smooth_field(STIFFNESS_SPREAD, STIFFNESS_LENGTH, generator) for _ in range(2)]
    material = modulated(cloth.material, mesh, *stiffness)
    rest = mesh.flat.copy()
    rest[:, 2] = smooth_field(REST_HEIGHT, SHAPE_LENGTH, generator)(mesh.material)
    rest_angle = dihedral_angles(torch.from_numpy(rest), mesh.hinges)
    laying = {side: smooth_field(LAYING_HEIGHT, SHAPE_LENGTH, generator) for side in ("up", "down")}
    for capture, side in CAPTURES.items():
        change = smooth_field(REPEAT_HEIGHT, SHAPE_LENGTH, generator)
        initial = laid_down(mesh, laying[side], plate_radius)
        initial += laid_down(mesh, change, plate_radius) - mesh.flat
        # Lying on its face, the cloth is simulated in its mirror image z -> -z: rest angles change sign.
        angle = rest_angle if side == "up" else -rest_angle
        turn, shift = generator.normal(0, PLACE_TURN), generator.normal(0, PLACE_SHIFT, 2)
        yield _Capture(sample, capture, side, material, initial, angle, turn, shift)


def drapes(cloth: Cloth, *, samples: int = SAMPLES, seed: int = SEED, vertices: int = VERTICES) -> Iterator[TrueDrape]:
    """Simulates every capture of a cloth, in order of sample and capture; the captures of a few samples together.

    Args:
        cloth: One of `cloths`.
        samples: Number of samples.
        seed: Seed of the set.
        vertices: Mesh size.

    Yields:
        One drape a capture.

    Raises:
        DrapeDiverged: A capture has no drape.
    """
    mesh = true_mesh(vertices=vertices)
    simulator = DrapeSimulator(mesh, DrapeSettings(law=LAW))
    for first in range(1, samples + 1, TOGETHER):
        numbers = range(first, min(first + TOGETHER, samples + 1))
        plate_radius = simulator.settings.plate_radius
        captures = [one for number in numbers for one in _captures(cloth, number, seed, mesh, plate_radius)]
        batch = simulator.drape_batch(
            [one.material for one in captures],
            initial=torch.stack([torch.from_numpy(one.initial) for one in captures]),
            rest_angle=torch.stack([one.rest_angle for one in captures]),
        )
        for place, one in enumerate(captures):
            positions, faces = batch.member(place).vertices.numpy().copy(), mesh.faces
            if one.side == "down":
                positions[:, 0] *= -1
                faces = faces[:, ::-1]
            yield TrueDrape(cloth, one.sample, one.capture, one.side, _placed(positions, one.turn, one.shift), faces)


def _placed(
    positions: Float[ndarray, "vertices 3"], angle: float, shift: Float[ndarray, " 2"]
) -> Float[ndarray, "vertices 3"]:
    """The drape turned and shifted a little, as it is put under the camera."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    placed = positions.copy()
    placed[:, :2] = placed[:, :2] @ turn.T + shift
    return placed
