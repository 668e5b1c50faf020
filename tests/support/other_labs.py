"""Drapes of the shipped set as another laboratory would have photographed them: the same meshes, another protocol."""

import json
import shutil
from dataclasses import fields
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from cusick_bench.datasets import load
from cusick_bench.datasets.files.mesh_file import read_mesh
from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.files.silhouette import camera_of
from cusick_bench.sim.render.silhouette import render

FACE_UP = {1: "up", 2: "up"}
LABS = {
    "release": Protocol(captures=FACE_UP),
    "fine": Protocol(
        image_size_px=512, px_per_m=1000.0, centre_px=(250.3, 262.8), foreground="light", captures=FACE_UP
    ),
    "coarse": Protocol(px_per_m=600.0, centre_px=(120.0, 131.0), foreground="light", captures=FACE_UP),
    "image_y down": Protocol(image_y="down", captures=FACE_UP),
    "pinhole": Protocol(projection="pinhole", camera_height_m=1.2, captures=FACE_UP),
}
"""The release's protocol, and others that differ in what a picture shows of a drape, not in the drape."""


def write_lab(root: Path, protocol: Protocol, *, fabrics: tuple[int, ...] = (2, 5), samples: int = 3) -> Path:
    """Photographs drapes of the shipped set, two captures face up of every sample.

    Args:
        root: Folder to write to, in the public layout.
        protocol: How to photograph them.
        fabrics: Fabrics of the set, from 1 (limp) to 5 (stiff).
        samples: Samples of each.

    Returns:
        `root`.
    """
    shipped = load("synthetic")
    for fabric in fabrics:
        for sample in range(1, samples + 1):
            for capture in FACE_UP:
                name = f"Fabric_{fabric}_Sample_{sample}_Capture_{capture}"
                mesh = shipped.root / "data" / f"Fabric {fabric}" / "meshes" / f"{name}.obj.gz"
                folder = root / "data" / f"Fabric {fabric}"
                for part in ("silhouettes", "meshes"):
                    (folder / part).mkdir(parents=True, exist_ok=True)
                shutil.copy(mesh, folder / "meshes" / mesh.name)
                drape = read_mesh(mesh)
                photograph(folder / "silhouettes" / f"{name}.png", drape.vertices, drape.faces, protocol)
    shutil.copy(shipped.root / "fabrics.csv", root / "fabrics.csv")
    return write_protocol(root, protocol)


def photograph(path: Path, vertices: np.ndarray, faces: np.ndarray, protocol: Protocol) -> None:
    """Writes a silhouette.

    Args:
        path: Image file.
        vertices: Positions [m].
        faces: Triangles.
        protocol: How it is taken.
    """
    points = torch.as_tensor(np.array(vertices, dtype=np.float64))
    coverage = render(points, np.array(faces), camera_of(protocol), size=protocol.image_size_px).numpy()
    light = coverage if protocol.foreground == "light" else 1 - coverage
    Image.fromarray(np.round(255 * light).astype(np.uint8)).save(path)


def write_protocol(root: Path, protocol: Protocol) -> Path:
    """Writes `protocol.json`: what is not as in the release, and the captures.

    Args:
        root: Folder of the data.
        protocol: What to write.

    Returns:
        `root`.
    """
    values = {item.name: getattr(protocol, item.name) for item in fields(Protocol)}
    other = {name: value for name, value in values.items() if value != getattr(RELEASE, name)}
    (root / "protocol.json").write_text(json.dumps(other))
    return root
