"""Nominal values of an experiment, from `protocol.json`: sizes, camera, which captures show which face."""

import json
import math
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from cusick_bench.datasets.errors import BadTable
from cusick_bench.sim.constants import CLOTH_RADIUS, IMAGE_CENTRE, PIXELS_PER_METRE, PLATE_RADIUS

FILE = "protocol.json"
_MAXIMUM_BYTES = 1 << 20
_MAXIMUM_SIZE = 8192  # [px]
_CHOICES: dict[str, dict[str, tuple[str, ...]]] = {
    "projection": {
        "parallel": ("parallel", "orthographic", "orthogonal"),
        "pinhole": ("pinhole", "perspective"),
    },
    "image_y": {"up": ("up",), "down": ("down",)},
    "foreground": {
        "dark": ("dark", "black", "1 - grey/255", "1-grey/255"),
        "light": ("light", "bright", "white", "grey/255"),
    },
}
_POSITIVE = ("cloth_radius_m", "plate_radius_m", "gravity_m_s2", "px_per_m")


@dataclass(frozen=True)
class Protocol:
    """Nominal values of an experiment; the defaults are the public release's.

    Attributes:
        cloth_radius_m: Radius of the flat cloth [m].
        plate_radius_m: Radius of the plate [m].
        gravity_m_s2: Gravity [m/s2].
        image_size_px: Width and height of the square images [px].
        px_per_m: Scale in the plane of the plate [px/m].
        centre_px: Column and row of the plate's axis [px], pixel centres at integers.
        projection: "parallel" or "pinhole".
        image_y: "up" if y points to the first row of the image, else "down".
        foreground: "dark" if the cloth is the dark part of the image, else "light".
        captures: Capture number -> "up", "down" or "" (unknown).
        turn_over: How the cloth is turned to lie face down, in words.
        order: In which order captures were taken, in words.
        extra: Keys that are not used, as found.
    """

    cloth_radius_m: float = CLOTH_RADIUS
    plate_radius_m: float = PLATE_RADIUS
    gravity_m_s2: float = 9.8
    image_size_px: int = 256
    px_per_m: float = PIXELS_PER_METRE
    centre_px: tuple[float, float] = IMAGE_CENTRE
    projection: str = "parallel"
    image_y: str = "up"
    foreground: str = "dark"
    captures: dict[int, str] = field(default_factory=lambda: {1: "up", 2: "up", 3: "down", 4: "down"})
    turn_over: str = ""
    order: str = ""
    extra: dict[str, Any] = field(default_factory=dict)


def read_protocol(path: Path) -> Protocol:
    """Reads `protocol.json`; values that are left out keep their defaults, unknown keys are kept in `extra`.

    Raises:
        BadTable: Not a JSON object, or a value that breaks its rule.
    """
    document = read_json_object(path, "protocol-invalid")
    known = {item.name for item in fields(Protocol)} - {"extra"}
    values: dict[str, Any] = {"extra": {key: document[key] for key in document if key not in known}}
    for key in known & document.keys():
        try:
            values[key] = _checked(key, document[key])
        except (TypeError, ValueError, OverflowError) as error:
            found = json.dumps(document[key])[:80]
            raise BadTable(
                f"{key} {error}, got {found}", where=path, remedy="correct it", kind="protocol-invalid"
            ) from error
    protocol = Protocol(**values)
    if protocol.plate_radius_m >= protocol.cloth_radius_m:
        raise BadTable(
            f"plate_radius_m must be below cloth_radius_m, got {protocol.plate_radius_m} >= {protocol.cloth_radius_m}",
            where=path,
            remedy="give both in metres",
            kind="protocol-invalid",
        )
    return protocol


def read_json_object(path: Path, kind: str) -> dict[str, Any]:
    """Reads a JSON file that must hold one object.

    Raises:
        BadTable: Too large, not JSON, or no object.
    """
    try:
        if path.stat().st_size > _MAXIMUM_BYTES:
            raise BadTable(
                f"larger than {_MAXIMUM_BYTES} bytes", where=path, remedy="keep only the nominal values", kind=kind
            )
        document = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        if isinstance(error, BadTable):
            raise
        raise BadTable(f"cannot be read as JSON ({error})", where=path, remedy="correct it", kind=kind) from error
    if not isinstance(document, dict):
        raise BadTable("must hold one JSON object", where=path, remedy='write {"key": value, ...}', kind=kind)
    return document


def _checked(key: str, value: Any) -> Any:
    if key in _POSITIVE:
        number = _number(value)
        if number <= 0:
            raise ValueError("must be > 0")
        return number
    if key in _CHOICES:
        return _choice(key, value)
    return {"image_size_px": _size, "centre_px": _centre, "captures": _captures}.get(key, _words)(value)


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError("must be a finite number")
    return float(value)


def _choice(key: str, value: Any) -> str:
    for choice, spellings in _CHOICES[key].items():
        if isinstance(value, str) and value.strip().lower() in spellings:
            return choice
    raise ValueError(f"must be one of {', '.join(_CHOICES[key])}")


def _size(value: Any) -> int:
    sizes = value if isinstance(value, list) and len(value) == 2 else [value, value]
    numbers = [_number(size) for size in sizes]
    if numbers[0] != numbers[1] or numbers[0] != int(numbers[0]) or not 16 <= numbers[0] <= _MAXIMUM_SIZE:
        raise ValueError(f"must be one whole number of pixels from 16 to {_MAXIMUM_SIZE} (images are square)")
    return int(numbers[0])


def _centre(value: Any) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError("must be [column, row]")
    return _number(value[0]), _number(value[1])


def _captures(value: Any) -> dict[int, str]:
    rule = 'must map capture numbers to "up", "down" or ""'
    if not isinstance(value, dict):
        raise ValueError(rule)
    sides = {str(number): str(side).strip().lower() for number, side in value.items()}
    if not all(number.isdecimal() and side in ("up", "down", "") for number, side in sides.items()):
        raise ValueError(rule)
    return {int(number): side for number, side in sides.items()}


def _words(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
