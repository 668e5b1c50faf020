"""Files of a cell: what was asked, in `cell.json`, and what its solver answered, in `prediction.npz`."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from cusick_bench.files import read_json_object, read_npz
from cusick_bench.files.plain_names import part_of
from cusick_bench.metrics.prediction_score import to_levels
from cusick_bench.problem import DrapeProblem
from cusick_bench.runner.store import CELL_FILE, MOST_PREDICTION_BYTES, PREDICTION_FILE
from cusick_bench.solvers.base import Prediction

_POSTERIOR = "posterior_"  # before names of a posterior's arrays in `prediction.npz`


def write_prediction(
    folder: Path, prediction: Prediction, problem: DrapeProblem, bending_draws: np.ndarray | None
) -> None:
    """Writes a cell's `prediction.npz`, whole or not at all.

    Args:
        folder: The cell's.
        prediction: The solver's answer.
        problem: What was answered.
        bending_draws: Bending stiffnesses that the answer draws, one draw a row [N m]; None where it draws none.
    """
    arrays: dict[str, np.ndarray] = {
        "train_image": np.asarray(prediction.train_image, dtype=np.float32),
        "train_target": np.asarray(problem.train_image, dtype=np.float32),
        "draws": to_levels(prediction.draws),
    }
    for name in ("tau", "vertices", "faces", "draw_vertices", "draw_turned"):
        value = getattr(prediction, name)
        if value is not None:
            arrays[name] = np.asarray(value)
    if prediction.posterior is not None:
        arrays |= {f"{_POSTERIOR}{name}": value for name, value in prediction.posterior.items()}
    if prediction.tau is not None:
        with torch.no_grad():
            material = problem.space.specimen(torch.as_tensor(prediction.tau)).material
        arrays |= {name: getattr(material, name).numpy() for name in ("stretch", "bending", "density")}
    if bending_draws is not None:
        arrays["bending_draws"] = bending_draws  # [N m], in the order of `metrics.stiffness.BENDING`
    path = folder / PREDICTION_FILE
    part = part_of(path)
    with part.open("wb") as file:
        np.savez_compressed(file, **arrays)  # pyright: ignore[reportArgumentType]
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


def load_prediction(folder: Path) -> dict[str, np.ndarray]:
    """The arrays of a cell's `prediction.npz`.

    Args:
        folder: The cell's.

    Returns:
        Arrays by name: `train_image`, `train_target`, `draws`, and what else the solver answered.
    """
    remedy = "delete the cell's folder and run it again"
    return read_npz(folder / PREDICTION_FILE, remedy=remedy, most_bytes=MOST_PREDICTION_BYTES)


def stored_posterior(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The posterior among the arrays of a cell's `prediction.npz`, as the solver gave it.

    Args:
        arrays: From `load_prediction`.

    Returns:
        Arrays by the solver's own names; none where it gave no posterior.
    """
    return {name.removeprefix(_POSTERIOR): one for name, one in arrays.items() if name.startswith(_POSTERIOR)}


def load_cell(folder: Path) -> dict[str, Any]:
    """A cell's `cell.json`.

    Args:
        folder: The cell's.

    Returns:
        What was asked.
    """
    return read_json_object(folder / CELL_FILE, remedy="delete the cell's folder and run it again")
