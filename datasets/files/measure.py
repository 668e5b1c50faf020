"""Profiles and content hashes of files, cached by content, so that each file is measured only once."""

import hashlib
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import platformdirs
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.datasets.errors import BadImage, BadMesh, DataError
from cusick_bench.datasets.files.image import Blemishes, PlateFit, blemishes, fit_plate, inspect, without_specks
from cusick_bench.datasets.files.mesh_file import read_mesh
from cusick_bench.datasets.files.protocol import Protocol
from cusick_bench.datasets.files.silhouette import profile_of
from cusick_bench.datasets.profile import PROFILE_ANGLES, Profile, profile_from_mesh
from cusick_bench.sim.cloth.obj import SUFFIXES as MESH_SUFFIXES

_MOST_BYTES = 64 << 20  # as much as a mesh may have
_VERSION = 7  # raise it when the meaning of a stored number changes, or a file is refused that was measured


@dataclass(frozen=True, eq=False)
class MeshMeasure:
    """Measures of a mesh that is not kept.

    Attributes:
        profile: Outline seen along z.
        vertices, faces: Number of each.
    """

    profile: Profile
    vertices: int
    faces: int


@dataclass(frozen=True, eq=False)
class ImageMeasure:
    """Measures of a silhouette that is not kept.

    Attributes:
        profile: About the plate's axis; if the image is off-centre, about the point where the plate fits.
        plate: How it holds the plate.
        blemishes: Small faults.
        coloured: Whether its channels differ.
    """

    profile: Profile
    plate: PlateFit
    blemishes: Blemishes
    coloured: bool


def content_hash(path: Path) -> str:
    """SHA-256 of a file.

    Args:
        path: The file.

    Returns:
        64 hexadecimal digits.

    Raises:
        DataError: The file cannot be read, or is far too large.
    """
    of = "mesh" if path.name.lower().endswith(MESH_SUFFIXES) else "image"
    try:
        if path.stat().st_size > _MOST_BYTES:
            what = (
                f"has {path.stat().st_size} bytes, far more than any silhouette or mesh; at most {_MOST_BYTES} are read"
            )
            remedy = "replace it by the original file, or remove it"
            raise DataError(what, where=path, remedy=remedy, kind=f"{of}-too-large")
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except PermissionError as error:
        what = f"cannot be read ({error})"
        raise DataError(what, where=path, remedy="change its mode", kind="no-permission") from error
    except OSError as error:  # of a disk, a network or a cloud that fails
        what = f"cannot be read ({error})"
        raise DataError(what, where=path, remedy="copy it anew, or remove it", kind=f"unreadable-{of}") from error


def _measure_mesh(path: Path, digest: str) -> MeshMeasure:
    def measure() -> Float[ndarray, " numbers"]:
        mesh = read_mesh(path)
        numbers = [len(mesh.vertices), len(mesh.faces)]
        return np.append(profile_from_mesh(mesh.vertices, mesh.faces).radii, numbers)

    stored = _cached(f"mesh-{digest}", PROFILE_ANGLES + 2, measure)
    return MeshMeasure(Profile(stored[:-2]), int(stored[-2]), int(stored[-1]))


def measure_mesh(path: Path) -> MeshMeasure:
    """Measures the outline and size of a mesh, or takes them from the cache.

    Args:
        path: Mesh file.

    Returns:
        Outline and size.

    Raises:
        BadMesh: See `read_mesh`.
    """
    try:
        return _measure_mesh(path, content_hash(path))
    except BadMesh:
        raise
    except DataError as error:
        raise BadMesh(error.what, where=error.where, remedy=error.remedy, kind=error.kind) from error


def measure_image(path: Path, protocol: Protocol) -> ImageMeasure:
    """Measures the profile and faults of a silhouette, or takes them from the cache.

    Args:
        path: Image file.
        protocol: Nominal values of the experiment.

    Returns:
        Profile and faults.

    Raises:
        BadImage: See `read_silhouette`.
    """
    frame = repr((protocol.px_per_m, protocol.centre_px, protocol.image_y, protocol.foreground))
    frame += repr((protocol.image_size_px, protocol.plate_radius_m))
    if protocol.projection == "pinhole":
        frame += repr((protocol.camera_height_m, protocol.cloth_radius_m))
    name = hashlib.sha256(frame.encode()).hexdigest()[:16]
    try:
        key = f"image-{content_hash(path)}-{name}"
        stored = _cached(key, PROFILE_ANGLES + 14, lambda: _measure_image(path, protocol))
    except BadImage:
        raise
    except DataError as error:
        raise BadImage(error.what, where=error.where, remedy=error.remedy, kind=error.kind) from error
    fault, column, row, inscribed, coloured, *small = stored[PROFILE_ANGLES:].tolist()
    cloth, specks, largest_speck, holes, largest_hole = map(int, small[:5])
    touches, grey, column_of_middle, row_of_middle = small[5:]
    return ImageMeasure(
        Profile(stored[:PROFILE_ANGLES]),
        PlateFit(_PLATE_FAULTS[int(fault)], (column, row), inscribed),
        Blemishes(
            cloth, specks, largest_speck, holes, largest_hole, bool(touches), grey, (column_of_middle, row_of_middle)
        ),
        bool(coloured),
    )


_PLATE_FAULTS = ("", "off-centre", "shrunken-image")


def _measure_image(path: Path, protocol: Protocol) -> Float[ndarray, " numbers"]:
    image, coloured = inspect(path, protocol)
    fit, small = fit_plate(image, protocol), blemishes(image)
    centre = (protocol.centre_px[0] - fit.shift[0], protocol.centre_px[1] - fit.shift[1])
    radii = profile_of(without_specks(image), protocol, centre).radii
    faults = [_PLATE_FAULTS.index(fit.fault), *fit.shift, fit.inscribed, coloured]
    counts = [small.cloth, small.specks, small.largest_speck, small.holes, small.largest_hole, small.touches_border]
    return np.concatenate([radii, faults, counts, [small.grey, *small.centroid]]).astype(np.float64)


def _folder() -> Path:
    base = os.environ.get("CUSICK_BENCH_CACHE") or platformdirs.user_cache_dir("cusick-bench")
    return Path(base) / f"measures-{_VERSION}"


def _cached(key: str, length: int, measure: Callable[[], ndarray]) -> Float[ndarray, " numbers"]:
    """Numbers from the cache, or measured and stored; a cache that cannot be used is no fault."""
    path = _folder() / key[:8] / f"{key}.npy"
    try:
        stored = np.load(path, allow_pickle=False)
        if stored.shape == (length,) and stored.dtype == np.float64 and np.isfinite(stored).all():
            return stored
    except (OSError, ValueError, EOFError):
        pass
    numbers = np.asarray(measure(), dtype=np.float64)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as part:
            np.save(part, numbers)
        Path(part.name).replace(path)
    except OSError:
        pass
    return numbers
