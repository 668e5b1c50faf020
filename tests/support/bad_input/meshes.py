"""Meshes in OBJ files: of a cloth to simulate (`simulate --mesh`), and of a drape in a data set."""

import gzip
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from bad_input.case import Case, Outcome, Stock
from bad_input.odd_files import ODD
from cusick_bench.sim.cloth.mesh import disc_mesh

SIMULATE = "simulate --density 0.2 --bending 1e-6 --steps 2 --json --mesh {here}/"


def _points() -> tuple[list[str], list[str]]:
    mesh = disc_mesh(97)
    points = [f"v {x:.9g} {y:.9g} 0" for x, y in mesh.material]
    return points, [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1]


VERTICES, FACES = _points()
DISC = "\n".join([*VERTICES, *FACES, ""])


def _scaled(factor: float, shift: float = 0.0) -> str:
    mesh = disc_mesh(97)
    points = [f"v {factor * x + shift:.9g} {factor * y:.9g} 0" for x, y in mesh.material]
    return "\n".join([*points, *FACES, ""])


def _with(lines: list[str]) -> str:
    return DISC + "\n".join([*lines, ""])


def _bowl() -> str:
    mesh = disc_mesh(97)
    return "\n".join([*(f"v {x:.9g} {y:.9g} {-x * x:.9g}" for x, y in mesh.material), *FACES, ""])


def _write(content: str | bytes, name: str, here: Path, stock: Stock) -> None:
    (here / name).write_bytes(content.encode() if isinstance(content, str) else content)


def _odd(make: Callable[[Path], None], here: Path, stock: Stock) -> None:
    make(here / "cloth.obj")


def _counts(outcome: Outcome) -> bool:
    return outcome.document["vertices"] == len(VERTICES) and outcome.document["faces"] == len(FACES)


def _negative() -> str:
    count = len(VERTICES)
    corners = [[int(word) - count - 1 for word in line.split()[1:]] for line in FACES]
    return "\n".join([*VERTICES, *(f"f {a} {b} {c}" for a, b, c in corners), ""])


def _slashes() -> str:
    return "\n".join(
        [*VERTICES, *(f"f {a}//{a} {b}/1/{b} {c}/" for a, b, c in (line.split()[1:] for line in FACES)), ""]
    )


def _second_disc() -> str:
    mesh = disc_mesh(97)
    far = [f"v {x + 1:.9g} {y:.9g} 0" for x, y in mesh.material]
    more = [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1 + len(VERTICES)]
    return "\n".join([*VERTICES, *far, *FACES, *more, ""])


def _bow_tie() -> str:
    return "v 0 0 0\nv .1 0 0\nv .1 .1 0\nv -.1 0 0\nv -.1 -.1 0\nf 1 2 3\nf 1 4 5\n"


_READ: dict[str, tuple[str | bytes, str]] = {
    "plain": (DISC, "cloth.obj"),
    "gzipped": (gzip.compress(DISC.encode(), mtime=0), "cloth.obj.gz"),
    "lines that end as in Windows": (DISC.replace("\n", "\r\n"), "cloth.obj"),
    "tabs and blanks": (DISC.replace(" ", " \t "), "cloth.obj"),
    "comments, groups and materials": (
        "# made\no disc\nmtllib ../../etc/passwd\nusemtl a\ns off\n" + DISC,
        "cloth.obj",
    ),
    "normals and textures": ("vn 0 0 1\nvt 0 0\n" + _slashes(), "cloth.obj"),
    "vertices counted backwards": (_negative(), "cloth.obj"),
    "colours of vertices": (DISC.replace(" 0\n", " 0 .5 .5 .5\n"), "cloth.obj"),
    "another suffix": (DISC, "cloth.txt"),
    "name with a blank and an umlaut": (DISC, "Stoffträger.obj"),
    "no newline at the end": (DISC.rstrip(), "cloth.obj"),
    "minus zero for zero": (DISC.replace(" 0\n", " -0.0\n"), "cloth.obj"),
}

_REFUSED: dict[str, tuple[str | bytes, str]] = {
    "empty file": ("", "0 vertices and 0 faces"),
    "vertices alone": ("\n".join(VERTICES), "and 0 faces"),
    "faces alone": ("\n".join(FACES), "0 vertices|not there"),
    "binary": (bytes(range(256)) * 16, "vertices and 0 faces|cannot read"),
    "UTF-16": (DISC.encode("utf-16"), "cannot read|0 vertices"),
    "zero bytes among the lines": (DISC.replace("\n", "\0\n"), "cannot read"),
    "not a number": (_with(["v nan 0 0", "f 1 2 98"]), "not finite"),
    "infinite": (_with(["v inf 0 0", "f 1 2 98"]), "not finite"),
    "1e400": (_with(["v 1e400 0 0", "f 1 2 98"]), "not finite"),
    "a word for a number": (_with(["v 0 zero 0"]), "line .* cannot read 'v 0 zero 0'"),
    "decimal commas": (DISC.replace(".", ","), "cannot read"),
    "two coordinates": (_with(["v 0 0"]), "3 coordinates"),
    "nine coordinates": (_with(["v 0 0 0 1 1 1 1 1 1"]), "3 coordinates"),
    "vertex zero": (_with(["f 0 1 2"]), "not there|cannot read|vertex 0"),
    "vertex beyond the last": (_with(["f 1 2 98"]), "not there"),
    "vertex before the first": (_with(["f 1 2 -99"]), "not there"),
    "vertex of 10^30": (_with(["f 1 2 1000000000000000000000000000000"]), "not there|cannot read|too large"),
    "vertex 1.5": (_with(["f 1 2 1.5"]), "cannot read"),
    "face of two corners": (_with(["f 1 2"]), "at least 3 corners"),
    "face of no corners": (_with(["f"]), "at least 3 corners"),
    "face with one corner twice": (_with(["f 1 1 2"]), "area|manifold"),
    "face of three points in a line": ("v 0 0 0\nv .05 0 0\nv .1 0 0\nf 1 2 3\n", "area"),
    "clockwise": (
        "\n".join([*VERTICES, *("f " + " ".join(reversed(line.split()[1:])) for line in FACES)]),
        "clockwise",
    ),
    "a face twice": (_with([FACES[0]]), "more than two faces|manifold|boundary|rim"),
    "three faces on one edge": (
        _with(["v 0 .2 0", f"f {' '.join(FACES[0].split()[1:3])} 98"]),
        "manifold|area|boundary|rim",
    ),
    "a hole": ("\n".join([*VERTICES, *FACES[:40], *FACES[41:]]), "boundary|hole|rim"),
    "two discs": (_second_disc(), "must hold a cloth of one piece, got 2"),
    "bow tie": (_bow_tie(), "bow tie"),
    "a vertex of no face": (_with(["v .01 .01 0"]), "belong to no face"),
    "one triangle on the plate": ("v -.1 -.1 0\nv .1 -.1 0\nv 0 .1 0\nf 1 2 3\n", "plate|vertices"),
    "not flat": (_bowl(), "not flat"),
    "in millimetres": (_scaled(1000), "not in millimetres"),
    "in inches": (_scaled(39.37), "in metres"),
    "of a micrometre": (_scaled(1e-5), "in metres"),
    "smaller than the plate": (_scaled(0.5), "plate"),
    "off the plate's axis": (_scaled(1, 0.1), "must reach beyond the plate"),
    "beside the plate": (_scaled(1, 0.5), "plate|centre"),
    "coordinates of 10^7 m": (_scaled(1e8), "not a length in metres"),
    "a line of a megabyte": (_with(["v " + "0 " * 500_000]), "3 coordinates"),
    "a number of 5000 digits": (_with([f"f 1 2 {'9' * 5000}"]), "cannot read"),
}

_GZIPPED: dict[str, tuple[bytes, str]] = {
    "gzip that is none": (DISC.encode(), "cannot be read"),
    "gzip cut short": (gzip.compress(DISC.encode())[:200], "cannot be read"),
    "gzip of 200 MB of vertices": (gzip.compress(b"v 0 0 0\n" * (25 << 20), 1), "more than 64 MiB"),
}
_ODD_FILES = {
    "device": "no mesh file|regular file",
    "pipe": "no mesh file|regular file",
    "folder": "no mesh file|regular file",
    "loop of links": "no mesh file|[Ll]oop|levels|cannot be read",
    "link to nothing": "no mesh file",
    "4 GB of zeros": "more than 64 MiB",
}


def _in_lab(content: str, here: Path, stock: Stock) -> None:
    folder = stock.copy_lab(here) / "data" / "Fabric 7" / "meshes"
    (folder / "Fabric_7_Sample_1_Capture_1.obj").write_text(content)


def _lists(kind: str) -> Callable[[Outcome], bool]:
    return lambda outcome: kind in {item["kind"] for item in outcome.document["irregularities"]}


_drape = np.linspace(0, 2 * np.pi, 12, endpoint=False)
_FAN = "\n".join(
    ["v 0 0 0", *(f"v {0.1 * np.cos(a):.6f} {0.1 * np.sin(a):.6f} -.02" for a in _drape)]
    + [f"f 1 {k + 2} {(k + 1) % 12 + 2}" for k in range(12)]
)
_IN_LAB: dict[str, tuple[str, str]] = {
    "drape without faces": ("v 0 0 0\n", "unreadable-mesh"),
    "drape of another cloth": (_FAN, "mesh-matches-none"),
    "drape of one point": ("v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", "mesh-matches-none"),
    "drape that is not finite": (_FAN + "\nv nan nan nan\nf 1 2 14\n", "unreadable-mesh"),
    "drape in millimetres": (_FAN.replace("0.1", "100."), "mesh-matches-none"),
}

CASES = [
    *(Case(n, SIMULATE + name, partial(_write, text, name), right=_counts) for n, (text, name) in _READ.items()),
    *(
        Case(n, SIMULATE + "cloth.obj", partial(_write, text, "cloth.obj"), said)
        for n, (text, said) in _REFUSED.items()
    ),
    *(Case(n, SIMULATE + "c.obj.gz", partial(_write, text, "c.obj.gz"), said) for n, (text, said) in _GZIPPED.items()),
    *(Case(n, SIMULATE + "cloth.obj", partial(_odd, ODD[n][0]), said) for n, said in _ODD_FILES.items()),
    Case("no such file", SIMULATE + "nothing.obj", refused="no mesh file is there"),
    *(
        Case(n, "data audit {here}/lab --json", partial(_in_lab, text), right=_lists(kind))
        for n, (text, kind) in _IN_LAB.items()
    ),
]
