"""Predictions of as many draws as may be asked for can be read again."""

from pathlib import Path

import numpy as np
import pytest

from cusick_bench.cli.options import MOST_DRAWS
from cusick_bench.datasets.files.protocol import MAXIMUM_SIZE, RELEASE
from cusick_bench.files import BadFile
from cusick_bench.report.errors import ReportError
from cusick_bench.report.figures.predictions import load_draws
from cusick_bench.runner import load_prediction
from cusick_bench.runner.store import MOST_PREDICTION_BYTES, PREDICTION_FILE
from cusick_bench.sim.constants import VERTICES_OF_PAPER


def test_the_limit_is_beyond_what_may_be_asked_for():
    drape = VERTICES_OF_PAPER * 3 * np.dtype(float).itemsize
    assert MOST_DRAWS * (RELEASE.image_size_px**2 + drape) < MOST_PREDICTION_BYTES
    assert 1000 * (MAXIMUM_SIZE**2 + drape) + 2 * 4 * MAXIMUM_SIZE**2 < MOST_PREDICTION_BYTES


def test_every_reader_has_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    np.savez_compressed(tmp_path / PREDICTION_FILE, train_image=np.zeros((4, 4)), draws=np.zeros((2, 4, 4), np.uint8))
    assert len(load_prediction(tmp_path)["draws"]) == len(load_draws(tmp_path).images) == 2
    for module in ("cusick_bench.runner.cell_files", "cusick_bench.report.prediction_file"):
        monkeypatch.setattr(f"{module}.MOST_PREDICTION_BYTES", 16)
    for read in (load_prediction, load_draws):
        with pytest.raises((BadFile, ReportError), match="at most"):
            read(tmp_path)
