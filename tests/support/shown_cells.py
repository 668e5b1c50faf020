"""Finished cells as the report shows them, written without running anything."""

import json
from pathlib import Path

import numpy as np

from cusick_bench.metrics import ruled_surface
from cusick_bench.solvers.reference.silhouettes import silhouette

ANGLES = 2 * np.pi * np.arange(720) / 720


def radii(folds: int = 7) -> np.ndarray:
    """Radii of a drape with so many folds at 720 angles [m]."""
    return 0.12 + 0.012 * np.cos(folds * ANGLES)


def write_cell(folder: Path, solver: str, cloth: str = "cotton_blue", seed: int = 0, *, draws: int = 1) -> Path:
    """A finished cell with all that the report shows; solvers with ":" in their name have no mesh."""
    cell = folder / "cells" / f"{solver.strip('<>')}-{cloth}-{seed}".replace(":", "_")
    cell.mkdir(parents=True)
    null = ":" in solver
    record = {"solver": solver, "kind": "null" if null else "solver", "cloth": cloth, "seed": seed, "test": [0, 1]}
    record |= {"dataset": "lab", "dataset_hash": "abc", "protocol": "paper", "settings": {}}
    metrics = {"train_mse": 0.01234, "test_mse": 0.05678, "draws": draws, "train_dc": 0.631, "train_dc_target": 0.642}
    metrics |= {"test_hausdorff_m": 0.0316, "train_folds": 7, "train_folds_target": 8}
    spent = {"forward_equivalents": 0 if null else 240, "wall_seconds": 61.5}
    (cell / "cell.json").write_text(json.dumps(record))
    (cell / "result.json").write_text(json.dumps(record | {"status": "done", "metrics": metrics, "spent": spent}))
    mesh = ruled_surface(radii(8)[::6], strips=3)
    arrays = {} if null else {"vertices": np.asarray(mesh.vertices), "faces": np.asarray(mesh.faces)}
    fit = silhouette(radii(8)).astype(np.float32)
    images = {"train_image": fit, "train_target": silhouette(radii(7)).astype(np.float32)}
    offered = np.repeat(np.round(255 * fit).astype(np.uint8)[None], draws, axis=0)
    np.savez_compressed(cell / "prediction.npz", draws=offered, **images, **arrays)
    steps = [{"forward_equivalents": 2 * i, "best_loss": 0.1 / i} for i in range(1, 40)]
    (cell / "trace.jsonl").write_text("\n".join(json.dumps(step) for step in steps) + '\n{"forward_eq')
    (cell / "done").touch()
    return cell
