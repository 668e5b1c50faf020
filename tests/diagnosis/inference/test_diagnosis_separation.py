"""How far effects lie apart, on an atlas of toy outlines whose effects are known."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from toy_atlas import PLANTED, toy_emulator
from typer.testing import CliRunner

from cusick_bench.cli import app
from cusick_bench.diagnosis.atlas.emulator import Emulator
from cusick_bench.diagnosis.atlas.store import Calibration
from cusick_bench.diagnosis.errors import DiagnosisError
from cusick_bench.diagnosis.inference.detectability.power import NEEDED
from cusick_bench.diagnosis.inference.detectability.separation import separations, summary
from cusick_bench.diagnosis.inference.residuals.feature_rows import SPREAD
from cusick_bench.diagnosis.inference.residuals.residual import Residual, against_base
from cusick_bench.diagnosis.measure.features import SPREADS, Features
from cusick_bench.diagnosis.measure.statistics import GROUPS

LEVEL = -7.0


def test_every_pair_has_a_separation_that_more_statistics_do_not_lower() -> None:
    found = separations(toy_emulator(), LEVEL)
    names = {name for one in found for name in (one.first, one.second)}
    assert names == {"grain-skew", *PLANTED}
    assert len(found) == len(names) * (len(names) - 1) // 2
    assert all(one.full > 0.9 * one.without for one in found)
    pair = {(one.first, one.second): one for one in found}
    far, near = pair["off-centre", "camera-scale"], pair["camera-scale", "threshold"]
    assert far.without > 0.9 * NEEDED  # one moves locked statistics only, the other phase-free ones
    assert near.full < 0.5 * far.full
    figures = summary(found)
    assert figures["median_full"] >= figures["median_without"] > 0
    assert 0 < figures["alike_full"] <= 1


def test_what_is_left_out_is_what_counts_before() -> None:
    everything_else = [name for name in GROUPS if name not in ("size", "harmonics")]
    few = separations(toy_emulator(), LEVEL, left_out=everything_else)
    usual = separations(toy_emulator(), LEVEL)
    assert np.median([a.full / max(a.without, 0.1) for a in few]) > np.median(
        [b.full / max(b.without, 0.1) for b in usual]
    )
    same = separations(toy_emulator(), LEVEL, left_out=())
    assert all(one.full == pytest.approx(one.without) for one in same)


def test_scatter_of_statistics_that_are_left_out_is_left_out_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """All statistics of the mean but one are left out; the scatter of the others would still tell effects apart."""
    seen = []

    def spied(emulator: Emulator, features: Features, **options: Any) -> Residual:
        seen.append(against_base(emulator, features, **options))
        return seen[-1]

    monkeypatch.setattr("cusick_bench.diagnosis.inference.detectability.separation.against_base", spied)
    separations(toy_emulator(), LEVEL, left_out=[name for name in GROUPS if name != "depth"])
    full, few = ([name for (name, _), kept in zip(SPREADS, one.kept[SPREAD], strict=True) if kept] for one in seen[:2])
    assert full == [name for name, _ in SPREADS]
    assert few == ["fold_depth"]


@pytest.mark.parametrize("left_out", [["feathers"], list(GROUPS)])
def test_groups_that_cannot_be_left_out(left_out: list[str]) -> None:
    with pytest.raises(DiagnosisError, match="must be some of size, radii"):
        separations(toy_emulator(), LEVEL, left_out=left_out)


def test_command_writes_every_pair(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cusick_bench.diagnosis.atlas.store.load", lambda path: (toy_emulator(), Calibration()))
    out = tmp_path / "pairs.csv"
    found = CliRunner().invoke(app, ["atlas", "separation", "--out", str(out), "--json"])
    assert found.exit_code == 0, found.output
    document = json.loads(found.stdout)
    rows = [line.split(",") for line in out.read_text().splitlines()]
    assert rows[0] == ["bending", "first", "second", "without", "all"]
    assert len(rows) - 1 == len(document["pairs"]) == 3 * 10
    assert float(rows[1][4]) == pytest.approx(document["pairs"][0]["full"], abs=0.01)
    assert set(document["levels"]) == {"-8.5", "-7", "-5.5"}
    refused = CliRunner().invoke(app, ["atlas", "separation", "--leave-out", "feathers"])
    assert refused.exit_code == 2
    assert "feathers" in refused.output
