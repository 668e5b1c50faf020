"""What tests of data sets share: a small data set, and a cache of their own."""

from pathlib import Path

import pytest
from toy_cloths import write_toy


@pytest.fixture(autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CUSICK_BENCH_CACHE", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    """Fabric 7 in three samples of four captures."""
    return write_toy(tmp_path / "lab")
