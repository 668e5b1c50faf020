"""Writes the `synthetic` set as files: the public layout, its true parameters, a Croissant description, checksums."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from cusick_bench.datasets.errors import DataError
from cusick_bench.datasets.files.checksums import CHECKSUMS
from cusick_bench.datasets.files.object_file import read_object
from cusick_bench.datasets.files.protocol import RELEASE
from cusick_bench.datasets.files.silhouette import camera_of
from cusick_bench.datasets.synthetic_set import recipe
from cusick_bench.datasets.synthetic_set.croissant import NAME, croissant
from cusick_bench.files.digest import file_digest
from cusick_bench.sim.cloth.obj import write_obj
from cusick_bench.sim.render.silhouette import render

_TRUTH = "truth.json"
_DESCRIPTION = "croissant.json"  # written first and last: it marks a folder as this writer's, a part of the set too
_DECIMALS = 5  # meshes are written to 0.01 mm: far above rounding noise, far below what matters


def _name(drape: recipe.TrueDrape) -> str:
    return f"Fabric_{drape.cloth.number}_Sample_{drape.sample}_Capture_{drape.capture}"


def _write_drape(drape: recipe.TrueDrape, fabric: Path) -> None:
    image = render(torch.from_numpy(drape.vertices), drape.faces, camera_of(RELEASE)).numpy()
    grey = np.round(255 * (1 - image)).astype(np.uint8)
    Image.fromarray(grey).save(fabric / "silhouettes" / f"{_name(drape)}.png", optimize=True)
    positions = np.round(drape.vertices, _DECIMALS) + 0.0  # adding zero turns -0 into 0
    write_obj(fabric / "meshes" / f"{_name(drape)}.obj.gz", positions, drape.faces)


def _truth(cloths: list[recipe.Cloth]) -> dict[str, Any]:
    """The true parameters: mean tables of every cloth and the spread of the random elements."""
    spreads = (
        "STIFFNESS_SPREAD", "STIFFNESS_LENGTH", "REST_HEIGHT", "LAYING_HEIGHT", "REPEAT_HEIGHT", "SHAPE_LENGTH",
        "PLACE_SHIFT", "PLACE_TURN", "VERTICES", "MESH_SEED", "SEED",
    )  # fmt: skip
    return {
        "law": recipe.LAW,
        "random_elements": {name.lower(): getattr(recipe, name) for name in spreads},
        "fabrics": {
            str(cloth.number): {
                "stretch_N_m": cloth.material.stretch.tolist(),
                "bending_N_m": cloth.material.bending.tolist(),
                "areal_density_kg_m2": float(cloth.material.density),
                "poisson": float(cloth.material.poisson),
            }
            for cloth in cloths
        },
    }


def _protocol() -> dict[str, Any]:
    """The frame of the public release, which the set is made in."""
    turned, order = "about y: material x points to -x when face down", "captures 1, 2 face up, then 3, 4 face down"
    return replace(RELEASE, captures=dict(recipe.CAPTURES), turn_over=turned, order=order).document()


def _write(path: Path, text: str) -> None:
    path.write_bytes(text.encode())  # the same bytes everywhere: as text, lines would end otherwise on Windows


def _write_json(path: Path, document: dict[str, Any]) -> None:
    _write(path, json.dumps(document, indent=1) + "\n")


def _may_be_written(folder: Path) -> bool:
    """Whether a folder is new, empty, or marked as written here."""
    if not folder.exists():
        return True
    if not folder.is_dir():
        return False
    if not any(folder.iterdir()):
        return True
    try:
        return read_object(folder / _DESCRIPTION, "invalid-data").get("name") == NAME
    except DataError:
        return False


def checksums(folder: Path) -> dict[str, str]:
    """SHA-256 of every file below a folder; the checksum list itself is left out.

    Args:
        folder: The folder.

    Returns:
        Path relative to the folder -> 64 hexadecimal digits.
    """
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != CHECKSUMS)
    return {path.relative_to(folder).as_posix(): file_digest(path) for path in files}


def write_synthetic(
    folder: Path, *, samples: int = recipe.SAMPLES, step: Callable[[str], None] = lambda name: None
) -> dict[str, str]:
    """Simulates the set and writes it.

    Args:
        folder: Folder to write to: new, empty, or with this set or a part of it, which is replaced.
        samples: Samples per cloth; fewer than 12 make a part of the set, e.g. for a check.
        step: Called with each capture's name when it is written.

    Returns:
        SHA-256 of every file, as written to `sha256.json`.

    Raises:
        DataError: The folder holds other files than those of this set.
    """
    cloths = recipe.cloths()
    if not _may_be_written(folder):
        raise DataError(
            "holds other files, which would be written over", where=folder, remedy="give a new folder with --out"
        )
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / _DESCRIPTION).exists():
        _write_json(folder / _DESCRIPTION, croissant({}))
    _write_json(folder / _TRUTH, _truth(cloths))
    for cloth in cloths:
        fabric = folder / "data" / f"Fabric {cloth.number}"
        for part in ("silhouettes", "meshes"):
            shutil.rmtree(fabric / part, ignore_errors=True)
            (fabric / part).mkdir(parents=True)
        for drape in recipe.drapes(cloth, samples=samples):
            _write_drape(drape, fabric)
            step(_name(drape))
    rows = [f"{cloth.number},{float(cloth.material.density):g},{cloth.thickness:g}" for cloth in cloths]
    _write(folder / "fabrics.csv", "\n".join(["fabric,areal_density_kg_m2,thickness_m", *rows]) + "\n")
    _write_json(folder / "protocol.json", _protocol())
    described = {name: digest for name, digest in checksums(folder).items() if name != _DESCRIPTION}
    _write_json(folder / _DESCRIPTION, croissant(described))
    digests = checksums(folder)
    _write_json(folder / CHECKSUMS, digests)
    return digests
