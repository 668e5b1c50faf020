"""Reads a drape's mesh from a Wavefront OBJ file, plain or gzipped, within limits; nothing is ever unpickled."""

import gzip
import re
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.datasets.errors import BadMesh

SUFFIXES = (".obj", ".obj.gz")
_MAXIMUM_BYTES = 64 << 20  # of text, after decompression
_REMEDY = "replace it by a triangle mesh in OBJ form, or remove it"


@dataclass(frozen=True, eq=False)
class DrapeMesh:
    """A triangle mesh as it is in its file.

    Attributes:
        vertices: Positions [m].
        faces: Zero-based triangles; polygons are cut into fans.
    """

    vertices: Float[ndarray, "vertices 3"]
    faces: Int[ndarray, "faces 3"]


def read_mesh(path: Path) -> DrapeMesh:
    """Reads vertices and faces; everything else in the file is ignored.

    Raises:
        BadMesh: Missing, not permitted, too large, not OBJ, without faces, with coordinates that are not finite or
            faces that refer to vertices that are not there.
    """
    text = _text(path)
    lines = text.split(b"\n")
    vertices = _vertices([line[2:] for line in lines if line[:2] in (b"v ", b"v\t")], path)
    faces = _faces([line[2:] for line in lines if line[:2] in (b"f ", b"f\t")], len(vertices), path)
    return DrapeMesh(vertices, faces)


def _bad(path: Path, what: str, kind: str = "unreadable-mesh") -> BadMesh:
    return BadMesh(what, where=path, remedy=_REMEDY, kind=kind)


def _text(path: Path) -> bytes:
    too_large = f"holds more than {_MAXIMUM_BYTES >> 20} MiB, a drape's mesh is far smaller"
    try:
        if path.stat().st_size > _MAXIMUM_BYTES:
            raise _bad(path, too_large, "mesh-too-large")
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            text = file.read(_MAXIMUM_BYTES + 1)
    except PermissionError as error:
        raise _bad(path, "may not be read", "no-permission") from error
    except (OSError, EOFError, zlib.error) as error:
        raise _bad(path, f"cannot be read ({error})") from error
    if len(text) > _MAXIMUM_BYTES:
        raise _bad(path, too_large, "mesh-too-large")
    return text


def _numbers(lines: list[bytes], kind: type) -> ndarray | None:
    """All numbers of the lines in one row; None if something else is there."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # numpy's way to say that it stopped half-way
        try:
            return np.fromstring(b" ".join(lines).decode("ascii"), sep=" ", dtype=kind)
        except (DeprecationWarning, ValueError):
            return None


def _vertices(lines: list[bytes], path: Path) -> ndarray:
    numbers = _numbers(lines, float)
    if not lines or numbers is None or len(numbers) % len(lines) or not 3 <= len(numbers) // len(lines) <= 7:
        raise _bad(path, f"cannot be read as OBJ: {len(lines)} vertex lines, which must hold 3 numbers each")
    vertices = numbers.reshape(len(lines), -1)[:, :3]
    if not np.isfinite(vertices).all() or np.abs(vertices).max() > 1e6:
        raise _bad(path, "a coordinate is not a finite length")
    return np.ascontiguousarray(vertices)


def _faces(lines: list[bytes], vertices: int, path: Path) -> ndarray:
    corners = [re.sub(rb"/\S*", b"", line) for line in lines]
    counts = np.array([len(line.split()) for line in corners], dtype=np.int64)
    numbers = _numbers(corners, np.int64)
    if not lines or numbers is None or len(numbers) != counts.sum() or counts.min() < 3:
        raise _bad(path, f"cannot be read as OBJ: {len(lines)} face lines, which must hold 3 vertex numbers each")
    if (counts == 3).all():
        faces = numbers.reshape(-1, 3)
    else:
        polygons = np.split(numbers, np.cumsum(counts)[:-1])
        faces = np.array([[p[0], p[i], p[i + 1]] for p in polygons for i in range(1, len(p) - 1)])
    faces = np.where(faces > 0, faces - 1, faces + vertices)  # OBJ counts from 1; negative numbers from the end
    if (faces < 0).any() or (faces >= vertices).any():
        raise _bad(path, f"a face refers to a vertex that is not among the {vertices} of the file")
    return faces
