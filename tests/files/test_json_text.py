"""JSON that we write: what it has no word for is null, and arrays are lists."""

import json
from pathlib import Path

import numpy as np

from cusick_bench.files.json_text import json_text


def test_numbers_that_are_none_are_null_wherever_they_stand() -> None:
    document = {"a": float("nan"), 1: [np.float64("inf"), np.array([[1.5, np.nan]])], "b": (np.int64(2), Path("c"))}
    assert json.loads(json_text(document)) == {"a": None, "1": [None, [[1.5, None]]], "b": [2, "c"]}
    assert json_text({}).endswith("\n")
