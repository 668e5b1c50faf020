"""What would be installed: every package and its data, under one version. CI builds the wheel and compares it too."""

import hashlib
import io
import json
import re
import runpy
import shutil
import subprocess
import tarfile
import tomllib
from pathlib import Path

import pytest
import setuptools
from package_files import package_files

import cusick_bench

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def wanted() -> set[str]:
    try:
        return package_files(ROOT)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout: what belongs into the package is not known")


def _installed(monkeypatch: pytest.MonkeyPatch, root: Path) -> set[str]:
    """Files that setup.py and pyproject.toml install, as paths inside a wheel."""
    given: dict[str, dict[str, str]] = {}
    monkeypatch.setattr(setuptools, "setup", lambda **options: given.update(options))
    monkeypatch.chdir(root)
    runpy.run_path(str(root / "setup.py"))
    data = PROJECT["tool"]["setuptools"]["package-data"]
    files: set[str] = set()
    for package in given["packages"]:
        place = Path(package.replace(".", "/"))
        folder = root / given["package_dir"].get(package, place)
        for pattern in ("*.py", *data.get(package, [])):
            files |= {(place / path.relative_to(folder)).as_posix() for path in folder.glob(pattern) if path.is_file()}
    return files


def test_every_module_and_data_file_is_installed(monkeypatch: pytest.MonkeyPatch, wanted: set[str]):
    assert sorted(wanted - _installed(monkeypatch, ROOT)) == []


def test_nothing_else_is_installed(monkeypatch: pytest.MonkeyPatch, wanted: set[str]):
    untracked = _installed(monkeypatch, ROOT) - wanted
    assert {name for name in untracked if not name.endswith(".py")} == set()  # modules may be new


def test_a_nested_package_that_is_forgotten_is_noticed(monkeypatch: pytest.MonkeyPatch, wanted: set[str]):
    monkeypatch.setattr(setuptools, "find_packages", lambda *_args, **_options: [])
    assert "cusick_bench/sim/engine/dynamics/drop.py" in wanted - _installed(monkeypatch, ROOT)


@pytest.mark.usefixtures("wanted")
def test_the_shipped_set_is_checked_out_with_its_bytes_where_git_ends_lines_as_windows_does():
    """Git for Windows does so by default, and no command took the set, whose checksums did not fit any more."""
    command = ["git", "-c", "core.autocrlf=true", "archive", "--worktree-attributes", "HEAD", "datasets/synthetic"]
    packed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        contents = {one.name: archive.extractfile(one).read() for one in archive if one.isfile()}
    listed = json.loads(contents["datasets/synthetic/sha256.json"])
    found = {name: hashlib.sha256(contents[f"datasets/synthetic/{name}"]).hexdigest() for name in listed}
    assert found == listed


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
def test_clean_keeps_results(tmp_path: Path):
    shutil.copy(ROOT / "Makefile", tmp_path)
    for name in ("bench", "check", "identify", "table-1"):
        (tmp_path / "runs" / name).mkdir(parents=True)
    subprocess.run(["make", "clean"], cwd=tmp_path, capture_output=True, check=True)
    assert {path.name for path in (tmp_path / "runs").iterdir()} == {"identify", "table-1"}


def test_version_is_said_alike_everywhere():
    citation = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.M)
    assert citation is not None
    assert cusick_bench.__version__ == PROJECT["project"]["version"] == citation[1]
