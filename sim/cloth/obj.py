"""Triangle meshes in Wavefront OBJ files, plain or gzipped: the one reader, within limits, and the one writer.

The parser is ours, not trimesh's: trimesh 4 silently drops faces of two corners and takes vertex 0 for the last one,
accepts coordinates that are not finite, and its errors name neither file nor line.
"""

import gzip
import zlib
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from cusick_bench.sim.cloth.mesh import Mesh
from cusick_bench.sim.errors import BadMeshFile, SimulationError

SUFFIXES = (".obj", ".obj.gz")
_MOST_BYTES = 64 << 20  # of text, after decompression
_LARGEST_COORDINATE = 1e6  # [m]
_MOST_COORDINATES = 7  # x y z, perhaps w, perhaps red green blue
_NARROWEST, _WIDEST = 0.02, 2.0  # [m] of a cloth to simulate
_FLAT = 1e-6  # [m] a cloth whose heights differ by less lies flat


def read_obj(path: str | Path) -> tuple[Float[ndarray, "vertices 3"], Int[ndarray, "faces 3"]]:
    """Reads vertices, in their order, and faces; everything else in the file is ignored.

    Args:
        path: File to read, at most 64 MiB of text; gzipped if its name ends in `.gz`.

    Returns:
        Positions [m], and zero-based triangles; polygons are cut into fans.

    Raises:
        BadMeshFile: Missing, not permitted, too large, not OBJ, without faces, with coordinates that are not finite or
            faces that refer to vertices that are not there.
    """
    path = Path(path)
    positions: list[tuple[float, float, float]] = []
    triangles: list[tuple[int, int, int]] = []
    for number, line in enumerate(_text(path).split(b"\n"), 1):
        words = line.split()
        if not words or words[0] not in (b"v", b"f"):
            continue
        try:
            if words[0] == b"v":
                positions.append(_position(words[1:]))
            else:
                triangles += _fan(words[1:], len(positions))
        except ValueError as error:
            shown = line.strip()[:60].decode("ascii", errors="replace")
            raise BadMeshFile(path, f"line {number}: cannot read {shown!r} as OBJ ({error})") from error
    if not positions or not triangles:
        what = f"holds {len(positions)} vertices and {len(triangles)} faces; need a triangle mesh in OBJ form"
        raise BadMeshFile(path, what)
    points, faces = np.array(positions), np.array(triangles, dtype=np.int64)
    if not (np.abs(points) <= _LARGEST_COORDINATE).all():
        raise BadMeshFile(path, "a coordinate is not finite, or not a length in metres")
    if faces.min() < 0 or faces.max() >= len(points):
        raise BadMeshFile(path, f"a face refers to a vertex that is not there; the file has {len(points)} vertices")
    return points, faces


def mesh_from_obj(path: str | Path) -> Mesh:
    """Reads a flat cloth mesh: x and y are its material coordinates [m], z must be 0.

    Args:
        path: File to read.

    Returns:
        The mesh, vertices and faces as in the file.

    Raises:
        SimulationError: Unreadable file, or the cloth is not flat, of no cloth's size, or not one piece with one rim.
    """
    positions, faces = read_obj(path)
    height, width = np.ptp(positions[:, 2]), np.ptp(positions[:, :2], axis=0).max()
    if not _NARROWEST <= width <= _WIDEST:
        raise SimulationError(
            f"{path} is {width:.4g} wide, and a cloth from {_NARROWEST} to {_WIDEST} m; coordinates are in metres, not "
            "in millimetres or inches: scale them"
        )
    if height > _FLAT:
        raise SimulationError(f"{path} is not flat (z spans {height:.3g} m); give the cloth's rest mesh")
    mesh = Mesh(positions[:, :2], faces)
    sides = np.concatenate([faces[:, :2], faces[:, 1:]])
    links = coo_array((np.ones(len(sides), dtype=np.int8), sides.T), shape=(mesh.vertices, mesh.vertices))
    pieces, _ = connected_components(links, directed=False)
    if pieces > 1:
        raise SimulationError(f"{path} must hold a cloth of one piece, got {pieces}; remove all but one")
    if len(mesh.boundary) < 3:  # which is an error of its own where it is not one loop
        raise SimulationError(f"{path} must hold a cloth with a rim; give a disc")
    return mesh


def write_obj(path: str | Path, positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"]) -> None:
    """Writes a triangle mesh; the same mesh gives the same bytes, gzipped or not.

    Args:
        path: File to write; gzipped if its name ends in `.gz`.
        positions: Vertices [m], written to nine digits.
        faces: Zero-based triangles.
    """
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in positions]
    lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path, text = Path(path), ("\n".join(lines) + "\n").encode()
    path.write_bytes(gzip.compress(text, mtime=0) if path.suffix == ".gz" else text)


def _text(path: Path) -> bytes:
    """The file's text; no more than the limit is ever in memory, whatever a gzip header says."""
    too_large = f"holds more than {_MOST_BYTES >> 20} MiB, a cloth's mesh is far smaller"
    try:
        if not path.is_file():
            raise BadMeshFile(path, "no mesh file is there; give the path of a Wavefront OBJ file")
        if path.stat().st_size > _MOST_BYTES:
            raise BadMeshFile(path, too_large, kind="mesh-too-large")
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            text = file.read(_MOST_BYTES + 1)
    except PermissionError as error:
        raise BadMeshFile(path, "may not be read", kind="no-permission") from error
    except (OSError, EOFError, zlib.error) as error:
        raise BadMeshFile(path, f"cannot be read ({error})") from error
    if len(text) > _MOST_BYTES:
        raise BadMeshFile(path, too_large, kind="mesh-too-large")
    return text


def _position(words: list[bytes]) -> tuple[float, float, float]:
    if not 3 <= len(words) <= _MOST_COORDINATES:
        raise ValueError("a vertex has 3 coordinates")
    return float(words[0]), float(words[1]), float(words[2])


def _fan(words: list[bytes], vertices: int) -> list[tuple[int, int, int]]:
    """Triangles of a polygon. OBJ counts from 1; negative numbers count back from the last vertex so far."""
    if len(words) < 3:
        raise ValueError("a face has at least 3 corners")
    numbers = [int(word.split(b"/", 1)[0]) for word in words]
    if max(map(abs, numbers)) > _MOST_BYTES:
        raise ValueError("there is no such vertex")
    corners = [number - 1 if number >= 0 else number + vertices for number in numbers]
    first = corners[0]
    return [(first, second, third) for second, third in pairwise(corners[1:])]
