"""What tests of identifications share."""

from pathlib import Path

import pytest
from toy_atlas import toy_emulator

from cusick_bench.diagnosis.atlas.store import Calibration, save
from cusick_bench.photographs.studio.folder import write_photographs
from cusick_bench.photographs.studio.scene import make_laboratory


@pytest.fixture(scope="module")
def atlas(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("atlas") / "atlas.npz"
    save(path, toy_emulator(), Calibration())
    return path


@pytest.fixture(scope="module")
def lab(make_lab) -> Path:
    """Fabric 1 has three samples, fabric 2 has one, fabric 3 was not weighed."""
    root = make_lab([1e-5, 3e-5, 1e-5], samples=3, weighed=2)
    for sample in (2, 3):
        (root / f"data/Fabric 2/silhouettes/Fabric_2_Sample_{sample}_Capture_1.jpg").unlink()
    return root


@pytest.fixture(scope="module")
def photographs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("photographs")
    write_photographs(make_laboratory(8), folder, 1)  # calibrated by its bare plate: the fewest pictures
    return folder
