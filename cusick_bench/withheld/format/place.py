"""Where an effect acts, as answers and labels write it: kind, directions and radii, each a range or its middle."""

from typing import Annotated, Any

from pydantic import PlainValidator
from pydantic_core import PydanticCustomError

from cusick_bench.withheld.format import location
from cusick_bench.withheld.format.fields import AS_IT_STANDS, Document, broken_rule
from cusick_bench.withheld.format.location import Region

Range = tuple[float, float]


def _finite(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < float("inf"):
        raise PydanticCustomError("number", "must be a number, or a list of two", {"remedy": "leave it out if unknown"})
    return value


def _number_or_range(value: Any) -> float | Range:
    if not isinstance(value, list | tuple):
        return _finite(value)
    if len(value) != 2:
        raise PydanticCustomError("range", "must be a list of 2")
    return _finite(value[0]), _finite(value[1])


def _radii(value: Any) -> float | Range:
    found = _number_or_range(value)
    if isinstance(found, tuple) and found[1] < found[0]:
        raise broken_rule(f"must be [inner, outer] in metres, got [{found[0]:g}, {found[1]:g}]; swap them")
    return found


class Place(Document):
    """A place on the cloth.

    Attributes:
        kind: `sector`, `ring` or `patch`; of other kinds no region is known.
        angle_deg: First and last direction, counter-clockwise, or the middle one [deg].
        radius_m: Inner and outer radius, or the middle one [m].
    """

    kind: str | None = None
    angle_deg: Annotated[float | Range, PlainValidator(_number_or_range), AS_IT_STANDS] | None = None
    radius_m: Annotated[float | Range, PlainValidator(_radii), AS_IT_STANDS] | None = None

    @property
    def region(self) -> Region | None:
        """The region, None for another kind of place; what is left out is the whole turn, or the whole overhang.

        A single number stands for the middle of a range that is as wide as a cell of the map.
        """
        if self.kind not in location.KINDS:
            return None
        return Region(*self._arc(), *self._rim_to_rim())

    def _arc(self) -> tuple[float, float]:
        """Start and width [deg]."""
        if self.angle_deg is None or self.kind == "ring":
            return 0.0, location.FULL_TURN
        if isinstance(self.angle_deg, tuple):
            return location.arc(self.angle_deg)
        return location.around(self.angle_deg, location.FULL_TURN / location.SECTORS / 2)

    def _rim_to_rim(self) -> tuple[float, float]:
        """Inner and outer radius [m]."""
        if self.radius_m is None:
            return location.PLATE_EDGE, location.RIM
        if isinstance(self.radius_m, tuple):
            return self.radius_m
        half = (location.RIM - location.PLATE_EDGE) / location.RINGS / 2
        return self.radius_m - half, self.radius_m + half
