"""CSV that we write: numbers in full, and no cell that a spreadsheet runs."""

from collections.abc import Callable
from typing import Any

from pandas import DataFrame, Series
from pandas.api.types import is_bool_dtype, is_numeric_dtype

from cusick_bench.files.formula import guarded_cell, unguarded_cell


def csv_text(table: DataFrame, *, float_format: str | None = None) -> str:
    """A table as CSV, which `read_csv` reads back.

    Args:
        table: The table.
        float_format: How numbers are written, such as `%.4g`; in full by default.

    Returns:
        Content of the file, without the table's index.
    """
    return _each_text(table, guarded_cell).to_csv(index=False, lineterminator="\n", float_format=float_format)


def unguarded(table: DataFrame) -> DataFrame:
    """A table that was read by something else than `read_csv`, without the guards of `csv_text`.

    Args:
        table: The table.

    Returns:
        The table as it was before it was written.
    """
    return _each_text(table, lambda value: unguarded_cell(value) if isinstance(value, str) else value)


def _each_text(table: DataFrame, change: Callable[[Any], Any]) -> DataFrame:
    """The table with every text, headings too, changed; columns of numbers stay as they are."""
    columns = (table.iloc[:, place] for place in range(table.shape[1]))
    changed = DataFrame({place: _changed(column, change) for place, column in enumerate(columns)}, index=table.index)
    changed.columns = [change(name) for name in table.columns]
    return changed


def _changed(column: Series, change: Callable[[Any], Any]) -> Series:
    if is_numeric_dtype(column) or is_bool_dtype(column):
        return column
    return Series([change(value) for value in column], index=column.index, dtype=object)
