"""Fitted atlases for `diagnose`, and folders of an atlas' points for `atlas fit`."""

import io
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bad_input.case import Case, Stock
from bad_input.results import NPZ, archive, arrays, header

DIAGNOSE = "diagnose {here}/lab --samples 0 --json --out {here}/d --atlas {here}/atlas.npz"
FIT = "atlas fit {here}/a --out {here}/fitted.npz --json"

Arrays = dict[str, np.ndarray]


def _put(content: bytes | Callable[[Path], None], here: Path, stock: Stock) -> None:
    stock.copy_lab(here)
    path = here / "atlas.npz"
    if callable(content):
        content(path)
    else:
        path.write_bytes(content)


def _edited(change: Callable[[Arrays], Arrays], here: Path, stock: Stock) -> None:
    """The installed atlas with something changed."""
    with np.load(stock.atlas / "atlas.npz", allow_pickle=False) as file:
        found = change(dict(file))
    file = io.BytesIO()
    np.savez(file, **found)  # pyright: ignore[reportArgumentType]
    _put(file.getvalue(), here, stock)


def _with(name: str, change: Callable[[np.ndarray], Any]) -> Callable[[Arrays], Arrays]:
    return lambda found: found | {name: np.asarray(change(found[name]))}


def _about(change: Callable[[dict[str, Any]], Any]) -> Callable[[Arrays], Arrays]:
    return lambda found: found | {"about": np.array(json.dumps(change(json.loads(str(found["about"])))))}


def _hole(value: float) -> Callable[[np.ndarray], np.ndarray]:
    def holed(array: np.ndarray) -> np.ndarray:
        array = array.copy()
        array.flat[0] = value
        return array

    return holed


_CHANGED: dict[str, Callable[[Arrays], Arrays]] = {
    "NaN in the correlation": _with("correlation", _hole(np.nan)),
    "infinity in the weights": _with("base/0/weights", _hole(np.inf)),
    "NaN in a covariance": _with("base/0/covariance", _hole(np.nan)),
    "NaN in a residual": _with("log_sd/0/residual", _hole(np.nan)),
    "weights of texts": _with("base/0/weights", lambda array: array.astype(str)),
    "weights of another shape": _with("base/0/weights", lambda array: array[:-1]),
    "weights without numbers": _with("base/0/weights", lambda array: array[:0]),
    "weights a number": _with("base/0/weights", lambda array: 1.0),
    "correlation of another size": _with("correlation", lambda array: array[:-1, :-1]),
    "discrepancy of another size": _with("discrepancy", lambda array: array[:-1]),
    "a response of another shape": lambda found: (
        found | {next(n for n in found if n.endswith("/gain/weights")): np.ones((2, 2), np.float32)}
    ),
    "no correlation": lambda found: {name: value for name, value in found.items() if name != "correlation"},
    "no columns": lambda found: {name: value for name, value in found.items() if name != "base/0/columns"},
    "nothing about it": lambda found: {name: value for name, value in found.items() if name != "about"},
    "about it: no JSON": lambda found: found | {"about": np.array("{")},
    "about it: a number": lambda found: found | {"about": np.array(5)},
    "about it: a list": _about(lambda about: []),
    "about it: other statistics": _about(lambda about: about | {"statistics": ["size"]}),
    "about it: responses a list": _about(lambda about: about | {"responses": [1]}),
    "about it: unknown response": _about(lambda about: about | {"responses": {"wind": True}}),
    "about it: no calibration": _about(lambda about: {k: v for k, v in about.items() if k != "calibration"}),
    "about it: calibration as text": _about(lambda about: about | {"calibration": {"inflation": "much"}}),
    "about it: no inflation": _about(lambda about: about | {"calibration": {"inflation": 0.0}}),
    "about it: negative discrepancy": _about(lambda about: about | {"calibration": {"discrepancy": -1.0}}),
    "terms that there are not": _with("base/1/columns", lambda array: array + 1000),
    "terms with negative numbers": _with("base/1/columns", lambda array: -array - 1),
    "more terms than weights": _with("base_spread/1/columns", lambda array: np.arange(7.0)),
    "about it: a mismatch of one number": _about(
        lambda about: about | {"responses": {name: [False, [0.3]] for name in about["responses"]}}
    ),
    "about it: unknown calibration": _about(lambda about: about | {"calibration": {"colour": 1}}),
}


def _design(content: str, here: Path, stock: Stock) -> None:
    (here / "a").mkdir()
    (here / "a" / "design.json").write_text(content)


def _point(content: bytes | Callable[[Path], None], here: Path, stock: Stock) -> None:
    folder = here / "a" / "points" / "0000"
    folder.mkdir(parents=True)
    (here / "a" / "design.json").write_text('{"points": 60, "stiff_points": 0}')
    if callable(content):
        content(folder / "base.npz")
    else:
        (folder / "base.npz").write_bytes(content)


_DESIGNS: dict[str, tuple[str, str]] = {
    "empty": ("", "cannot be read as JSON"),
    "a list": ("[]", "must hold one JSON object"),
    "unknown key": ('{"points": 60, "colour": 1}', "'colour' is none"),
    "points as text": ('{"points": "many"}', "'points' is none"),
    "points true": ('{"points": true}', "'points' is none"),
    "half a point": ('{"points": 60.5}', "'points' is none"),
    "negative points": ('{"points": -5}', "'points' is none"),
    "10^12 points": ('{"points": 1000000000000}', "'points' is none"),
    "points twice": ('{"points": 60, "points": 61}', "stands twice"),
    "no points made": ('{"points": 60}', "no|at least|build"),
}
_POINTS: dict[str, bytes] = {
    "value alone": arrays(value=np.zeros(0)),
    "radii of one dimension": arrays(value=np.zeros(0), radii=np.zeros(5)),
    "radii of 10^12 numbers": archive(value=header("(0,)"), radii=header("(10000, 10000, 10000)")),
    "radii of texts": arrays(value=np.zeros(0), radii=np.full((4, 2, 360), "a")),
    "too few radii": arrays(value=np.zeros(0), radii=np.ones((4, 2, 36))),
}

CASES = [
    *(Case(n, DIAGNOSE, partial(_put, content), refused="atlas.npz") for n, content in NPZ.items()),
    *(
        Case(n, DIAGNOSE, partial(_edited, change), refused="atlas.npz cannot be used|atlas.npz: ")
        for n, change in _CHANGED.items()
    ),
    *(Case(f"design: {n}", FIT, partial(_design, content), refused=said) for n, (content, said) in _DESIGNS.items()),
    *(
        Case(f"point: {n}", FIT, partial(_point, content), refused="base.npz|needs at least 60 fabrics")
        for n, content in _POINTS.items()
    ),
    *(
        Case(f"point: {n}", FIT, partial(_point, content), refused="base.npz|no points|no fabric|at least")
        for n, content in NPZ.items()
        if n in ("empty", "cut short", "objects", "device", "folder", "4 GB of zeros", "loop of links")
    ),
]
