"""CSV that we write: numbers in full, and no cell that a spreadsheet runs."""

from pandas import DataFrame, Series
from pandas.api.types import is_bool_dtype, is_numeric_dtype

from cusick_bench.files.formula import guarded_cell


def csv_text(table: DataFrame, *, float_format: str | None = None) -> str:
    """A table as CSV, which `read_csv` reads back.

    Args:
        table: The table.
        float_format: How numbers are written, such as `%.4g`; in full by default.

    Returns:
        Content of the file, without the table's index.
    """
    columns = (_guarded(table.iloc[:, place]) for place in range(table.shape[1]))
    guarded = DataFrame(dict(enumerate(columns)), index=table.index)
    guarded.columns = [guarded_cell(name) for name in table.columns]
    return guarded.to_csv(index=False, lineterminator="\n", float_format=float_format)


def _guarded(column: Series) -> Series:
    if is_numeric_dtype(column) or is_bool_dtype(column):
        return column
    return Series([guarded_cell(value) for value in column], index=column.index, dtype=object)
