"""`--seed` where a command draws random numbers: another seed is used, and by default the same as ever."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cusick_bench.cli import app

GRIDS = {
    "learning-curve": "learning-curve --data {data} --solver null:disc --learn-from 1 --unseen 2 --vertices 97",
    "table-1": "paper table-1 --data {data} --solver null:disc --vertices 97 --draws 1",
    "table-2": "paper table-2 --data {data} --solver null:disc --vertices 97",
}


@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize("name", GRIDS)
def test_the_first_seed_of_a_grid(name: str, toy_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    asked: list[int] = []

    def planned(source, cells, out, **_):
        asked.extend(sorted({cell.seed for cell in cells}))
        raise KeyboardInterrupt  # nothing is to be run

    module = "learning_curve" if name == "learning-curve" else "paper"
    monkeypatch.setattr(f"cusick_bench.cli.fit.{module}.run_planned", planned)
    words = GRIDS[name].format(data=toy_data).split()
    for more in ([], ["--seed", "7", "--seeds", "2"]):
        CliRunner().invoke(app, [*words, "--out", str(tmp_path / "out"), *more])
    assert asked == [0, 7, 8]


def test_the_seed_of_the_power_of_a_diagnosis(monkeypatch: pytest.MonkeyPatch):
    drawn: list[float] = []

    def needed(emulator, calibration, generator):
        drawn.append(generator.random())
        return {}

    monkeypatch.setattr("cusick_bench.diagnosis.inference.detectability.power.needed", needed)
    monkeypatch.setattr("cusick_bench.diagnosis.inference.detectability.power.detectable", lambda *_, **__: {})
    for more in ([], ["--seed", "3"]):
        result = CliRunner().invoke(app, ["atlas", "power", "--json", *more])
        assert json.loads(result.stdout)["needed"] == {}
    assert drawn == [np.random.default_rng(seed).random() for seed in (0, 3)]
