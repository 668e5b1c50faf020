"""`protocol.json`: nominal values of an experiment, as labs write them and as they should not."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from bad_input.case import Case, Outcome, Stock
from bad_input.odd_files import ODD

INFO = "data info {here}/lab --json"


def _write(content: str | bytes, here: Path, stock: Stock) -> None:
    path = stock.copy_lab(here) / "protocol.json"
    path.write_bytes(content.encode() if isinstance(content, str) else content)


def _odd(make: Callable[[Path], None], here: Path, stock: Stock) -> None:
    make(stock.copy_lab(here) / "protocol.json")


def _read(outcome: Outcome) -> bool:
    return outcome.document["silhouettes"] == 3


def _text(**values: Any) -> str:
    return json.dumps(values)


def _nested(depth: int, opening: str, closing: str) -> str:
    return '{"order": ' + opening * depth + closing * depth + "}"


_READ: dict[str, str] = {
    "no key": "{}",
    "every default": _text(cloth_radius_m=0.15, plate_radius_m=0.09, gravity_m_s2=9.8, image_size_px=256),
    "byte order mark": "\ufeff{}",
    "lines that end as in Windows": '{\r\n"plate_radius_m": 0.09\r\n}\r\n',
    "size as width and height": _text(image_size_px=[256, 256]),
    "whole number for a length": '{"px_per_m": 723}',
    "other words for the same": _text(projection="orthographic", foreground="black", image_y=" Up "),
    "unicode in words": _text(order="erst oben, dann unten \u2194 \U0001f9f5"),
    "captures": _text(captures={"1": "up", "2": "", "7": "down"}),
}

_REFUSED: dict[str, tuple[str | bytes, str]] = {
    "empty file": ("", "cannot be read as JSON"),
    "blanks": ("   \n", "cannot be read as JSON"),
    "open brace": ("{", "cannot be read as JSON"),
    "comma at the end": ('{"px_per_m": 723,}', "cannot be read as JSON"),
    "single quotes": ("{'px_per_m': 723}", "cannot be read as JSON"),
    "a comment": ('{"px_per_m": 723} // measured', "cannot be read as JSON"),
    "YAML": ("px_per_m: 723\n", "cannot be read as JSON"),
    "two documents": ("{}{}", "cannot be read as JSON"),
    "a list": ("[]", "one JSON object"),
    "a number": ("5", "one JSON object"),
    "null": ("null", "one JSON object"),
    "a string": ('"{}"', "one JSON object"),
    "a key twice": ('{"px_per_m": 723, "px_per_m": 700}', '"px_per_m" stands twice'),
    "a key twice within": ('{"captures": {"1": "up", "1": "down"}}', '"1" stands twice'),
    "NaN": ('{"px_per_m": NaN}', "NaN is no JSON"),
    "Infinity": ('{"px_per_m": Infinity}', "Infinity is no JSON"),
    "1e400": ('{"px_per_m": 1e400}', "too large"),
    "a number of 400 digits": ('{"px_per_m": ' + "9" * 400 + "}", "too large"),
    "a number of 5000 digits": ('{"px_per_m": ' + "9" * 5000 + "}", "too large"),
    "100000 lists within each other": (_nested(100_000, "[", "]"), "nested deeper"),
    "100 lists within each other": (_nested(100, "[", "]"), "nested deeper"),
    "1000 objects within each other": (_nested(1000, '{"a":', "}").replace(":}", ":0}"), "nested deeper"),
    "two megabytes": ("{}" + " " * (2 << 20), "at most 1 MiB"),
    "UTF-16": ("{}".encode("utf-16"), "UTF-8.*got UTF-16"),
    "UTF-32": ("{}".encode("utf-32"), "UTF-8|UTF-16|zero byte"),
    "Latin-1": ('{"order": "fr\xfcher"}'.encode("latin-1"), "must be UTF-8"),
    "zero bytes": ("{}\0", "zero byte"),
    "binary": (bytes(range(255, 0, -1)), "UTF-8"),
    "scale as text": (_text(px_per_m="723"), "px_per_m must be"),
    "scale true": (_text(px_per_m=True), "px_per_m must be"),
    "scale null": (_text(px_per_m=None), "px_per_m must be"),
    "scale as a list": (_text(px_per_m=[723]), "px_per_m must be"),
    "scale as an object": (_text(px_per_m={"x": 723}), "px_per_m must be"),
    "scale of zero": (_text(px_per_m=0), "px_per_m must be"),
    "negative scale": (_text(px_per_m=-723), "px_per_m must be"),
    "scale of 1e-300": (_text(px_per_m=1e-300), "px_per_m|scale"),
    "scale ten times too large": (_text(px_per_m=7230), "px_per_m|plate|image"),
    "radius in centimetres": (_text(cloth_radius_m=15, plate_radius_m=9), "cloth_radius_m|plate_radius_m"),
    "radius in millimetres": (_text(cloth_radius_m=150, plate_radius_m=90), "cloth_radius_m|plate_radius_m"),
    "plate as large as the cloth": (_text(plate_radius_m=0.15), "plate_radius_m must be below"),
    "plate larger than the cloth": (_text(cloth_radius_m=0.08), "plate_radius_m must be below"),
    "plate radius 90": (_text(plate_radius_m=90), "plate_radius_m"),
    "no gravity": (_text(gravity_m_s2=0), "gravity_m_s2"),
    "gravity of a star": (_text(gravity_m_s2=1e9), "gravity_m_s2"),
    "negative gravity": (_text(gravity_m_s2=-9.8), "gravity_m_s2"),
    "image of 10^9 pixels": (_text(image_size_px=10**9), "image_size_px"),
    "image of no pixels": (_text(image_size_px=0), "image_size_px"),
    "image of 256.5 pixels": (_text(image_size_px=256.5), "image_size_px"),
    "image not square": (_text(image_size_px=[256, 200]), "image_size_px"),
    "centre with one number": (_text(centre_px=[127.5]), "centre_px"),
    "centre with three numbers": (_text(centre_px=[127.5, 127.5, 0]), "centre_px"),
    "centre as text": (_text(centre_px="middle"), "centre_px"),
    "centre outside of the image": (_text(centre_px=[1e6, 127.5]), "centre_px|centre"),
    "unknown projection": (_text(projection="fisheye"), "projection must be one of"),
    "projection a number": (_text(projection=1), "projection must be one of"),
    "unknown foreground": (_text(foreground="blue"), "foreground must be one of"),
    "unknown direction": (_text(image_y="left"), "image_y must be one of"),
    "captures as a list": (_text(captures=["up", "down"]), "captures must map"),
    "captures of another side": (_text(captures={"1": "left"}), "captures must map"),
    "captures of no number": (_text(captures={"first": "up"}), "captures must map"),
    "captures in other digits": (_text(captures={"\u0663": "up", "\u00b2": "down"}), "captures"),
    "misspelt key": (_text(plate_radus_m=0.09), "did you mean 'plate_radius_m'|plate_radius_m"),
    "key in capitals": (_text(PX_PER_M=723), "px_per_m"),
    "the key extra": (_text(extra={"a": 1}), "extra"),
}


CASES = [
    *(Case(n, INFO, partial(_write, text), right=_read) for n, text in _READ.items()),
    *(Case(n, INFO, partial(_write, text), refused=said) for n, (text, said) in _REFUSED.items()),
    *(Case(n, INFO, partial(_odd, make), refused=said) for n, (make, said) in ODD.items()),
]
