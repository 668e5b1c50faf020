"""The list of planted faults stays true: each can be planted, and names a test that exists."""

import re
from pathlib import Path

import pytest
from planted_faults import FAULTS, ROOT, Fault, copy_checkout

each_fault = pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)


@each_fault
def test_fault_can_be_planted(fault: Fault):
    text = (ROOT / fault.file).read_text(encoding="utf-8")
    assert fault.planted(text) != text
    compile(fault.planted(text), fault.file, "exec")


@each_fault
def test_the_test_that_catches_it_exists(fault: Fault):
    path, *parts = fault.test.split("::")
    text = (ROOT / path).read_text(encoding="utf-8")
    assert parts
    assert all(re.search(rf"^\s*(def|class) {part}\b", text, re.M) for part in parts)


def test_faults_are_of_eleven_kinds_and_listed_for_contributors():
    assert len({fault.name for fault in FAULTS}) == 11
    listed = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for fault in FAULTS:
        assert f"| {fault.name} | {fault.meaning} | `{fault.test.split('::', 1)[1]}` |" in listed


def test_old_text_must_stand_there_once():
    fault = Fault("twice", "", "", "a", "b", "")
    with pytest.raises(ValueError, match="stands 2 times"):
        fault.planted("aa")
    with pytest.raises(ValueError, match="stands 0 times"):
        fault.planted("c")


def test_copy_of_the_checkout_is_one(tmp_path: Path):
    copy_checkout(tmp_path / "copy")
    assert (tmp_path / "copy" / "cusick_bench" / "sim").is_symlink()
    assert (tmp_path / "copy" / "sim" / "drape.py").read_bytes() == (ROOT / "sim" / "drape.py").read_bytes()
