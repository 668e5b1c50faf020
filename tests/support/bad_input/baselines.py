"""Tables of cells and of tracks: baselines for `check` as CSV and JSON, tables that `submit` adds to."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from bad_input.case import Case, Stock
from bad_input.odd_files import ODD

HEAD = "solver,cloth,seed,train_mse,test_mse\n"
ROW = "homo,fabric_7,0,0.05,0.06\n"


def _write(name: str, content: str | bytes, here: Path, stock: Stock) -> None:
    stock.copy_run(here)
    (here / name).write_bytes(content.encode() if isinstance(content, str) else content)


def _odd(name: str, make: Callable[[Path], None], here: Path, stock: Stock) -> None:
    stock.copy_run(here)
    make(here / name)


_CSV: dict[str, tuple[str | bytes, str]] = {
    "empty": ("", "lacks the column|holds no cells"),
    "head alone": (HEAD, "holds no cells"),
    "no seed": ("solver,cloth,train_mse\nhomo,fabric_7,0.05\n", "lacks the column 'seed'"),
    "a leaderboard": ("rank,solver,cloths,train_mse\n1,homo,5,0.05\n", "a leaderboard has a line a solver"),
    "a cell twice": (HEAD + ROW + ROW, "more than once"),
    "a column twice": ("solver,cloth,seed,train_mse,train_mse\nhomo,fabric_7,0,0.1,0.2\n", "'train_mse' twice"),
    "seed as text": (HEAD + ROW.replace(",0,", ",zero,"), "seed"),
    "half a seed": (HEAD + ROW.replace(",0,", ",0.5,"), "seed"),
    "no seed given": (HEAD + ROW.replace(",0,", ",,"), "seed"),
    "seed of 10^30": (HEAD + ROW.replace(",0,", ",1" + "0" * 30 + ","), "seed|large"),
    "a word for a metric": (HEAD + ROW.replace("0.05", "good"), "train_mse"),
    "infinite metric": (HEAD + ROW.replace("0.05", "inf"), "train_mse"),
    "negative metric": (HEAD + ROW.replace("0.05", "-1e9"), "train_mse must lie"),
    "formula for a metric": (HEAD + ROW.replace("0.05", "=0.05"), "train_mse"),
    "no solver": (HEAD + ROW.replace("homo", ""), "solver must be a name"),
    "solver null": (HEAD + ROW.replace("homo", "null"), "solver must be a name"),
    "unknown status": ("status," + HEAD + "unsure," + ROW, "status must be"),
    "too many cells in a line": (HEAD + ROW.replace("\n", ",1,2\n"), "7 fields for 5 columns"),
    "open quote": (HEAD + '"' + ROW, "CSV"),
    "UTF-16": ((HEAD + ROW).encode("utf-16"), "UTF-8"),
    "zero bytes": (bytes(1000), "zero byte"),
    "a page of HTML": ("<html></html>\n", "lacks the column"),
}
_JSON: dict[str, tuple[str, str]] = {
    "empty": ("", "JSON"),
    "null": ("null", "must hold"),
    "a number": ("3", "must hold"),
    "no cells": ('{"rows": []}', "must hold"),
    "empty cells": ('{"cells": []}', "lacks the column|holds no cells"),
    "cells of numbers": ('{"cells": [1, 2]}', "must hold"),
    "cells within cells": ('{"cells": [[{"solver": "homo"}]]}', "must hold"),
    "metrics a list": (
        '{"cells": [{"solver": "homo", "cloth": "a", "seed": 0, "metrics": [1]}]}',
        "metrics|must hold|no table",
    ),
    "metrics as text": (
        '{"cells": [{"solver": "homo", "cloth": "a", "seed": 0, "metrics": "good"}]}',
        "metrics|must hold|no table",
    ),
    "metric a list": ('[{"solver": "homo", "cloth": "a", "seed": 0, "train_mse": [0.1]}]', "train_mse"),
    "metric an object": ('[{"solver": "homo", "cloth": "a", "seed": 0, "train_mse": {}}]', "train_mse"),
    "metric true": ('[{"solver": "homo", "cloth": "a", "seed": 0, "train_mse": true}]', "train_mse"),
    "metric of 1e400": ('[{"solver": "homo", "cloth": "a", "seed": 0, "train_mse": 1e400}]', "too large"),
    "NaN": ('[{"solver": "homo", "cloth": "a", "seed": 0, "train_mse": NaN}]', "NaN is no JSON"),
    "solver a list": ('[{"solver": ["homo"], "cloth": "a", "seed": 0, "train_mse": 0.1}]', "solver must be a name"),
    "seed an object": ('[{"solver": "homo", "cloth": "a", "seed": {}, "train_mse": 0.1}]', "seed"),
    "a key twice": ('[{"solver": "homo", "solver": "bdp", "cloth": "a", "seed": 0}]', "stands twice"),
    "lists within each other": ("[" * 9999 + "]" * 9999, "nested deeper"),
    "status a list": ('[{"solver": "homo", "cloth": "a", "seed": 0, "status": ["done"], "train_mse": 0.1}]', "status"),
}
_TRACKS: dict[str, tuple[str | bytes, str]] = {
    "other columns": ("a,b\n1,2\n", "no column 'row'"),
    "a column twice": ("row,row\n1,2\n", "'row' twice"),
    "too many cells in a line": ("row,solver\n1,2,3\n", "3 fields for 2 columns"),
    "UTF-16": ("row,solver\n".encode("utf-16"), "UTF-8"),
    "zero bytes": (bytes(100), "zero byte"),
    "open quote": ('row,solver\n"1,2\n', "CSV"),
    "a lone head of others": ("solver;cloth\n", "must have commas between cells"),
}

_CHECK = "check {here}/run --json --against {here}/b"
_SUBMIT = "submit {here}/run --json --track t --out {here}/t.csv"

CASES = [
    *(Case(f"CSV: {n}", _CHECK + ".csv", partial(_write, "b.csv", c), refused=said) for n, (c, said) in _CSV.items()),
    *(
        Case(f"JSON: {n}", _CHECK + ".json", partial(_write, "b.json", c), refused=said)
        for n, (c, said) in _JSON.items()
    ),
    *(
        Case(
            f"CSV: {n}",
            _CHECK + ".csv",
            partial(_odd, "b.csv", make),
            refused=said + "|no baseline at|no cells at|holds no cells",
        )
        for n, (make, said) in ODD.items()
    ),
    *(
        Case(
            f"JSON: {n}",
            _CHECK + ".json",
            partial(_odd, "b.json", make),
            refused=said + "|no baseline at|no cells at|holds no cells",
        )
        for n, (make, said) in ODD.items()
        if n != "folder"
    ),
    *(Case(f"track: {n}", _SUBMIT, partial(_write, "t.csv", c), refused=said) for n, (c, said) in _TRACKS.items()),
    *(
        Case(
            f"track: {n}",
            _SUBMIT,
            partial(_odd, "t.csv", make),
            refused=said + "|is no table|[Ii]s a directory|[Ss]ymbolic links|loop",
        )
        for n, (make, said) in ODD.items()
        if n not in ("link to nothing", "loop of links")  # which the new table replaces
    ),
]
