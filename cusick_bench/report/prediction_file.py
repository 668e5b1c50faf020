"""Reading `prediction.npz` of a finished cell without trusting it."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy import ndarray

from cusick_bench.files import BadFile, read_npz
from cusick_bench.report.errors import ReportError
from cusick_bench.runner.store import MOST_PREDICTION_BYTES, PREDICTION_FILE

T = TypeVar("T")


def read_prediction(folder: Path, understand: Callable[[Mapping[str, ndarray]], T]) -> T:
    """Prediction of a cell.

    Args:
        folder: The cell's folder.
        understand: Makes the result of the file's arrays, which are read when they are asked for; raises ValueError or
            KeyError where they are damaged.

    Returns:
        What `understand` returns.

    Raises:
        ReportError: The file is missing, damaged or oversized; the message says which it is and what to do.
    """
    path, remedy = folder / PREDICTION_FILE, "delete the cell's folder and run it again"
    try:
        return understand(read_npz(path, remedy=remedy, most_bytes=MOST_PREDICTION_BYTES))
    except BadFile as error:
        raise ReportError(f"cannot read {path} ({error.what}); {remedy}") from error
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise ReportError(f"cannot read {path} ({error}); {remedy}") from error


def check_mesh(vertices: ndarray, faces: ndarray | None) -> None:
    """Makes sure that drapes can be drawn.

    Args:
        vertices: Positions of one drape or of several (..., vertices, 3) [m].
        faces: Their triangles (faces, 3).

    Raises:
        ValueError: Positions are not finite, or triangles are missing or name vertices that are not there.
    """
    if faces is None or not _is_sound(vertices, faces):
        raise ValueError("its mesh is damaged")


def _is_sound(vertices: ndarray, faces: ndarray) -> bool:
    """Whether positions are finite and triangles name vertices that are there."""
    if vertices.shape[-1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        return False
    return bool(np.isfinite(vertices).all() and faces.min() >= 0 and faces.max() < vertices.shape[-2])
