"""Nominal values of an experiment, from `protocol.json`: sizes, camera, which captures show which face.

`Protocol` is the one model of that file; pydantic checks its fields whoever makes one.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import fields
from numbers import Real
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, ValidationError, model_validator
from pydantic.dataclasses import dataclass

from cusick_bench.datasets.errors import BadTable
from cusick_bench.datasets.files.object_file import read_object
from cusick_bench.datasets.files.protocol_keys import check_unknown_keys
from cusick_bench.sim.constants import (
    CLOTH_RADIUS,
    EYE_HEIGHT,
    GRAVITY,
    IMAGE_CENTRE,
    IMAGE_SIZE,
    PIXELS_PER_METRE,
    PLATE_RADIUS,
)

FILE = "protocol.json"
CLOTH_RADII = (0.02, 0.5)  # [m]
PLATE_RADII = (0.01, 0.4)  # [m]
GRAVITIES = (1.0, 30.0)  # [m/s2], from the Moon's to beyond Jupiter's
CAMERA_HEIGHTS = (0.2, 20.0)  # [m] of the eye above the plate
PLATE_SHARE = 0.1  # the plate's diameter is at least this share of the image's width
CLOTH_BEYOND = 0.1  # a flat cloth may reach this share of its radius beyond the image: drapes hang lower than flat
MAXIMUM_SIZE = 4096  # [px]
_RATIO_TOLERANCE = 0.02
_PROJECTIONS = {"parallel": ("parallel", "orthographic", "orthogonal"), "pinhole": ("pinhole", "perspective")}
_DIRECTIONS = {"up": ("up",), "down": ("down",)}
_FOREGROUNDS = {
    "dark": ("dark", "black", "1 - grey/255", "1-grey/255"),
    "light": ("light", "bright", "white", "grey/255"),
}


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(float(value)):
        raise ValueError("must be a finite number")
    return float(value)


def _positive(value: Any) -> float:
    number = _number(value)
    if number <= 0:
        raise ValueError("must be > 0")
    return number


def _between(bounds: tuple[float, float], unit: str, hints: dict[str, float]) -> BeforeValidator:
    """A number within physical bounds; a value that would lie there in another unit is told so.

    Args:
        bounds: Least and most.
        unit: Unit of both.
        hints: Other units, and the factor that turns them into `unit`.
    """

    def checked(value: Any) -> float:
        number = _positive(value)
        if bounds[0] <= number <= bounds[1]:
            return number
        near = [f"{number:g} {name} are {number * factor:g} {unit}" for name, factor in hints.items()
                if bounds[0] <= number * factor <= bounds[1]]  # fmt: skip
        meant = f" ({' or '.join(near)})" if near else ""
        raise ValueError(f"must be from {bounds[0]:g} to {bounds[1]:g} {unit}{meant}")

    return BeforeValidator(checked)


def _choice(spellings: dict[str, tuple[str, ...]]) -> BeforeValidator:
    """One of several words, in any of its spellings."""

    def chosen(value: Any) -> str:
        for choice, accepted in spellings.items():
            if isinstance(value, str) and value.strip().lower() in accepted:
                return choice
        raise ValueError(f"must be one of {', '.join(spellings)}")

    return BeforeValidator(chosen)


def _size(value: Any) -> int:
    sizes = value if isinstance(value, list) and len(value) == 2 else [value, value]
    numbers = [_number(size) for size in sizes]
    if numbers[0] != numbers[1] or numbers[0] != int(numbers[0]) or not 16 <= numbers[0] <= MAXIMUM_SIZE:
        raise ValueError(f"must be one whole number of pixels from 16 to {MAXIMUM_SIZE} (images are square)")
    return int(numbers[0])


def _centre(value: Any) -> tuple[float, float]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise ValueError("must be [column, row]")
    return _number(value[0]), _number(value[1])


def _captures(value: Any) -> dict[int, str]:
    rule = 'must map capture numbers to "up", "down" or ""'
    if not isinstance(value, dict):
        raise ValueError(rule)
    sides = {str(number): str(side).strip().lower() for number, side in value.items()}
    if not all(number.isdecimal() and side in ("up", "down", "") for number, side in sides.items()):
        raise ValueError(rule)
    captures = {int(number): side for number, side in sides.items()}
    if len(captures) < len(sides):
        raise ValueError(f"{rule}, each number once")
    if 0 in captures:
        raise ValueError(f"{rule}, and numbers begin at 1")
    return captures


def _words(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


_LENGTHS = {"cm": 0.01, "mm": 0.001}
_Positive = Annotated[float, BeforeValidator(_positive)]
_ClothRadius = Annotated[float, _between(CLOTH_RADII, "m", _LENGTHS)]
_PlateRadius = Annotated[float, _between(PLATE_RADII, "m", _LENGTHS)]
_CameraHeight = Annotated[float, _between(CAMERA_HEIGHTS, "m", _LENGTHS)]
_Gravity = Annotated[float, _between(GRAVITIES, "m/s2", {"cm/s2": 0.01, "g": 9.80665})]
_Words = Annotated[str, BeforeValidator(_words)]


@dataclass(frozen=True, config=ConfigDict(strict=True, extra="forbid"))
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
        order: Order in which captures were taken, in words.
        extra: Remarks (unknown keys that hold text or a count, and `notes`), as found; not used.
        camera_height_m: Height of a pinhole camera's eye above the plate [m].
    """

    cloth_radius_m: _ClothRadius = CLOTH_RADIUS
    plate_radius_m: _PlateRadius = PLATE_RADIUS
    gravity_m_s2: _Gravity = GRAVITY
    image_size_px: Annotated[int, BeforeValidator(_size)] = IMAGE_SIZE
    px_per_m: _Positive = PIXELS_PER_METRE
    centre_px: Annotated[tuple[float, float], BeforeValidator(_centre)] = IMAGE_CENTRE
    projection: Annotated[Literal["parallel", "pinhole"], _choice(_PROJECTIONS)] = "parallel"
    image_y: Annotated[Literal["up", "down"], _choice(_DIRECTIONS)] = "up"
    foreground: Annotated[Literal["dark", "light"], _choice(_FOREGROUNDS)] = "dark"
    captures: Annotated[dict[int, str], BeforeValidator(_captures)] = Field(
        default_factory=lambda: {1: "up", 2: "up", 3: "down", 4: "down"}
    )
    turn_over: _Words = ""
    order: _Words = ""
    extra: dict[str, Any] = Field(default_factory=dict)
    camera_height_m: _CameraHeight = Field(default=EYE_HEIGHT, repr=False)

    @property
    def overhang_m(self) -> float:
        """Width of the annulus of cloth that hangs over the plate's edge, R - r [m]."""
        return self.cloth_radius_m - self.plate_radius_m

    @property
    def has_standard_ratio(self) -> bool:
        """Whether plate and cloth are, to 2 %, in the ratio of the standard's 18 and 30 cm, which a diagnosis needs."""
        return abs(self.plate_radius_m / self.cloth_radius_m / (PLATE_RADIUS / CLOTH_RADIUS) - 1) <= _RATIO_TOLERANCE

    @property
    def standard_cloth_radius_m(self) -> float:
        """Radius [m] of the cloth that would be in the standard's ratio to this plate."""
        return self.plate_radius_m * CLOTH_RADIUS / PLATE_RADIUS

    @property
    def sizes_text(self) -> str:
        """Sizes and scale in words, such as "cloth 300 mm, plate 180 mm, 723 px/m"."""
        return f"cloth {2e3 * self.cloth_radius_m:g} mm, plate {2e3 * self.plate_radius_m:g} mm, {self.px_per_m:g} px/m"

    @property
    def cloth_scale(self) -> float:
        """Radius of the cloth, in those of the standard's."""
        return self.cloth_radius_m / CLOTH_RADIUS

    @property
    def mse_scale(self) -> float:
        """Factor from a mean squared difference over this protocol's pixels to the MSE; 1 for the release.

        A mean over pixels depends on how much background the image shows. The benchmark integrates the squared
        difference over the plane and divides by the area that an image of the release shows of a cloth of its size,
        (256 px / 723 px/m)^2 = (354 mm)^2, times (cloth radius / 0.15 m)^2 for other cloths.
        """
        side = (self.image_size_px / self.px_per_m) ** 2
        return side / ((IMAGE_SIZE / PIXELS_PER_METRE) ** 2 * self.cloth_scale**2)

    def document(self) -> dict[str, Any]:
        """Content of a `protocol.json` that says the same; without remarks, the camera's height where it counts."""
        names = [item.name for item in fields(self) if item.name != "extra"]
        values = {name: getattr(self, name) for name in names if name != "camera_height_m"}
        if self.projection == "pinhole":
            values["camera_height_m"] = self.camera_height_m
        captures = {str(number): side for number, side in self.captures.items()}
        return values | {"centre_px": list(self.centre_px), "captures": captures}

    def unlike_release(self) -> dict[str, Any]:
        """Values that decide where a point of the cloth is seen and that differ from the public release.

        Returns:
            Value by the field's name; nothing for a protocol that has the release's.
        """
        names = ["cloth_radius_m", "plate_radius_m", "image_size_px", "px_per_m", "centre_px", "projection", "image_y"]
        names += ["camera_height_m"] if self.projection == "pinhole" else []
        values = {name: getattr(self, name) for name in names if getattr(self, name) != getattr(RELEASE, name)}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}

    @model_validator(mode="after")
    def _plate_is_smaller(self) -> "Protocol":
        if self.plate_radius_m >= self.cloth_radius_m:
            sizes = f"{self.plate_radius_m} >= {self.cloth_radius_m}"
            raise ValueError(f"plate_radius_m must be below cloth_radius_m, got {sizes}")
        return self

    @model_validator(mode="after")
    def _picture_holds_the_cloth(self) -> "Protocol":
        size, (column, row) = self.image_size_px, self.centre_px
        if not (0 <= column <= size - 1 and 0 <= row <= size - 1):
            raise ValueError(f"centre_px must lie in the image, from 0 to {size - 1}, got [{column:g}, {row:g}]")
        border = min(column, row, size - 1 - column, size - 1 - row) + 0.5
        plate, cloth = self.plate_radius_m * self.px_per_m, self.cloth_radius_m * self.px_per_m
        scale = f"px_per_m must suit images of {size} px"
        if 2 * plate < PLATE_SHARE * size:
            raise ValueError(
                f"{scale}: the plate would be {2 * plate:.3g} px wide, at least {PLATE_SHARE * size:.3g} are "
                f"plausible, got {self.px_per_m:g} px/m"
            )
        if plate > border or (1 - CLOTH_BEYOND) * cloth > border:
            raise ValueError(
                f"{scale}: from centre_px to the border are {border:.4g} px, but the plate's radius is {plate:.4g} px "
                f"and the flat cloth's {cloth:.4g} px, got {self.px_per_m:g} px/m"
            )
        return self


RELEASE = Protocol()
"""The public release's."""


def read_protocol(path: Path) -> Protocol:
    """Reads `protocol.json`; values that are left out keep their defaults.

    A key that is not known is a remark, kept in `extra`, where it holds text or null and resembles no known key, or
    where it is a count, a version or a seed (`samples`, `n_captures`, `format_version`); so is all that stands in
    `notes`. Any other unknown key could be a measure that nothing would use, and is refused.

    Args:
        path: The file.

    Returns:
        The nominal values.

    Raises:
        BadTable: Not a JSON object, a value that breaks its rule, a key that is given twice or lacks another one, or an
            unknown key that may be meant for a known one.
    """
    document = read_object(path, "protocol-invalid")
    known = {item.name for item in fields(Protocol)} - {"extra"}
    values = {key: value for key, value in document.items() if key in known}
    extra = {key: value for key, value in document.items() if key not in known}
    check_unknown_keys(extra, sorted(known), path)
    try:
        protocol = Protocol(**values, extra=extra)
    except ValidationError as error:
        of_one_key = bool(error.errors()[0]["loc"])
        what = (not of_one_key and _defaults_of_another_size(values)) or first_fault(error)
        raise BadTable(what, where=path, remedy="correct it", kind="protocol-invalid") from error
    if what := _defaults_of_another_size(values):
        raise BadTable(what, where=path, remedy="add them", kind="protocol-invalid")
    if "camera_height_m" in values and "projection" not in values:
        raise BadTable(
            f"camera_height_m needs projection, of which only pinhole uses it, got {protocol.camera_height_m:g} alone",
            where=path,
            remedy='add "projection": "pinhole" if perspective is to be taken out of the silhouettes, else "parallel"',
            kind="protocol-invalid",
        )
    return protocol


def _defaults_of_another_size(values: Mapping[str, Any]) -> str:
    """What is missing where images have another size than those that the defaults of scale and centre belong to."""
    missing = [key for key in ("px_per_m", "centre_px") if key not in values]
    size = values.get("image_size_px", IMAGE_SIZE)
    if not missing or size in (IMAGE_SIZE, [IMAGE_SIZE, IMAGE_SIZE]):
        return ""
    return f"image_size_px {size} needs {' and '.join(missing)} of these images too; defaults are for {IMAGE_SIZE} px"


def first_fault(error: ValidationError) -> str:
    """Key, rule and value of the first field that breaks its rule; the model's own rules say all three themselves.

    Args:
        error: What making a `Protocol` raised.

    Returns:
        One line.
    """
    fault = error.errors()[0]
    rule = str(fault.get("ctx", {}).get("error", fault["msg"]))
    return f"{fault['loc'][0]} {rule}, got {json.dumps(fault['input'])[:80]}" if fault["loc"] else rule
