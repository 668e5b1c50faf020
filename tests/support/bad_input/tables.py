"""`fabrics.csv`: weights and thicknesses of fabrics, as labs write them and as they should not."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from bad_input.case import Case, Outcome, Stock
from bad_input.odd_files import ODD

INFO = "data info {here}/lab --json"
HEAD = "fabric,areal_density_kg_m2,thickness_m\n"


def _write(content: str | bytes, here: Path, stock: Stock) -> None:
    path = stock.copy_lab(here) / "fabrics.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)


def _odd(make: Callable[[Path], None], here: Path, stock: Stock) -> None:
    path = stock.copy_lab(here) / "fabrics.csv"
    path.unlink()
    make(path)


def _weighs(density: float | None, thickness: float | None) -> Callable[[Outcome], bool]:
    def right(outcome: Outcome) -> bool:
        (cloth,) = outcome.document["cloths"]
        return (cloth["areal_density_kg_m2"], cloth["thickness_m"]) == (density, thickness)

    return right


_READ: dict[str, tuple[str | bytes, float | None, float | None]] = {
    "plain": (HEAD + "7,0.2,0.0004\n", 0.2, 0.0004),
    "byte order mark": ("\ufeff" + HEAD + "7,0.2,0.0004\n", 0.2, 0.0004),
    "lines that end as in Windows": (HEAD.replace("\n", "\r\n") + "7,0.2,0.0004\r\n", 0.2, 0.0004),
    "lines that end as on old Macs": (HEAD.replace("\n", "\r") + "7,0.2,0.0004\r", 0.2, 0.0004),
    "blanks around cells": ("fabric , areal_density_kg_m2 , thickness_m\n 7 , 0.2 , 0.0004 \n", 0.2, 0.0004),
    "quoted cells": ('"fabric","areal_density_kg_m2","thickness_m"\n"7","0.2","0.0004"\n', 0.2, 0.0004),
    "blank lines": ("\n" + HEAD + "\n\n7,0.2,0.0004\n\n", 0.2, 0.0004),
    "columns in another order": ("thickness_m,fabric,areal_density_kg_m2\n0.0004,7,0.2\n", 0.2, 0.0004),
    "further columns": ("fabric,areal_density_kg_m2,thickness_m,maker\n7,0.2,0.0004,=1+1\n", 0.2, 0.0004),
    "unknown weight": (HEAD + "7,,0.0004\n", None, 0.0004),
    "no thickness": ("fabric,areal_density_kg_m2\n7,0.2\n", 0.2, None),
    "short line": (HEAD + "7,0.2\n", 0.2, None),
    "another spelling": (HEAD + "Fabric 7,0.2,0.0004\n", 0.2, 0.0004),
    "fabrics that are not there": (HEAD + "7,0.2,0.0004\n99,0.3,0.0004\n../x,0.3,\n", 0.2, 0.0004),
    "no fabric": (HEAD, None, None),
    "number with an exponent": (HEAD + "7,2e-1,4E-4\n", 0.2, 0.0004),
    "plus sign": (HEAD + "7,+0.2,+.0004\n", 0.2, 0.0004),
}

_REFUSED: dict[str, tuple[str | bytes, str]] = {
    "empty file": ("", "needs the columns"),
    "no head": ("7,0.2,0.0004\n", "needs the columns"),
    "other columns": ("cloth,weight\n7,0.2\n", "needs the columns"),
    "semicolons": (HEAD.replace(",", ";") + "7;0.2;0.0004\n", "must have commas between cells, got semicolons"),
    "decimal commas": (HEAD + "7,0,2,0,0004\n", "5 fields for 3 columns"),
    "quoted decimal comma": (HEAD + '7,"0,2",0.0004\n', "areal density must be a number"),
    "weight in g/m2": (HEAD + "7,190,0.0004\n", "at most 5.0 kg/m2, got 190"),
    "weight below any cloth's": (HEAD + "7,1e-12,0.0004\n", "areal density must be .*got 1e-12"),
    "weight of a gas": (HEAD + "7,0.0002,0.0004\n", "areal density must be .*got 0.0002"),
    "weight of zero": (HEAD + "7,0,0.0004\n", "> 0 kg/m2, got 0"),
    "weight of minus zero": (HEAD + "7,-0.0,0.0004\n", "> 0 kg/m2"),
    "negative weight": (HEAD + "7,-0.2,0.0004\n", "> 0 kg/m2"),
    "weight that is no number": (HEAD + "7,nan,0.0004\n", "areal density must be a number"),
    "infinite weight": (HEAD + "7,inf,0.0004\n", "at most 5.0|must be a number"),
    "weight of 1e400": (HEAD + "7,1e400,0.0004\n", "at most 5.0|must be a number"),
    "a word for a weight": (HEAD + "7,heavy,0.0004\n", "got heavy"),
    "a formula for a weight": (HEAD + "7,=0.1+0.1,0.0004\n", "areal density must be a number"),
    "weight with its unit": (HEAD + "7,0.2 kg/m2,0.0004\n", "areal density must be a number"),
    "hexadecimal": (HEAD + "7,0x1p-2,0.0004\n", "areal density must be a number"),
    "digits in another script": (HEAD + "7,\u0660.\u0662,0.0004\n", "areal density must be a number"),
    "underscore in a number": (HEAD + "7,0_1.2,0.0004\n", "areal density must be a number"),
    "thickness in mm": (HEAD + "7,0.2,0.4\n", "thickness must be at most 0.02 m, got 0.4"),
    "thickness in micrometres": (HEAD + "7,0.2,400\n", "thickness must be at most"),
    "thickness below any thread's": (HEAD + "7,0.2,1e-12\n", "thickness must be"),
    "negative thickness": (HEAD + "7,0.2,-0.0004\n", "thickness must be"),
    "a fabric twice": (HEAD + "7,0.2,0.0004\n7,0.3,0.0004\n", "line 3.*given twice"),
    "a fabric twice, spelt differently": (HEAD + "7,0.2,0.0004\nFABRIC-7,0.2,0.0004\n", "line 3.*given twice"),
    "no name": (HEAD + ",0.2,0.0004\n", "empty or given twice"),
    "a column twice": ("fabric,areal_density_kg_m2,areal_density_kg_m2\n7,0.2,0.3\n", "twice"),
    "more cells than columns": (HEAD + "7,0.2,0.0004,1,2,3\n", "6 fields for 3 columns"),
    "open quote": (HEAD + '7,"0.2,0.0004\n', "cannot be read as CSV"),
    "zero bytes": ((HEAD + "7,0.2,0.0004\n").replace("7", "7\0"), "zero byte"),
    "UTF-16": ((HEAD + "7,0.2,0.0004\n").encode("utf-16"), "UTF-8.*got UTF-16"),
    "Latin-1": ("fabric,areal_density_kg_m2,maker\n7,0.2,Tr\xe4ger\n".encode("latin-1"), "must be UTF-8.*0xe4"),
    "binary": (bytes(range(256)), "UTF-8|zero byte"),
    "a cell of 200 kB": (HEAD + "7," + "9" * 200_000 + ",\n", "CSV|areal density|field"),
    "two megabytes": (HEAD + "7,0.2,0.0004\n" + "\n" * (2 << 20), "at most 1 MiB"),
    "a spreadsheet": (b"PK\x03\x04" + bytes(200), "UTF-8|zero byte"),
    "a page of HTML": ("<!DOCTYPE html>\n<html><body>404</body></html>\n", "needs the columns"),
    "a table of JSON": ('[{"fabric": 7}]\n', "needs the columns"),
}


def _beside(make: Callable[[Path], None], here: Path, stock: Stock) -> None:
    stock.copy_lab(here)
    make(here / "weights.csv")


DRAPES = "folds,ln_bending,poisson,drape_coefficient,rim_min_mm,rim_max_mm,rim_lowest_mm,accuracy\n"
COMPARED = "convergence --vertices 97 --json --reference {here}/drapes.csv"

_DRAPES_REFUSED = {
    "reference without drapes": (DRAPES, "has no drape"),
    "reference of fabrics": (HEAD + "7,0.2,0.0004\n", "needs the columns"),
    "reference in metres": (DRAPES + "6,-5,0,0.8585,0.13846,0.14812,0.03426,5e-4\n", "line 2.*rim_lowest_mm"),
    "reference with half a fold": (DRAPES + "6.5,-5,0,0.8585,138.46,148.12,-34.26,5e-4\n", "line 2.*folds"),
    "reference with NaN": (DRAPES + "6,nan,0,0.8585,138.46,148.12,-34.26,5e-4\n", "line 2.*ln_bending"),
    "reference with a coefficient in per cent": (
        DRAPES + "6,-5,0,85.85,138.46,148.12,-34.26,5e-4\n",
        "drape_coefficient",
    ),
    "reference with a drape twice": (DRAPES + 2 * "6,-5,0,0.8585,138.46,148.12,-34.26,5e-4\n", "line 3.*again"),
}


def _drapes(content: str, here: Path, stock: Stock) -> None:
    (here / "drapes.csv").write_text(content)


def _odd_drapes(make: Callable[[Path], None], here: Path, stock: Stock) -> None:
    make(here / "drapes.csv")


CASES = [
    *(Case(n, INFO, partial(_write, text), right=_weighs(*known)) for n, (text, *known) in _READ.items()),
    *(Case(n, INFO, partial(_write, text), refused=said) for n, (text, said) in _REFUSED.items()),
    *(Case(n, INFO, partial(_odd, make), refused=said) for n, (make, said) in ODD.items()),
    *(
        Case(f"{n} as --fabrics-csv", INFO + " --fabrics-csv {here}/weights.csv", partial(_beside, make), refused=said)
        for n, (make, said) in ODD.items()
    ),
    *(Case(n, COMPARED, partial(_drapes, text), refused=said) for n, (text, said) in _DRAPES_REFUSED.items()),
    *(
        Case(f"{n} as --reference", COMPARED, partial(_odd_drapes, make), refused=said)
        for n, (make, said) in ODD.items()
    ),
    Case("/dev/zero as --fabrics-csv", "data info synthetic --json --fabrics-csv /dev/zero", refused="got a device"),
    Case("/dev/stdin as --fabrics-csv", "data info synthetic --json --fabrics-csv /dev/null", refused="got a device"),
    Case("no --fabrics-csv there", "data info synthetic --json --fabrics-csv nowhere.csv", refused="No such file"),
]
