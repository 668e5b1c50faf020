"""Reading of files that others wrote, within limits: nothing is unpickled, and sizes are looked at before content.

json_file: one JSON object; npz_file: arrays; csv_file: tables. All raise `BadFile`: the file, what is wrong with it,
and the remedy. What we write: csv_text, tables without formulas; table_file, the same or Parquet; json_text. digest:
fingerprints of files. hidden: files that belong to no data. plain_names: names of files that stand for cloths and the
like. first_names: the first of many names, in messages. silence: work without warnings. folder_lock: folders that
several processes write into.
"""

from cusick_bench.files.csv_file import CsvTable, read_csv
from cusick_bench.files.errors import BadFile
from cusick_bench.files.json_file import parse_json, read_json, read_json_object
from cusick_bench.files.npz_file import read_npz
from cusick_bench.files.regular_file import read_bytes, read_text

__all__ = [
    "BadFile",
    "CsvTable",
    "parse_json",
    "read_bytes",
    "read_csv",
    "read_json",
    "read_json_object",
    "read_npz",
    "read_text",
]
