"""CSV that we write: numbers in full, and no cell that a spreadsheet runs."""

from io import StringIO

from pandas import DataFrame, Series
from pandas.api.types import is_bool_dtype, is_numeric_dtype

from cusick_bench.files.formula import guarded_cell

_LINE_END = "\r\n"  # of the writer, which puts cells in quotes that hold any part of it


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
    rows = _Rows()
    guarded.to_csv(rows, index=False, lineterminator=_LINE_END, float_format=float_format)
    return "".join(rows.lines)


class _Rows(StringIO):
    """Takes a table row by row, and ends each with a line feed alone."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def write(self, text: str, /) -> int:
        self.lines.append(text.removesuffix(_LINE_END) + "\n")
        return len(text)


def _guarded(column: Series) -> Series:
    if is_numeric_dtype(column) or is_bool_dtype(column):
        return column
    return Series([guarded_cell(value) for value in column], index=column.index, dtype=object)
