"""The drapes that a page shows in three dimensions: small meshes with a value of each vertex to colour it by.

They go into the page as JSON: coordinates in 16 bits, values in 8, triangles once for all drapes of one mesh. A drape
of 600 vertices takes 8 kB, one of 2699 takes 32 kB, and the viewer (`templates/scripts/drape_scene.js`,
`drape_viewer.js`) 15 kB; three.js would add 700 kB to every page and plotly 4.5 MB.
"""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from cusick_bench.leaderboard import significant
from cusick_bench.report.cell_view import CellView, shown_surface

MOST_BYTES = 4 << 20  # of all drapes on a page
_LEVELS = 254  # of a value; the next byte stands for none
_NONE = 255
_COORDINATES = 32767
_REAL, _REAL_ANGLES, _REAL_STRIPS = "real silhouette", 180, 6  # the surface over a real silhouette
_ON_PLATE, _BELOW_PLATE = 1.001, 1e-3  # radii of the plate, and depth below it [m], up to which a vertex lies on it


@dataclass(frozen=True, eq=False)
class Colouring:
    """A value of each vertex.

    Attributes:
        title: What it is, for the list of choices.
        values: Value of each vertex; NaN where it has none.
        limits: Values of the first and of the last colour.
        ends: The same in words.
        scale: "difference" (two colours from a neutral middle) or "amount".
        words: What it says of this drape, in a sentence.
    """

    title: str
    values: Float[ndarray, " vertices"]
    limits: tuple[float, float]
    ends: tuple[str, str]
    scale: str
    words: str


@dataclass(frozen=True, eq=False)
class DrapeModel:
    """A drape to be turned.

    Attributes:
        cloth: Name of the cloth.
        method: Name of the solver, or what else the drape is of.
        anchor: Name of the card that it belongs to, "" without one.
        vertices: Positions [m].
        faces: Vertex indices of each triangle.
        words: What it is, in a sentence.
        colourings: Values of the vertices by name.
    """

    cloth: str
    method: str
    anchor: str
    vertices: Float[ndarray, "vertices 3"]
    faces: Int[ndarray, "faces 3"]
    words: str
    colourings: dict[str, Colouring]


def fitted_model(cloth: str, method: str, anchor: str, view: CellView) -> DrapeModel | None:
    """The simulated drape of a cell.

    Args:
        cloth: Name of the cloth.
        method: Name of the solver.
        anchor: Name of its card.
        view: The cell.

    Returns:
        The drape; None where nothing was simulated.
    """
    if not view.simulated:
        return None
    colourings = {"error": _outline_error(view)}
    stiffness = _stiffness(view)
    if stiffness is not None:
        colourings["stiffness"] = stiffness
    words = f"Simulated drape of {method}."
    return DrapeModel(cloth, method, anchor, view.vertices, view.faces, words, colourings)


def real_model(cloth: str, view: CellView) -> DrapeModel:
    """The surface over the real silhouette, to compare with.

    Args:
        cloth: Name of the cloth.
        view: A cell that was fitted to it.

    Returns:
        The drape, without anything to colour it by.
    """
    profile = view.target_profile
    every = max(1, len(profile.radii) // _REAL_ANGLES)
    surface = shown_surface(profile, view.protocol, every=every, strips=_REAL_STRIPS)
    vertices, faces = _with_flat_plate(np.asarray(surface.vertices), np.asarray(surface.faces))
    words = "Real training sample: straight lines from the plate to its silhouette, an assumption, not a scan."
    return DrapeModel(cloth, _REAL, "", vertices, faces, words, {})


def _with_flat_plate(vertices: ndarray, faces: ndarray) -> tuple[ndarray, ndarray]:
    """The fan over the plate with vertices of its own, or smooth shading would make it a dome."""
    centre = int(np.hypot(*vertices[:, :2].T).argmin())
    fan = (faces == centre).any(1)
    return np.vstack([vertices, vertices]), np.where(fan[:, None], faces + len(vertices), faces)


def vertex_means(
    values: Float[ndarray, " elements"], faces: Int[ndarray, "faces 3"], vertices: int
) -> Float[ndarray, " vertices"] | None:
    """Mean over the elements that meet in each vertex.

    Args:
        values: Values of the faces, or of the inner edges in the order of `Mesh.hinges`.
        faces: Vertex indices of each triangle.
        vertices: Number of vertices.

    Returns:
        Means, NaN where no element meets; None where the values are of other elements.
    """
    sides = np.sort(np.concatenate([faces[:, [1, 2]], faces[:, [2, 0]], faces[:, [0, 1]]]), axis=1)
    edges, counts = np.unique(sides, axis=0, return_counts=True)
    hinges = edges[counts == 2]
    elements = next((one for one in (hinges, faces) if len(one) == len(values)), None)
    if elements is None:
        return None
    total, count = np.zeros(vertices), np.zeros(vertices)
    for corner in elements.T:
        np.add.at(total, corner, values)
        np.add.at(count, corner, 1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _outline_error(view: CellView) -> Colouring:
    """How far the simulated outline lies outside the real one, in the direction of each vertex beside the plate."""
    error = 1e3 * (view.fit_profile.radii - view.target_profile.radii)
    x, y, z = view.vertices.T
    angle = np.mod(np.arctan2(y, x), 2 * np.pi)
    at = np.interp(angle, 2 * np.pi * np.arange(len(error) + 1) / len(error), np.append(error, error[0]))
    beside = (np.hypot(x, y) > _ON_PLATE * view.protocol.plate_radius_m) | (z < -_BELOW_PLATE)
    values = np.where(beside, at, np.nan)
    most = max(float(np.abs(error).max()), 0.1)
    words = (
        f"Outline against the real one: from {error.min():+.1f} to {error.max():+.1f} mm (outside is above 0), "
        f"root mean square {np.sqrt(np.mean(error**2)):.1f} mm."
    )
    ends = (f"{most:.1f} mm inside", f"{most:.1f} mm outside the real outline")
    return Colouring("error of the outline", values, (-most, most), ends, "difference", words)


def _stiffness(view: CellView) -> Colouring | None:
    """Bending stiffness near each vertex, the geometric mean over directions and curvatures."""
    if view.bending is None:
        return None
    logs = vertex_means(np.log(view.bending).mean((1, 2)), view.faces, len(view.vertices))
    if logs is None:
        return None
    low, high = float(np.nanmin(logs)), float(np.nanmax(logs))
    shown = tuple(f"{significant(1e6 * float(np.exp(one)))} µN m" for one in (low, high))
    words = f"Bending stiffness, mean of the directions: from {shown[0]} to {shown[1]}."
    return Colouring("bending stiffness", logs, (low, high), (shown[0], shown[1]), "amount", words)


def models_document(models: Sequence[DrapeModel], plate_radius: float) -> dict[str, Any]:
    """What the viewer reads.

    Args:
        models: The drapes.
        plate_radius: Radius of the plate [m].

    Returns:
        Plain values: `meshes`, `drapes`, `plate_radius_m`, and `left_out`, the number of drapes for which the page has
        no room.
    """
    meshes: dict[str, int] = {}
    drapes: list[dict[str, Any]] = []
    size = 0
    for model in models:
        faces = _encoded(model.faces.astype("<u4"))
        drape = _drape(model) | {"mesh": meshes.get(faces, len(meshes))}
        size += _size(drape) + (0 if faces in meshes else len(faces))
        if size > MOST_BYTES:
            break
        meshes.setdefault(faces, len(meshes))
        drapes.append(drape)
    left_out = len(models) - len(drapes)
    return {"meshes": list(meshes), "drapes": drapes, "plate_radius_m": plate_radius, "left_out": left_out}


def _drape(model: DrapeModel) -> dict[str, Any]:
    reach = max(float(np.abs(model.vertices).max()), 1e-6)
    return {
        "cloth": model.cloth,
        "method": model.method,
        "anchor": model.anchor,
        "words": model.words,
        "scale_m": reach / _COORDINATES,
        "vertices": _encoded(np.round(model.vertices * (_COORDINATES / reach)).astype("<i2")),
        "colourings": {name: _colouring(one) for name, one in model.colourings.items()},
    }


def _colouring(one: Colouring) -> dict[str, str]:
    low, high = one.limits
    share = np.clip((one.values - low) / max(high - low, 1e-12), 0, 1)
    levels = np.where(np.isnan(share), _NONE, np.round(_LEVELS * np.nan_to_num(share))).astype(np.uint8)
    named = {"title": one.title, "low": one.ends[0], "high": one.ends[1], "scale": one.scale, "words": one.words}
    return named | {"values": _encoded(levels)}


def _encoded(array: ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()


def _size(drape: dict[str, Any]) -> int:
    return len(drape["vertices"]) + sum(len(one["values"]) for one in drape["colourings"].values())
