"""Scenes of a synthetic laboratory: camera, light, ground, clutter, and the draped cloth."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.datasets.files.mesh_file import read_mesh
from cusick_bench.datasets.registry import REGISTRY
from cusick_bench.datasets.synthetic_set.recipe import LAW, MESH_SEED
from cusick_bench.photographs.studio.lens import StudioCamera
from cusick_bench.photographs.studio.pattern import (
    CELLS,
    CLOTH_PATTERNS,
    CLOTH_SIDE,
    GROUND_PATTERNS,
    GROUND_SIDE,
    Surface,
    coloured,
)
from cusick_bench.sim.cloth.resolution import cloth_mesh
from cusick_bench.sim.constants import CLOTH_RADIUS, VERTICES_OF_TRUTH

WIDTH, HEIGHT = 1280, 960  # [px] of a photograph
KINDS = ("boards", "boards", "boards", "board", "plate")
"""How laboratories calibrate: several pictures of the board, one in the plate's plane, or only the bare plate."""
_VIEWED = 0.37  # [m] least extent of the ground over the picture's height
_LEAST_CONTRAST = 12.0  # difference of the mean colours of cloth and ground in Lab


@dataclass(frozen=True, eq=False)
class Light:
    """Light of a laboratory.

    Attributes:
        lamp: Place of the lamp [m].
        lamp_radius: Its size, which makes shadows soft [m].
        ambient: Share of the light that comes from everywhere.
        slope: Change of log light per metre along x and y.
        bend: Change of log light per square metre of distance.
        tint: Colour of the lamp, blue, green, red.
    """

    lamp: Float[ndarray, " 3"]
    lamp_radius: float
    ambient: float
    slope: Float[ndarray, " 2"]
    bend: float
    tint: Float[ndarray, " 3"]


@dataclass(frozen=True, eq=False)
class Laboratory:
    """A camera, a plate and a ground that stay as they are while cloths come and go.

    Attributes:
        seed: Number of the laboratory.
        calibration: One of `KINDS`.
        has_plate_picture: Whether there is a picture of the bare plate.
        camera: The camera.
        light: The light.
        ground: Albedo of the ground with all that lies on it.
        ground_colour: Mean colour in Lab.
        ground_depth: Depth of the ground below the plate [m].
        blur, noise, quality: Blur [px], noise [levels] and JPEG quality of the sensor.
    """

    seed: int
    calibration: str
    has_plate_picture: bool
    camera: StudioCamera
    light: Light
    ground: Surface
    ground_colour: Float[ndarray, " 3"]
    ground_depth: float
    blur: float
    noise: float
    quality: int


@dataclass(frozen=True, eq=False)
class Piece:
    """Something to photograph on the plate.

    Attributes:
        vertices: Positions [m].
        faces: Vertex indices of each triangle.
        material: Where each vertex lies in the flat cloth [m].
        albedo: Map of the flat cloth.
    """

    vertices: Float[ndarray, "vertices 3"]
    faces: Int[ndarray, "faces 3"]
    material: Float[ndarray, "vertices 2"]
    albedo: Surface


def linear_from_lab(lab: Float[ndarray, " 3"]) -> Float[ndarray, " 3"]:
    """Turns a colour into albedo; what no screen can show is cut off.

    Args:
        lab: In CIE Lab.

    Returns:
        Linear albedo, blue first.
    """
    pixel = np.array(lab, np.float32).reshape(1, 1, 3)
    bgr = np.clip(cv2.cvtColor(pixel, cv2.COLOR_Lab2LBGR)[0, 0], 0.012, 0.92)
    return bgr.astype(np.float64)


def _mean_lab(surface: Surface) -> Float[ndarray, " 3"]:
    """Mean colour of the middle of a map, in Lab."""
    part = slice(CELLS // 3, 2 * CELLS // 3)
    mean = surface.values[part, part].mean(axis=(0, 1)).astype(np.float32).reshape(1, 1, 3)
    return cv2.cvtColor(mean, cv2.COLOR_LBGR2Lab)[0, 0].astype(np.float64)


def _colour(generator: np.random.Generator, least: float, most: float) -> Float[ndarray, " 3"]:
    """A random colour in Lab of a lightness, mostly muted."""
    hue, strength = generator.uniform(0, 2 * np.pi), generator.choice([3.0, 15.0, 35.0, 55.0])
    return np.array([generator.uniform(least, most), strength * np.cos(hue), strength * np.sin(hue)])


def _camera(generator: np.random.Generator, calibration: str) -> StudioCamera:
    only_plate = calibration == "plate"
    height = generator.uniform(0.55, 1.0)
    focal = generator.uniform(0.86, 1.0) * HEIGHT * height / _VIEWED
    lens = generator.uniform(-0.015, 0.015) if only_plate else generator.uniform(-0.12, 0.08)
    most = np.radians(0.5 if only_plate else 4.0)
    turn = (*generator.uniform(-most, most, 2), np.radians(generator.uniform(-4, 4)))
    middle = (WIDTH / 2 + generator.uniform(-6, 6), HEIGHT / 2 + generator.uniform(-6, 6))
    aim = generator.uniform(-0.012, 0.012, 2)
    level = StudioCamera(WIDTH, HEIGHT, focal, middle, (lens, -0.3 * lens), (0, 0, height), turn)
    axis = level.axis()
    eye = aim + height * axis[:2] / axis[2]
    return StudioCamera(WIDTH, HEIGHT, focal, middle, (lens, -0.3 * lens), (*eye, height), turn)


def _light(generator: np.random.Generator) -> Light:
    angle, lean = generator.uniform(0, 2 * np.pi), np.radians(generator.uniform(5, 50))
    far = 1.5
    lamp = far * np.array([np.sin(lean) * np.cos(angle), np.sin(lean) * np.sin(angle), np.cos(lean)])
    steep = generator.uniform(0, 1.6)  # up to exp(1.6 0.4) = 1.9 from one side of the cloth to the other
    towards = generator.uniform(0, 2 * np.pi)
    return Light(
        lamp=lamp,
        lamp_radius=generator.uniform(0.05, 0.35),
        ambient=generator.uniform(0.3, 0.75),
        slope=steep * np.array([np.cos(towards), np.sin(towards)]),
        bend=generator.uniform(-6, 3),
        tint=np.array([generator.uniform(0.75, 1.1), 1.0, generator.uniform(0.9, 1.2)]),
    )


def _clutter(ground: ndarray, generator: np.random.Generator, nearest: float) -> None:
    """Draws things that lie on the ground, all farther from the axis than `nearest` [m]."""
    for _ in range(generator.integers(0, 7)):
        angle, size = generator.uniform(0, 2 * np.pi), generator.uniform(0.02, 0.09)
        distance = nearest + size + abs(generator.normal(0, 0.04))
        place = ((distance * np.array([np.cos(angle), np.sin(angle)]) / GROUND_SIDE + 0.5) * CELLS).astype(int)
        colour = tuple(float(value) for value in linear_from_lab(_colour(generator, 15, 90)))
        reach, thin = (
            int(size / GROUND_SIDE * CELLS),
            max(2, int(size / GROUND_SIDE * CELLS * generator.uniform(0.1, 0.9))),
        )
        if generator.random() < 0.5:
            box = cv2.boxPoints(((float(place[0]), float(place[1])), (reach, thin), generator.uniform(0, 180)))
            cv2.fillPoly(ground, [box.astype(np.int32)], colour)
        else:
            cv2.ellipse(ground, place.tolist(), (reach // 2, thin // 2), generator.uniform(0, 180), 0, 360, colour, -1)


def make_laboratory(seed: int) -> Laboratory:
    """A laboratory by its number; the same on every machine.

    Args:
        seed: The number.

    Returns:
        The laboratory.
    """
    generator = np.random.default_rng([seed, 1])
    calibration = KINDS[int(generator.integers(len(KINDS)))]
    camera = _camera(generator, calibration)
    depth = generator.uniform(0.07, 0.2)
    colour = _colour(generator, 25, 92)
    second = colour + generator.normal(0, 8, 3)
    pattern = GROUND_PATTERNS[int(generator.integers(len(GROUND_PATTERNS)))]
    ground = coloured(pattern, linear_from_lab(colour), linear_from_lab(second), GROUND_SIDE, generator)
    _clutter(ground.values, generator, 1.1 * CLOTH_RADIUS * (camera.eye[2] + depth) / camera.eye[2])
    return Laboratory(
        seed=seed,
        calibration=calibration,
        has_plate_picture=calibration == "plate" or bool(generator.random() < 0.5),
        camera=camera,
        light=_light(generator),
        ground=ground,
        ground_colour=_mean_lab(ground),
        ground_depth=depth,
        blur=generator.uniform(0.4, 0.9),
        noise=generator.uniform(0.8, 3.0),
        quality=int(generator.integers(85, 96)),
    )


@lru_cache(maxsize=1)
def _flat() -> tuple[ndarray, ndarray]:
    mesh = cloth_mesh(LAW, VERTICES_OF_TRUTH, seed=MESH_SEED)
    return mesh.material, mesh.faces


@lru_cache(maxsize=1)
def _meshes() -> tuple[str, ...]:
    return tuple(sorted(str(path) for path in (REGISTRY["synthetic"].folder() / "data").glob("*/meshes/*.obj.gz")))


def make_drape(laboratory: Laboratory, seed: int, contrast: float = _LEAST_CONTRAST) -> Piece:
    """A drape of the shipped synthetic set, turned and coloured.

    Args:
        laboratory: Where it lies; its ground decides which colours stand out.
        seed: Number of the drape.
        contrast: Least difference of the mean colours of cloth and ground in Lab; 0 dresses the cloth as the ground.

    Returns:
        The drape.
    """
    generator = np.random.default_rng([laboratory.seed, seed, 2])
    paths = _meshes()
    mesh = read_mesh_of(paths[int(generator.integers(len(paths)))])
    angle = generator.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    vertices = mesh.vertices @ turn
    if contrast == 0:
        return Piece(vertices, mesh.faces, _flat()[0], laboratory.ground)
    pattern = CLOTH_PATTERNS[int(generator.integers(len(CLOTH_PATTERNS)))]
    while True:
        first, second = _colour(generator, 12, 92), _colour(generator, 12, 92)
        albedo = coloured(pattern, linear_from_lab(first), linear_from_lab(second), CLOTH_SIDE, generator)
        if np.linalg.norm(_mean_lab(albedo) - laboratory.ground_colour) >= contrast:
            return Piece(vertices, mesh.faces, _flat()[0], albedo)


@lru_cache(maxsize=8)
def read_mesh_of(path: str) -> Piece:
    """A drape's mesh without colour.

    Args:
        path: File.

    Returns:
        Vertices and faces; no albedo.
    """
    mesh = read_mesh(Path(path))
    return Piece(mesh.vertices, mesh.faces, _flat()[0], Surface(1.0, np.zeros((1, 1, 3), np.float32)))


def bare_plate(laboratory: Laboratory, radius: float) -> Piece:
    """The plate without cloth.

    Args:
        laboratory: Where it stands.
        radius: Radius of the plate [m].

    Returns:
        A flat disc whose colour stands out from the ground.
    """
    generator = np.random.default_rng([laboratory.seed, 3])
    angles = np.linspace(0, 2 * np.pi, 721)[:-1]
    rim = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.zeros(720)])
    vertices = np.concatenate([rim, [[0.0, 0.0, 0.0]]])
    faces = np.column_stack([np.arange(720), (np.arange(720) + 1) % 720, np.full(720, 720)])
    lightness = 85.0 if laboratory.ground_colour[0] < 55 else 22.0
    colour = linear_from_lab(np.array([lightness, *generator.normal(0, 2, 2)]))
    return Piece(vertices, faces, vertices[:, :2], coloured("plain", colour, colour, CLOTH_SIDE, generator))
