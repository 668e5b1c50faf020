"""Draws silhouettes and meshes of given profiles and writes them in the public layout: for examples and tests."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from PIL import Image

from cusick_bench.datasets.dataset import DrapeSample
from cusick_bench.datasets.profile import PROFILE_ANGLES, Profile, profile_from_mesh
from cusick_bench.sim.constants import IMAGE_CENTRE, PIXELS_PER_METRE, PLATE_RADIUS

CAPTURES: Mapping[int, str] = {1: "up", 2: "up", 3: "down", 4: "down"}
PIXEL = 1 / PIXELS_PER_METRE  # [m]
_MESH_ANGLES = 180
_REPEAT = 2e-4  # [m], by which captures of one drape differ


def wavy_profile(folds: int, *, mean: float = 0.12, amplitude: float = 0.01, phase: float = 0.0) -> Profile:
    """mean + amplitude cos(folds angle - phase), and a bump at 30 degrees so that no turn or mirror image is alike."""
    angles = np.arange(PROFILE_ANGLES) * (2 * np.pi / PROFILE_ANGLES)
    bump = 0.4 * amplitude * np.exp(4 * (np.cos(angles - np.pi / 6) - 1))
    return Profile(mean + amplitude * np.cos(folds * angles - phase) + bump)


def toy_profile(fabric: int, sample: int, capture: int) -> Profile:
    """A drape of a toy fabric: captures of one face nearly repeat, faces and samples differ."""
    face = 0 if CAPTURES.get(capture, "up") == "up" else 1
    draw = np.random.default_rng([fabric, sample, face])
    shift = _REPEAT * np.random.default_rng([fabric, sample, capture, 1]).standard_normal()
    profile = wavy_profile(6 + fabric, amplitude=0.008, phase=draw.uniform(0, 2 * np.pi), mean=0.118 + shift)
    swell = 0.004 * np.cos(2 * profile.angles - draw.uniform(0, 2 * np.pi))
    return Profile(profile.radii + swell + 0.002 * draw.standard_normal())


def draw(
    profile: Profile, *, size: int = 256, centre: tuple[float, float] = IMAGE_CENTRE, scale: float = PIXELS_PER_METRE
) -> Float[ndarray, "size size"]:
    """Coverage of a star-shaped cloth, edges smoothed over a pixel; y is up."""
    rows, columns = np.indices((size, size))
    x, y = columns - centre[0], centre[1] - rows
    angle = np.arctan2(y, x) % (2 * np.pi)
    edge = np.interp(angle, profile.angles, profile.radii * scale, period=2 * np.pi)
    return np.clip(0.5 + edge - np.hypot(x, y), 0.0, 1.0)


def surface(profile: Profile) -> tuple[Float[ndarray, "vertices 3"], Int[ndarray, "faces 3"]]:
    """A mesh with this outline: the plate, and a cone from its edge down to the rim."""
    angles = np.arange(_MESH_ANGLES) * (2 * np.pi / _MESH_ANGLES)
    rim = profile.radii[:: len(profile.radii) // _MESH_ANGLES]
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    plate = np.column_stack([PLATE_RADIUS * ring, np.zeros(_MESH_ANGLES)])
    edge = np.column_stack([rim[:, None] * ring, np.full(_MESH_ANGLES, -0.04)])
    inner = 1 + np.arange(_MESH_ANGLES)
    after = 1 + (np.arange(_MESH_ANGLES) + 1) % _MESH_ANGLES
    fan = np.column_stack([np.zeros(_MESH_ANGLES, dtype=int), inner, after])
    skirt = [
        np.column_stack([inner, inner + _MESH_ANGLES, after]),
        np.column_stack([after, inner + _MESH_ANGLES, after + _MESH_ANGLES]),
    ]
    return np.vstack([np.zeros((1, 3)), plate, edge]), np.vstack([fan, *skirt])


def write_image(path: Path, coverage: Float[ndarray, "height width"]) -> None:
    """Writes dark cloth on white."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.round(255 * (1 - coverage)).astype(np.uint8)).save(path)


def write_mesh(path: Path, vertices: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"]) -> None:
    """Writes a Wavefront OBJ file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
    lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.write_text("\n".join(lines) + "\n")


def write_toy(
    root: Path, *, fabrics: tuple[int, ...] = (7,), samples: int = 3, captures: int = 4, meshes: bool = True
) -> Path:
    """Writes a small data set in the public layout.

    Args:
        root: Where `data/Fabric N/...` is put.
        fabrics: Fabric numbers.
        samples, captures: Numbers per fabric and per sample.
        meshes: Whether there are meshes.

    Returns:
        `root`.
    """
    for fabric in fabrics:
        folder = root / "data" / f"Fabric {fabric}"
        for sample in range(1, samples + 1):
            for capture in range(1, captures + 1):
                name = f"Fabric_{fabric}_Sample_{sample}_Capture_{capture}"
                profile = toy_profile(fabric, sample, capture)
                write_image(folder / "silhouettes" / f"{name}.png", draw(profile))
                if meshes:
                    write_mesh(folder / "meshes" / f"{name}.obj", *surface(profile))
    return root


def mesh_path(root: Path, sample: int, capture: int, fabric: int = 7) -> Path:
    return root / f"data/Fabric {fabric}/meshes/Fabric_{fabric}_Sample_{sample}_Capture_{capture}.obj"


def image_path(root: Path, sample: int, capture: int, fabric: int = 7) -> Path:
    return root / f"data/Fabric {fabric}/silhouettes/Fabric_{fabric}_Sample_{sample}_Capture_{capture}.png"


def write_turned(path: Path, profile: Profile, quarter_turns: int) -> None:
    """Writes a cloth that was turned about the plate's axis after its mesh had been paired."""
    vertices, faces = surface(profile)
    for _ in range(quarter_turns % 4):
        vertices = vertices @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]])
    write_mesh(path, vertices, faces)


def misfit_px(sample: DrapeSample) -> float:
    """Pixels between a sample's mesh and its image."""
    assert sample.mesh is not None
    outline = profile_from_mesh(np.asarray(sample.mesh.vertices), np.asarray(sample.mesh.faces))
    return outline.rms(sample.profile) / PIXEL
