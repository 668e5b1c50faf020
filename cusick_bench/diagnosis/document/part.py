"""A part of a document: immutable, checked on reading, the same JSON in and out."""

from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.inference.single_effects.localise import EDGES, SECTORS

Probability = Annotated[float, Field(ge=0, le=1 + 1e-6)]  # sums of probabilities may exceed 1 by rounding
Interval = tuple[float, float]
"""Lower and upper end."""
_RINGS = len(EDGES) - 1
Map = Annotated[
    tuple[Annotated[tuple[float, ...], Field(min_length=SECTORS, max_length=SECTORS)], ...],
    Field(min_length=_RINGS, max_length=_RINGS),
]
"""A number for each ring and sector of the cloth's overhang, as in `inference.localise`."""
_MOST_ERRORS = 3  # that a message lists


class Part(BaseModel):
    """A part of a document: immutable, and every value has the type that its field states."""

    model_config = ConfigDict(
        frozen=True, strict=True, allow_inf_nan=False, extra="ignore", validate_by_name=True, validate_by_alias=True
    )

    @classmethod
    def parse(cls, content: str | bytes, where: str) -> Self:
        """Reads JSON text.

        Args:
            content: The text.
            where: File it comes from, for messages.

        Returns:
            The part.

        Raises:
            DiagnosisError: It is not JSON, or a value is missing or wrong; the message names its place.
        """
        try:
            return cls.model_validate_json(content)
        except ValidationError as error:
            found = error.errors(include_url=False, include_context=False)
            listed = "; ".join(_described(one["loc"], one["msg"], one["input"]) for one in found[:_MOST_ERRORS])
            more = f"; and {len(found) - _MOST_ERRORS} more" if len(found) > _MOST_ERRORS else ""
            remedy = "make it anew with `cusick-bench diagnose`"
            raise DiagnosisError(f"{where} is no valid diagnosis: {listed}{more}; {remedy}") from error

    def complete(self) -> Self:
        """The same part with all fields given, those that were left open at their defaults.

        Returns:
            The part, whose content has every key that a reader may ask for.
        """
        return self.model_validate_json(self.model_dump_json(by_alias=True))

    def content(self) -> dict[str, Any]:
        """The part as JSON values; fields that were never given are left out.

        Returns:
            Its content by the keys of the file.
        """
        return self.model_dump(mode="json", by_alias=True, exclude_unset=True)


def _described(place: tuple[str | int, ...], rule: str, value: Any) -> str:
    """Message on a wrong value, with its place in the document, such as `causes[0].probability`."""
    path = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in place).lstrip(".")
    shown = repr(value)
    return f"{path or 'document'}: {rule}, got {shown if len(shown) <= 60 else shown[:57] + '...'}"
