"""Points of an atlas: one file for the drapes of one fabric with one effect, and all of them read together."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from cusick_bench.diagnosis.atlas.design import Design, at_fine
from cusick_bench.diagnosis.atlas.observation import ANGLES, statistics_of
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.files import BadFile, read_json_object, read_npz
from cusick_bench.files.shell_word import shell_word
from cusick_bench.runner.numerics import drape_numerics, raised_versions
from cusick_bench.runner.store import write_atomically
from cusick_bench.sim.effects import registered

DESIGN_FILE = "design.json"
_MOST = 1_000_000
"""Largest number of a design."""
_CODE = "code"  # name of the array in `write_point`
_BUILD_AGAIN = "delete it and repeat `cusick-bench atlas build`"


@dataclass(frozen=True, eq=False)
class Point:
    """Statistics of one fabric's drapes, with one effect or none.

    Attributes:
        value: Parameters of the effect in its order; empty for the base.
        statistics: Statistics of every sample and side, in the cloth's frame; NaN where a drape failed.
    """

    value: Float[ndarray, "effect_parameters"]
    statistics: Float[ndarray, "samples sides statistics"]


def code_of_point(name: str) -> str:
    """Versions of the code that decides a point, as text.

    Args:
        name: Effect, or `BASE` and the like.

    Returns:
        Text such as `engine 2, law paper 1, law plate 1, renderer 1`.
    """
    effect = registered().get(name.removesuffix(at_fine("")))
    versions = {}
    for law in ("paper", "plate"):  # of cheap drapes, and of fine ones
        versions |= drape_numerics(law, with_effects=effect is not None)
    if effect is not None:
        versions |= raised_versions("effect", [effect])
    return ", ".join(f"{part} {version}" for part, version in sorted(versions.items()))


def is_made(path: Path) -> bool:
    """Whether a point is there, made by the present versions of the code.

    Args:
        path: The point's file.

    Returns:
        False where it has yet to be made, or to be made again.

    Raises:
        BadFile: It is damaged.
    """
    if not path.exists():
        return False
    arrays = read_npz(path, remedy=_BUILD_AGAIN, wanted=lambda name: name == _CODE)
    return _code_of(arrays) == code_of_point(path.stem)


def _code_of(arrays: Mapping[str, ndarray]) -> str:
    return str(arrays.get(_CODE, ""))


def point_file(folder: Path, point: int, name: str) -> Path:
    """Path of a point's file.

    Args:
        folder: Folder of the atlas.
        point: Number of the fabric.
        name: Effect, or `BASE` and the like.

    Returns:
        The file.
    """
    return folder / "points" / f"{point:04d}" / f"{name}.npz"


def write_point(
    path: Path, value: Float[ndarray, "effect_parameters"], radii: Float[ndarray, "samples sides angles"]
) -> None:
    """Writes a point's file, which appears whole or not at all.

    It holds silhouettes, so that statistics can be chosen when the drapes are made, and the versions of the code.

    Args:
        path: The file; its folder is created.
        value: Parameters of the effect in its order; empty for the base.
        radii: Silhouettes of every sample and side in the cloth's frame [m]; NaN where a drape failed.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    content = BytesIO()
    np.savez(content, value=value, radii=radii.astype(np.float32), code=np.array(code_of_point(path.stem)))
    write_atomically(path, content.getvalue())


def read_point(path: Path) -> Point:
    """Reads a point's file.

    Args:
        path: The file.

    Returns:
        The point.

    Raises:
        BadFile: It is damaged, or made by other versions of the code.
    """
    arrays = read_npz(path, remedy=_BUILD_AGAIN)
    if _code_of(arrays) != code_of_point(path.stem):
        what = f"must be made by the present code ({code_of_point(path.stem)}), got {_code_of(arrays) or 'older code'}"
        raise BadFile(path, what, "repeat `cusick-bench atlas build`, which makes it again")
    shapes = [arrays[name].ndim if name in arrays else -1 for name in ("value", "radii")]
    if shapes != [1, 3] or {arrays[name].dtype.kind for name in ("value", "radii")} != {"f"}:
        raise BadFile(path, "must hold numbers: `value`, a row, and `radii`, of three dimensions", _BUILD_AGAIN)
    if arrays["radii"].shape[2] != ANGLES:
        raise BadFile(path, f"must hold radii at {ANGLES} angles, got {arrays['radii'].shape[2]}", _BUILD_AGAIN)
    return Point(arrays["value"], statistics_of(arrays["radii"].astype(np.float64)))


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
    names = [field.name for field in fields(Design)]
    wrong = [name for name, value in document.items() if name not in names or type(value) is not int]
    wrong += [name for name, value in document.items() if not wrong and not 0 <= value <= _MOST]
    if wrong:
        raise BadFile(
            path, f"must hold whole numbers from 0 to {_MOST} under {', '.join(names)}; {wrong[0]!r} is none", remedy
        )
    return Design(**document)


def read_points(folder: Path) -> tuple[Design, dict[str, dict[int, Point]]]:
    """Reads an atlas, as far as it is made.

    Args:
        folder: Folder of the atlas.

    Returns:
        Its design, and its points by effect and number of the fabric.

    Raises:
        DiagnosisError: No atlas there.
        BadFile: A file is damaged, or of an effect that has other parameters now.
    """
    path = folder / DESIGN_FILE
    if not path.exists():
        command = f"cusick-bench atlas build --out {shell_word(folder)}"
        raise DiagnosisError(f"no atlas in {folder}; make one with `{command}`")
    design = read_design(path)
    parameters = {name: len(effect.parameters) for name, effect in registered().items()}
    points: dict[str, dict[int, Point]] = {}
    for number, name in design.tasks():
        file = point_file(folder, number, name)
        if file.exists():
            point, count = read_point(file), parameters.get(name.removesuffix(at_fine("")), 0)
            if len(point.value) != count:
                what = f"`value` must hold the parameters of {name}, {count}, got {len(point.value)}"
                raise BadFile(file, f"{what}: the effect has changed", _BUILD_AGAIN)
            points.setdefault(name, {})[number] = point
    return design, points
