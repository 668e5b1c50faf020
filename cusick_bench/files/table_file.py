"""Tables that we write, as CSV or, for many rows, as Parquet (with the library pyarrow)."""

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from cusick_bench.sim.errors import CusickError

if TYPE_CHECKING:
    from pandas import DataFrame, Series

TABLE_FORMS = (".csv", ".parquet")


class MissingLibrary(CusickError):
    """An optional library is not installed; the message names the extra."""


def require_pyarrow(what: str, *, instead: str = "") -> None:
    """Makes sure, before any work, that Parquet can be written.

    Args:
        what: What needs it, for the message.
        instead: What else the user can do, where there is anything.

    Raises:
        MissingLibrary: pyarrow is not installed.
    """
    try:
        import pyarrow  # noqa: F401
    except ImportError as error:
        remedy = "install it with `pip install 'cusick-bench[parquet]'`" + (f", or {instead}" if instead else "")
        raise MissingLibrary(f"{what} needs pyarrow; {remedy}") from error


def table_bytes(table: "DataFrame", path: Path) -> bytes:
    """A table as the content of a file.

    Args:
        table: The table; text is kept as it is in Parquet, and guarded against spreadsheets in CSV.
        path: Name of the file, whose ending says in which form.

    Returns:
        The content.

    Raises:
        MissingLibrary: pyarrow is not installed.
    """
    if path.suffix == ".csv":
        from cusick_bench.files.csv_text import csv_text

        return csv_text(table).encode()
    require_pyarrow(str(path), instead="write .csv")
    buffer = BytesIO()
    table.apply(_one_type).to_parquet(buffer, index=False, engine="pyarrow", compression="zstd")
    return buffer.getvalue()


def _one_type(column: "Series") -> "Series":
    """A column as Parquet has it: numbers with gaps instead of numbers and empty text."""
    if column.dtype != object or all(isinstance(value, str) for value in column):
        return column
    from pandas import Series

    values = [None if isinstance(value, str) and value == "" else value for value in column]
    if any(isinstance(value, str) for value in values):
        values = [None if value is None else str(value) for value in values]
    return Series(values, index=column.index)
