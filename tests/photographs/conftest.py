"""One synthetic laboratory with a board, photographed and prepared once for all tests."""

from pathlib import Path

import pytest

from cusick_bench.photographs.preparation.prepare import Preparation, Setting, prepare
from cusick_bench.photographs.studio.folder import write_photographs
from cusick_bench.photographs.studio.scene import make_laboratory

LABORATORY = 4  # calibrated by six pictures of the board, tilted by 4 degrees
DRAPES = 2


@pytest.fixture(scope="session")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photographs")
    write_photographs(make_laboratory(LABORATORY), folder, DRAPES)
    return folder


@pytest.fixture(scope="session")
def prepared(photographs: Path, tmp_path_factory: pytest.TempPathFactory) -> Preparation:
    out = tmp_path_factory.mktemp("prepared") / "set"
    return prepare(photographs, out, Setting(cloth_radius=0.15, plate_radius=0.09, weights={1: 0.18}))
