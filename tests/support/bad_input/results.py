"""Results folders: `result.json`, `cell.json`, `run.json`, `verified.json`, predictions and traces that are damaged."""

import io
import json
import struct
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bad_input.case import Case, Outcome, Stock
from bad_input.odd_files import ODD
from cusick_bench.problem.cloth_prior import CLOTH

BOARD = "leaderboard {here}/run --json"
SUBMIT = "submit {here}/run --track t --out {here}/t.csv --json"
VERIFY = "verify {here}/run --data {here}/lab --solver null:disc --json"
SKIRT = "garment skirt --json --vertices 200 --draws 1 --from {here}/run/cells/homo"
MATERIAL = "export material {here}/run/cells/homo --for clo --out {here}/clo"
AGAIN = "run --json --data {here}/lab --out {here}/run --vertices 97 --steps 10 --budget 4 --solver null:disc"

Change = Callable[[dict[str, Any]], Any]


def cell(run: Path, solver: str) -> Path:
    """Folder of a solver's cell."""
    return next(p.parent for p in run.glob("cells/*/cell.json") if json.loads(p.read_text())["solver"] == solver)


def _put(content: str | bytes | Callable[[Path], None], path: Path) -> None:
    if callable(content):
        path.unlink()
        content(path)
    else:
        path.write_bytes(content.encode() if isinstance(content, str) else content)


def _file(name: str, content: str | bytes | Callable[[Path], None], here: Path, stock: Stock) -> None:
    _put(content, cell(stock.copy_run(here), "null:disc") / name)


def _edited(name: str, change: Change, here: Path, stock: Stock) -> None:
    path = cell(stock.copy_run(here), "null:disc") / name
    document = json.loads(path.read_text())
    path.write_text(json.dumps(change(document)))


def _run_file(name: str, content: str | bytes | Callable[[Path], None], here: Path, stock: Stock) -> None:
    path = stock.copy_run(here) / name
    path.touch()
    _put(content, path)


def _run_edited(name: str, change: Change, here: Path, stock: Stock) -> None:
    path = stock.copy_run(here) / name
    path.write_text(json.dumps(change(json.loads(path.read_text()) if path.exists() else {})))


def _set(**values: Any) -> Change:
    return lambda document: document | values


def _without(name: str) -> Change:
    return lambda document: {key: value for key, value in document.items() if key != name}


def _one_left(outcome: Outcome) -> bool:
    """Whether the damaged cell is named, and the other still ranked."""
    solvers = {row["solver"] for row in outcome.document["rows"] if row["kind"] == "solver"}
    skipped = outcome.document["skipped"]
    return solvers == {"homo"} and len(skipped) == 1 and bool(skipped[0]["reason"])


def _both_there(outcome: Outcome) -> bool:
    return {"homo", "null:disc"} <= {row["solver"] for row in outcome.document["rows"]}


_deep = '{"metrics": ' + "[" * 5000 + "]" * 5000 + "}"
_TEXTS: dict[str, str | bytes | Callable[[Path], None]] = {
    "empty": "",
    "half of it": '{"solver": "null:disc", "kind": "nu',
    "a list": "[]",
    "null": "null",
    "a number": "1",
    "zero bytes": bytes(4096),
    "binary": bytes(range(256)),
    "UTF-16": '{"solver": 1}'.encode("utf-16"),
    "lists within each other": _deep,
    "a key twice": '{"solver": "null:disc", "solver": "homo"}',
    "NaN": '{"solver": NaN}',
    **{name: make for name, (make, _) in ODD.items() if name != "link to nothing"},
}

_RESULTS: dict[str, Change] = {
    "no solver": _without("solver"),
    "no metrics": _without("metrics"),
    "solver a list": _set(solver=["null:disc"]),
    "solver null": _set(solver=None),
    "cloth an object": _set(cloth={"name": "fabric_7"}),
    "seed as text": _set(seed="zero"),
    "seed of 10^39": _set(seed=10**39),
    "seed a list": _set(seed=[0]),
    "metrics a list": _set(metrics=[0.1]),
    "metrics a number": _set(metrics=0.1),
    "metrics within metrics": lambda d: d | {"metrics": {"train_mse": {"train_mse": 0.01}}},
    "metric as a word": lambda d: d | {"metrics": d["metrics"] | {"train_mse": "small"}},
    "metric true": lambda d: d | {"metrics": d["metrics"] | {"test_mse": True}},
    "metric of -1e9": lambda d: d | {"metrics": d["metrics"] | {"test_mse": -1e9}},
    "metric above one": lambda d: d | {"metrics": d["metrics"] | {"train_mse": 7.0}},
    "train_mse null": lambda d: d | {"metrics": d["metrics"] | {"train_mse": None}},
    "spent a list": _set(spent=[1]),
    "spent as text": _set(spent={"forward": "much"}),
    "settings a list": _set(settings=[1]),
    "settings as text": _set(settings="none"),
    "causes a number": _set(settings={"causes": 5}),
    "test a number": _set(test=5),
    "test of texts": _set(test=["one"]),
    "numerics a list": _set(numerics=[1]),
    "numerics of lists": _set(numerics={"law": [1]}),
    "status a list": _set(status=["done"]),
    "kind a number": _set(kind=3),
}  # fmt: skip

_RUNS: dict[str, Change] = {
    "command a number": _set(command=5),
    "command an object": _set(command={"a": 1}),
    "command of lists": _set(command=[["--data"], {"x": 1}]),
    "command with an open option": _set(command=["cusick-bench", "run", "--data"]),
    "cells a number": _set(cells=5),
    "cells of objects": _set(cells=[{}, [], None]),
    "history a number": _set(history=5),
    "history of numbers": _set(history=[1, None, "x"]),
    "history within history": _set(history=[{"history": [{"history": []}], "cells": 3}]),
    "code a list": _set(code=[1]),
    "code of lists": _set(code={"commit": ["a"], "dirty": {}}),
    "processor an object": _set(processor={"a": 1}, cores=[2]),
    "time a list": _set(time=[1]),
    "dataset a number": _set(dataset=3),
}

_VERIFIED: dict[str, Any] = {
    "cells as numbers": {"a": 1},
    "cells as lists": {"a": [1]},
    "cells null": {"a": None},
    "status a list": {"a": {"status": ["verified"]}},
    "files a list": {"a": {"status": "verified", "files": [1]}},
    "of another cell": {"../../etc": {"status": "verified", "files": {}}},
}


def _not_verified(outcome: Outcome) -> bool:
    return outcome.document["verified"] == 0


_CELLS: dict[str, Change] = {
    "no settings": _without("settings"),
    "settings a list": _set(settings=[]),
    "drape as text": lambda d: d | {"settings": d["settings"] | {"drape": "paper"}},
    "drape with an unknown key": lambda d: d | {"settings": d["settings"] | {"drape": {"speed": 1}}},
    "negative steps": lambda d: d | {"settings": d["settings"] | {"drape": d["settings"]["drape"] | {"steps": -1}}},
    "budget a number": lambda d: d | {"settings": d["settings"] | {"budget": 5}},
    "vertices as text": lambda d: d | {"settings": d["settings"] | {"vertices": "many"}},
    "10^9 vertices": lambda d: d | {"settings": d["settings"] | {"vertices": 10**9}},
    "unknown solver": _set(solver="nobody"),
    "solver a number": _set(solver=5),
    "train a number": _set(train=5),
    "train beyond the data": _set(train=[99]),
    "test of texts": _set(test=["a"]),
    "numerics a list": _set(numerics=[1]),
    "seed negative": _set(seed=-1),
    "seed a list": _set(seed=[1]),
}


def _unreadable(outcome: Outcome) -> bool:
    return outcome.document["cells"][0]["status"] in ("unreadable", "differs")


def header(shape: str, dtype: str = "<f8", *, fortran: str = "False") -> bytes:
    """Header of an array in a .npz file, whatever follows."""
    text = f"{{'descr': '{dtype}', 'fortran_order': {fortran}, 'shape': {shape}, }}".encode()
    text += b" " * (-(10 + len(text) + 1) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


def archive(**entries: bytes) -> bytes:
    """A .npz file of these entries."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as made:
        for name, content in entries.items():
            made.writestr(f"{name}.npy", content)
    return file.getvalue()


def arrays(**values: Any) -> bytes:
    """A .npz file of these arrays."""
    file = io.BytesIO()
    np.savez(file, **values)
    return file.getvalue()


_pickled = io.BytesIO()
np.save(_pickled, np.array([{"a": 1}], dtype=object), allow_pickle=True)
_whole = arrays(stretch=np.ones((6, 4)), bending=np.ones((3, 5)), density=np.array(0.2))
_table = {"bending": np.ones((3, 5)), "density": np.array(0.2)}
NPZ: dict[str, bytes | Callable[[Path], None]] = {
    "empty": b"",
    "text": b"no archive",
    "cut short": _whole[: len(_whole) // 2],
    "a byte changed": _whole[:200] + b"\xff\xff\xff" + _whole[203:],
    "zip without arrays": archive(),
    "10^12 numbers in the header": archive(stretch=header("(1000000000000,)")),
    "10^30 numbers in the header": archive(stretch=header("(10**30,)")),
    "10^18 x 10^18 numbers": archive(stretch=header("(1000000000000000000, 1000000000000000000)")),
    "negative shape": archive(stretch=header("(-5,)")),
    "shape of words": archive(stretch=header("('a',)")),
    "header of code": archive(stretch=header("__import__('os').mkdir('exploited')")),
    "header without an end": archive(stretch=b"\x93NUMPY\x01\x00\xff\xff{"),
    "header of version 9": archive(stretch=b"\x93NUMPY\x09\x00" + bytes(100)),
    "objects": archive(stretch=_pickled.getvalue()),
    "unknown type": archive(stretch=header("(3,)", "<q99")),
    "2 GB of zeros": archive(stretch=header("(268435456,)")),
    **{name: make for name, (make, _) in ODD.items()},
}
_PREDICTIONS: dict[str, tuple[bytes, str]] = {
    "no stiffness": (arrays(draws=np.zeros((1, 4, 4))), "has no stretch, bending, density"),
    "stiffness of texts": (arrays(stretch=np.array(["a"]), **_table), "stretch must be tables"),
    "stiffness of another shape": (arrays(stretch=np.ones((5, 4)), **_table), "stretch must be tables"),
    "stiffness of whole numbers": (arrays(stretch=np.ones((6, 4), int), **_table), "stretch must be tables"),
    "stiffness not finite": (arrays(stretch=np.full((6, 4), np.nan), **_table), "must be finite"),
    "negative stiffness": (arrays(stretch=-np.ones((6, 4)), **_table), "positive stiffness"),
    "no table": (arrays(stretch=np.ones((0, 6, 4)), **_table), "stretch must be tables"),
    "density zero": (
        arrays(stretch=np.ones((6, 4)), bending=np.ones((3, 5)), density=np.array(0.0)),
        "areal density must",
    ),
    "density as text": (
        arrays(stretch=np.ones((6, 4)), bending=np.ones((3, 5)), density=np.array("0.2")),
        "areal density|numbers",
    ),
    "density of 190 kg/m2": (
        arrays(stretch=np.ones((6, 4)), bending=np.ones((3, 5)), density=np.array(190.0)),
        "areal density",
    ),
    "posterior without a scale": (
        arrays(stretch=np.ones((6, 4)), posterior_mean=np.zeros(39), **_table),
        "posterior_scale",
    ),
    "posterior of matrices": (
        arrays(stretch=np.ones((6, 4)), posterior_mean=np.zeros((39, 2)), posterior_scale=np.zeros((39, 2)), **_table),
        "posterior",
    ),
    "posterior of texts": (
        arrays(
            stretch=np.ones((6, 4)), posterior_mean=np.array(["a"] * 39), posterior_scale=np.array(["a"] * 39), **_table
        ),
        "posterior",
    ),
    "cloths of texts": (
        arrays(stretch=np.ones((6, 4)), posterior_cloths=np.full((2, CLOTH), "a"), **_table),
        "posterior_cloths",
    ),
    "posterior a number": (arrays(stretch=np.ones((6, 4)), posterior_mean=np.array(1.0), **_table), "posterior"),
}


_SETTINGS: dict[str, Any] = {
    "settings a list": [1],
    "settings as text": "none",
    "drape null": {"drape": None},
    "law a list": {"drape": {"law": ["paper"]}},
    "causes a number": {"causes": 5},
    "causes as text": {"causes": "density-bias"},
    "causes of objects": {"causes": [{"density-bias": 0.1}]},
}


def _settings(name: str, settings: Any, here: Path, stock: Stock) -> None:
    run = stock.copy_run(here)
    path = cell(run, "homo").rename(run / "cells" / "homo") / name
    path.write_text(json.dumps(json.loads(path.read_text()) | {"settings": settings}))


def _prediction(content: bytes | Callable[[Path], None], here: Path, stock: Stock) -> None:
    run = stock.copy_run(here)
    folder = cell(run, "homo").rename(run / "cells" / "homo")
    _put(content, folder / "prediction.npz")


def _no_folder(here: Path, stock: Stock) -> None:
    stock.copy_run(here)


def _resumed(name: str, content: str | bytes, here: Path, stock: Stock) -> None:
    """A cell that was stopped after this was written."""
    folder = cell(stock.copy_run(here), "homo")
    for other in ("done", "result.json", "prediction.npz"):
        (folder / other).unlink()
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)


def _homo_done(outcome: Outcome) -> bool:
    return [row["status"] for row in outcome.document["cells"]] == ["done"]


_FED: dict[str, tuple[str, str | bytes]] = {
    "empty trace": ("trace.jsonl", ""),
    "trace of half a line": ("trace.jsonl", '{"kind": "lo'),
    "trace of zero bytes": ("trace.jsonl", bytes(100)),
    "trace of other things": ("trace.jsonl", '{"a": 1}\n[]\n5\nnull\n'),
    "trace of wrong types": ("trace.jsonl", '{"kind": 3, "digest": [], "loss": "x", "arrays": 5}\n'),
    "trace that is nested deep": ("trace.jsonl", "[" * 100_000 + ', "check": "0"}\n'),
    "trace of 10^12 numbers": (
        "trace.jsonl",
        '{"kind": "loss", "digest": "", "loss": 1, "arrays": {"vertices": [1000000000000]}}\n',
    ),
    "trace of negative shapes": (
        "trace.jsonl",
        '{"kind": "loss", "digest": "", "loss": 1, "arrays": {"vertices": [-5]}}\n',
    ),
    "empty arrays": ("state.bin", b""),
    "arrays cut short": ("state.bin", bytes(11)),
}

_AGAIN_HOMO = AGAIN.replace("null:disc", "homo")

CASES = [
    *(Case(f"result.json: {n}", BOARD, partial(_file, "result.json", c), right=_one_left) for n, c in _TEXTS.items()),
    *(
        Case(f"result.json: {n}", BOARD, partial(_edited, "result.json", c), right=_one_left)
        for n, c in _RESULTS.items()
    ),
    *(Case(f"run.json: {n}", SUBMIT, partial(_run_file, "run.json", c), right=_both_there) for n, c in _TEXTS.items()),
    *(Case(f"run.json: {n}", SUBMIT, partial(_run_edited, "run.json", c), right=_both_there) for n, c in _RUNS.items()),
    *(
        Case(f"verified.json: {n}", SUBMIT, partial(_run_file, "verified.json", c), right=_not_verified)
        for n, c in _TEXTS.items()
    ),
    *(
        Case(
            f"verified.json: {n}", SUBMIT, partial(_run_edited, "verified.json", lambda d, v=v: v), right=_not_verified
        )
        for n, v in _VERIFIED.items()
    ),
    *(
        Case(f"cell.json: {n}", VERIFY, partial(_edited, "cell.json", c), right=_unreadable, codes=(1,))
        for n, c in _CELLS.items()
    ),
    *(
        Case(f"prediction.npz: {n}", SKIRT, partial(_prediction, c), refused="prediction.npz|has no")
        for n, c in NPZ.items()
    ),
    *(
        Case(f"prediction.npz: {n}", SKIRT, partial(_prediction, c), refused=said)
        for n, (c, said) in _PREDICTIONS.items()
    ),
    *(
        Case(f"skirt of cell.json: {n}", SKIRT, partial(_settings, "cell.json", c), refused="settings|law must be")
        for n, c in _SETTINGS.items()
    ),
    *(
        Case(f"material of result.json: {n}", MATERIAL, partial(_settings, "result.json", c), refused="settings")
        for n, c in _SETTINGS.items()
        if n != "law a list"  # of which a material needs nothing
    ),
    *(
        Case(f"stopped with {n}", _AGAIN_HOMO, partial(_resumed, name, c), right=_homo_done)
        for n, (name, c) in _FED.items()
    ),
    Case("skirt of a cell without stiffness", SKIRT.replace("cells/homo", "cells"), _no_folder, refused="cell.json"),
    Case("skirt of no cell", SKIRT, _no_folder, refused="no result at"),
    Case(
        "skirt of a link to itself",
        "garment skirt --from {here}/loop",
        lambda h, s: (h / "loop").symlink_to(h / "loop"),
        refused="no result|[Ll]oop",
    ),
]
