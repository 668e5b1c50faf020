"""Skirts for tests: of a size, of a cloth, of a fit's cell, and put on."""

import json
from pathlib import Path

import numpy as np
from numpy import ndarray

from cusick_bench.garment import Body, Cloth, Fitting, Skirt, SkirtSize, cloth_of_numbers
from cusick_bench.garment.fitting import AIR
from cusick_bench.sim.cloth.shape import smooth_field

SIZE = SkirtSize(waist=0.11, length=0.4, hem=0.25)


def skirt_cloth(bending: float = 1e-5, spread: float = 0.0, **numbers: float) -> Cloth:
    return cloth_of_numbers(density=0.2, bending=(bending, bending, bending), spread=spread, **numbers)


def laid_skirts(skirt: Skirt, draws: int, amplitude: float = 0.005) -> ndarray:
    fields = [smooth_field(amplitude, 0.08, np.random.default_rng(i)) for i in range(draws)]
    return np.stack([skirt.laid(field) for field in fields])


def fitted_skirts(
    skirt: Skirt, cloth: Cloth | None = None, draws: int = 1, body: Body | None = None, drag: float = AIR
) -> Fitting:
    parameters = (cloth or skirt_cloth()).draw(skirt.mesh, draws, np.random.default_rng(0))
    return Fitting.of(skirt, parameters, body=body, drag=drag)


def skirt_cell(folder: Path, *, law: str = "paper", **arrays: ndarray) -> Path:
    folder.mkdir()
    record = {"cloth": "wool_red", "solver": "homo", "settings": {"drape": {"law": law}}}
    (folder / "cell.json").write_text(json.dumps(record))
    tables = {"stretch": np.tile([150.0, 1.0, 150.0, 30.0], (6, 1)), "bending": np.full((3, 5), 2e-5)}
    np.savez_compressed(
        folder / "prediction.npz", allow_pickle=False, **({**tables, "density": np.array(0.27)} | arrays)
    )
    return folder


def learned_posterior(**changes: ndarray) -> dict[str, ndarray]:
    return {"posterior_mean": np.zeros(39), "posterior_scale": np.full(39, 0.4)} | changes
