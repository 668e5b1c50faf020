"""Docstrings of public functions name every argument and what is returned."""

from pathlib import Path

import pytest
from docstrings import FOLDERS, incomplete_docstrings

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize("folder", FOLDERS)
def test_docstrings_are_complete(folder: str):
    assert (ROOT / folder).is_dir()
    assert incomplete_docstrings(ROOT, (folder,)) == []


@pytest.mark.parametrize(
    ("docstring", "missing"),
    [
        ("", "no docstring"),
        ("Says something.", "Args lacks width"),
        ("Says something.\n\n    Args:\n        height: Height [m].\n    ", "Args lacks width"),
        ("Says something.\n\n    Args:\n        width: Width [m].\n    ", "no Returns"),
    ],
)
def test_what_is_missing_is_named(tmp_path: Path, docstring: str, missing: str):
    text = f'    """{docstring}"""\n' if docstring else ""
    (tmp_path / "part").mkdir()
    (tmp_path / "part" / "module.py").write_text(f"def area(width: float) -> float:\n{text}    return width**2\n")
    (line,) = incomplete_docstrings(tmp_path, ("part",))
    assert line == f"part/module.py:1 area: {missing}"


def test_a_complete_docstring_is_left_alone(tmp_path: Path):
    text = "Area of a square.\n\n    Args:\n        width: Width [m].\n\n    Returns:\n        Area [m2].\n    "
    (tmp_path / "part").mkdir()
    code = f'def area(width: float) -> float:\n    """{text}"""\n    return width**2\n'
    (tmp_path / "part" / "module.py").write_text(code)
    assert incomplete_docstrings(tmp_path, ("part",)) == []
