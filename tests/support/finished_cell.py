"""Finished cells of a run, written without running anything: what tables and figures are made of."""

import json
from pathlib import Path

import numpy as np

from cusick_bench.datasets import DrapeDataset

CLOTHS = ("fabric_1", "fabric_4")  # of the toy set: of 7 and of 10 folds


def write_cell(
    run: Path,
    dataset: DrapeDataset,
    solver: str,
    cloth: str,
    draws: np.ndarray,
    *,
    seed: int = 0,
    arrays: dict[str, np.ndarray] | None = None,
) -> Path:
    """A finished cell with these silhouettes as draws, and the training silhouette as its fit."""
    (split,) = dataset.split("paper", [cloth])
    folder = run / "cells" / f"{solver}-{cloth}-{seed}".replace(":", "_")
    folder.mkdir(parents=True)
    kind = solver.split(":")[0] if ":" in solver else "solver"
    record = {"solver": solver, "kind": kind, "cloth": cloth, "seed": seed, "dataset": dataset.name, "settings": {}}
    record |= {"dataset_hash": dataset.content_hash, "protocol": "paper"}
    record |= {"train": list(split.train), "test": list(split.test)}
    (folder / "cell.json").write_text(json.dumps(record))
    result = record | {"status": "done", "metrics": {"train_mse": 0.01, "test_mse": 0.05}, "spent": {}}
    (folder / "result.json").write_text(json.dumps(result))
    (target,) = _images(dataset, split.train)
    stored = {"train_image": target, "train_target": target, "draws": np.round(255 * draws).astype(np.uint8)}
    np.savez(folder / "prediction.npz", **stored | (arrays or {}))
    (folder / "done").touch()
    return folder


def held_out_images(dataset: DrapeDataset, cloth: str) -> np.ndarray:
    """Silhouettes of the samples that a cloth's fit has not seen."""
    (split,) = dataset.split("paper", [cloth])
    return _images(dataset, split.test)


def _images(dataset: DrapeDataset, rows: tuple[int, ...]) -> np.ndarray:
    return np.stack([dataset.image(row).numpy() for row in rows])
