"""The shipped set's drapes as another laboratory would have photographed them."""

import json
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from toy_cloths import write_mesh

from cusick_bench.datasets import load
from cusick_bench.datasets.files.protocol import RELEASE, Protocol
from cusick_bench.datasets.files.silhouette import camera_of
from cusick_bench.sim.render.silhouette import render

LARGE_IMAGES = Protocol(
    image_size_px=512, px_per_m=1000.0, centre_px=(240.0, 262.0), image_y="down", foreground="light"
)
"""512 px at 1000 px/m, off the middle, upside down, light on dark."""
SMALL_CLOTH = Protocol(
    cloth_radius_m=0.12, plate_radius_m=0.072, image_size_px=400, px_per_m=1400.0, centre_px=(205.0, 190.0)
)
"""A cloth of 24 cm on a plate in the same ratio."""
NEAR_CAMERA = Protocol(projection="pinhole", camera_height_m=0.7)
"""The release's frame, seen by an eye 0.7 m above the plate."""


def write_laboratory(
    root: Path,
    protocol: Protocol,
    *,
    fabrics: tuple[int, ...] = (3,),
    samples: int = 12,
    captures: tuple[int, ...] = (1, 3),
    meshes: bool = False,
) -> Path:
    """Writes drapes of the shipped set as silhouettes of another protocol, scaled to its cloth, with fabrics.csv.

    Args:
        root: Folder to write.
        protocol: How the pictures are taken.
        fabrics, samples, captures: Which drapes.
        meshes: Whether their meshes are there too.

    Returns:
        `root`.
    """
    synthetic = load("synthetic")
    scale = protocol.cloth_radius_m / RELEASE.cloth_radius_m
    chosen = synthetic.select(fabric=list(fabrics), sample=list(range(1, samples + 1)), capture=list(captures))
    for row in range(len(chosen)):
        drape = chosen.sample(row)
        assert drape.mesh is not None
        vertices, faces = scale * np.asarray(drape.mesh.vertices), np.asarray(drape.mesh.faces)
        photograph(root / str(drape.row["image"]), vertices, faces, protocol)
        if meshes:
            write_mesh((root / str(drape.row["mesh"])).with_suffix(""), vertices, faces)  # .obj instead of .obj.gz
    (root / "fabrics.csv").write_text((synthetic.root / "fabrics.csv").read_text())
    return write_protocol(root, protocol)


def photograph(path: Path, vertices: np.ndarray, faces: np.ndarray, protocol: Protocol) -> None:
    """Writes a silhouette.

    Args:
        path: Image file.
        vertices: Positions [m].
        faces: Triangles.
        protocol: How it is taken.
    """
    image = render(torch.as_tensor(vertices), faces, camera_of(protocol), size=protocol.image_size_px).numpy()
    levels = 1 - image if protocol.foreground == "dark" else image
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.round(255 * levels).astype(np.uint8)).save(path)


def write_protocol(root: Path, protocol: Protocol) -> Path:
    """Writes `protocol.json`.

    Args:
        root: Folder of the data.
        protocol: What to write.

    Returns:
        `root`.
    """
    (root / "protocol.json").write_text(json.dumps(protocol.document()))
    return root
