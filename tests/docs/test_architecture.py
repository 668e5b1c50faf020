"""The architecture picture shows the import contracts, and these know every package."""

import importlib.util
from pathlib import Path
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = {"sim", "solvers", "datasets"}


@pytest.fixture(scope="module")
def drawing():
    spec = importlib.util.spec_from_file_location("architecture_picture", ROOT / "docs" / "architecture_picture.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_picture_is_up_to_date(drawing):
    remedy = "the contracts in pyproject.toml have changed: run `make picture`, look at the picture and commit it"
    assert drawing.PICTURE.read_text(encoding="utf-8") == drawing.picture(), remedy


def test_every_package_stands_on_a_floor(drawing):
    floors, _ = drawing.contracts()
    named = {package for floor in floors for package in floor}
    packages = {f"cusick_bench.{path.parent.name}" for path in (ROOT / "cusick_bench").glob("*/__init__.py")}
    packages |= {f"cusick_bench.{name}" for name in FOLDERS}
    assert named == packages - {"cusick_bench.leaderboards"}  # which holds tables, no code


def test_every_subpackage_is_in_the_picture(drawing):
    shown = "".join(element.text or "" for element in ElementTree.fromstring(drawing.picture()).iter())
    for package, layers in drawing.contracts()[1].items():
        name = package.removeprefix("cusick_bench.").replace(".", "/")
        folder = (ROOT if name.split("/")[0] in FOLDERS else ROOT / "cusick_bench") / name
        inside = {member for layer in layers for member in layer}
        assert {path.parent.name for path in folder.glob("*/__init__.py")} <= inside
        if "/" not in name:  # rooms of rooms are not drawn
            assert all(member in shown for member in inside)


def test_every_package_has_a_page_of_the_reference():
    written = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs" / "reference").glob("*.md"))
    packages = {path.parent.name for path in (ROOT / "cusick_bench").glob("*/__init__.py")} | FOLDERS
    missing = {name for name in packages - {"cli", "leaderboards"} if f"::: cusick_bench.{name}\n" not in written}
    assert not missing
