"""Types of the records of a run, `result.json` and `run.json`, which are checked before they are used."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError


class _Written(BaseModel):
    model_config = ConfigDict(strict=True, extra="ignore")


class _Code(_Written):
    package: str | None = None
    commit: str | None = None
    dirty: bool | None = None


class _Result(_Written):
    """A cell's `result.json`, as far as tables use it; names, seed and metrics are `plausible`'s matter."""

    kind: str = Field(min_length=1)
    status: str = "done"
    metrics: dict[str, Any] = {}
    spent: dict[str, Any] = {}
    settings: dict[str, Any] | None = None
    test: list[int] = []
    numerics: dict[str, int] | None = None
    code: _Code | None = None
    failure: str | None = None


class _Run(_Written):
    """`run.json`, as far as tables, checks and submissions use it."""

    command: list[str] = []
    cells: list[str] = []
    history: list["_Run"] = []
    code: _Code | None = None
    dataset: str | None = None
    time: str | None = None
    processor: str | None = None
    platform: str | None = None
    cores: int | None = None


def check_result(document: dict[str, Any]) -> None:
    """Makes sure that the parts of a `result.json` have their types.

    Args:
        document: Its content.

    Raises:
        ValueError: One has not; the message names it.
    """
    _check(_Result, document, "result.json")


def check_run(document: dict[str, Any]) -> None:
    """Makes sure that the parts of a `run.json` have their types.

    Args:
        document: Its content.

    Raises:
        ValueError: One has not; the message names it.
    """
    _check(_Run, document, "run.json")


def _check(kind: type[BaseModel], document: dict[str, Any], name: str) -> None:
    try:
        kind.model_validate(document)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise ValueError(f"{name}: {place}: {first['msg']}, got {str(first['input'])[:60]!r}") from error
