"""Names of files: safe in paths, and each thing has its own."""

from pathlib import Path

import pytest

from cusick_bench.files.plain_names import plain_names


def test_names_that_differ_in_what_a_path_cannot_hold_get_numbers():
    names = ["wool/blue", "wool blue", "wool_blue", "wool_blue_2", "linen"]
    assert plain_names(names) == {
        "wool/blue": "wool_blue_3", "wool blue": "wool_blue_4", "wool_blue": "wool_blue", "wool_blue_2": "wool_blue_2",
        "linen": "linen",
    }  # fmt: skip


@pytest.mark.parametrize("name", ["..", "../../linen", "/linen", ".", "", ".hidden", "a\\b", "?"])
def test_no_name_leads_out_of_its_folder(name):
    (file,) = plain_names([name]).values()
    assert file
    assert Path("out", file).resolve().parent == Path("out").resolve()
    assert not file.startswith(".")
