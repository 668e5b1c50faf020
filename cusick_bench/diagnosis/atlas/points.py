"""Points of an atlas: one file for the drapes of one fabric with one effect, and all of them read together."""

import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import get_args

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.design import Design
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.files import BadFile, read_json_object, read_npz
from cusick_bench.sim.engine.settings import Clamp

DESIGN_FILE = "design.json"
_MOST = 1_000_000
"""Largest number of a design."""


@dataclass(frozen=True, eq=False)
class Point:
    """Statistics of one fabric's drapes, with one effect or none.

    Attributes:
        value: Parameters of the effect in its order; empty for the base.
        statistics: Statistics of every sample and side, in the cloth's frame; NaN where a drape failed.
    """

    value: Float[ndarray, "effect_parameters"]
    statistics: Float[ndarray, "samples sides statistics"]


def point_file(folder: Path, point: int, name: str) -> Path:
    """Where a point is kept.

    Args:
        folder: Folder of the atlas.
        point: Number of the fabric.
        name: Effect, or `BASE` and the like.

    Returns:
        The file.
    """
    return folder / "points" / f"{point:04d}" / f"{name}.npz"


def write_point(path: Path, point: Point) -> None:
    """Writes a point's file, which appears whole or not at all.

    Args:
        path: The file; its folder is created.
        point: What it will hold.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(f".{os.getpid()}.tmp")
    with open(partial, "wb") as file:
        np.savez(file, value=point.value, statistics=point.statistics)
    partial.replace(path)


def read_point(path: Path) -> Point:
    """Reads a point's file.

    Args:
        path: The file.

    Returns:
        The point.

    Raises:
        BadFile: It is damaged.
    """
    remedy = "delete it and repeat `cusick-bench atlas build`"
    arrays = read_npz(path, remedy=remedy)
    shapes = [arrays[name].ndim if name in arrays else -1 for name in ("value", "statistics")]
    if shapes != [1, 3] or {arrays[name].dtype.kind for name in ("value", "statistics")} != {"f"}:
        raise BadFile(path, "must hold numbers: `value`, a row, and `statistics`, of three dimensions", remedy)
    return Point(arrays["value"], arrays["statistics"])


def read_design(path: Path) -> Design:
    """Reads what an atlas is made of.

    Args:
        path: Its `design.json`.

    Returns:
        The design.

    Raises:
        BadFile: It is damaged.
    """
    remedy = "give a folder that `cusick-bench atlas build` has filled"
    document = read_json_object(path, remedy=remedy)
    clamp = document.pop("clamp", "whole")  # not said in designs of before there was a choice
    if clamp not in get_args(Clamp):
        raise BadFile(path, f"must say {' or '.join(get_args(Clamp))} under clamp, got {str(clamp)[:60]!r}", remedy)
    names = [field.name for field in fields(Design) if field.name != "clamp"]
    wrong = [name for name, value in document.items() if name not in names or type(value) is not int]
    wrong += [name for name, value in document.items() if not wrong and not 0 <= value <= _MOST]
    if wrong:
        raise BadFile(
            path, f"must hold whole numbers from 0 to {_MOST} under {', '.join(names)}; {wrong[0]!r} is none", remedy
        )
    return Design(**document, clamp=clamp)


def read_points(folder: Path) -> tuple[Design, dict[str, dict[int, Point]]]:
    """Reads an atlas, as far as it is made.

    Args:
        folder: Folder of the atlas.

    Returns:
        Its design, and its points by effect and number of the fabric.

    Raises:
        DiagnosisError: No atlas there.
    """
    path = folder / DESIGN_FILE
    if not path.exists():
        raise DiagnosisError(f"no atlas in {folder}; make one with `cusick-bench atlas build --out {folder}`")
    design = read_design(path)
    points: dict[str, dict[int, Point]] = {}
    for number, name in design.tasks():
        file = point_file(folder, number, name)
        if file.exists():
            points.setdefault(name, {})[number] = read_point(file)
    return design, points
